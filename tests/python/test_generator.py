"""The independent generator: its null against description and closed forms, its recordings, and what each effect does."""

import math
import os

import generator_case as cases
import numpy as np
import pytest

from wineglass import device as devices
from wineglass import paths
from wineglass.blind import generator
from wineglass.blind.generator import Applied, making, native, unit
from wineglass.blind.generator.native import ffi, library
from wineglass.blind.generator.plant import Plant
from wineglass.blind.generator.world import World
from wineglass.errors import BadInput
from wineglass.recording import Recording
from wineglass.steady_state import steady_state

CATALOGUE = """frequency_temperature damping_temperature amplitude_frequency amplitude_damping damping_step frequency_split damping_mismatch
cross_damping cross_stiffness coriolis_gain thermal_gradient thermal_hysteresis ageing drive_misalignment actuator_gain drive_phase
pickoff_gain pickoff_phase drive_feedthrough adc_nonlinearity adc_saturation excess_noise flicker_noise clock_error clock_jitter
dropped_samples thermometer_lag thermometer_error thermometer_quantisation vibration interference rate_reference firmware_mismatch""".split()
STAGES = {"primary", "secondary", "coupling", "actuation", "pickoff", "clock", "temperature", "environment", "firmware"}
VARIANTS = generator.variants()
FRAMES = {"baseband_hz": 50.0, "output_hz": 50.0, "reference_hz": 50.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("generator")


@pytest.fixture(scope="module")
def plain(folder):
    """The short day of a healthy device in both loops: paths and calibration blocks."""
    found = {}
    for loop in ("open", "rebalance"):
        case, path = cases.case(loop), folder / f"plain_{loop}.h5"
        block = cases.block(case)
        generator.make(case, path, block)
        found[loop] = (path, block)
    return found


def made(folder, block, loop, *effects, name="changed.h5", **more):
    path = folder / name
    generator.make(cases.case(loop, effects=effects, **more), path, block)
    return path


# --- the register ----------------------------------------------------------------------------------------------------


def test_every_effect_of_the_catalogue_has_two_forms():
    assert generator.ids(in_catalogue=True) == sorted(CATALOGUE)
    assert all(len(generator.variants(one)) >= 2 for one in CATALOGUE)
    assert {one.stage for one in VARIANTS} == STAGES


def test_a_dozen_effects_stand_outside_the_catalogue_and_one_imitates():
    assert len(generator.ids(in_catalogue=False)) >= 12
    imitators = [one for one in VARIANTS if one.imitates]
    assert imitators and all(one.imitates in CATALOGUE and not one.in_catalogue for one in imitators)


def test_an_unknown_variant_is_refused():
    with pytest.raises(BadInput, match="no effect"):
        generator.find("ageing", "sideways")


# --- the healthy device ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name, q", [("metal", 2000.0), ("silica", 4000.0)])
def test_null_in_the_open_loop_against_the_steady_state(folder, name, q):
    """Locked and at rest at 40 degC: frequency and secondary amplitude are those of the closed form, rate noise that of the converter."""
    quality = {"resonator.q": q}
    scenario = cases.day(**{"device": name, "override": quality, "duration_s": 12.0, "temperature": {"kind": "constant", "value_degc": 40.0},
                            "rate": {"kind": "constant", "value_deg_s": 3.0}, "command": [], "recording": FRAMES,
                            "mode": {"loop": "open", "compensation": "none"}})
    case = generator.Case(scenario)
    generator.make(case, folder / "rest.h5", cases.block(case))
    described = devices.load(name).override(quality)
    expected = steady_state(described.resonator, 40.0, math.radians(3.0))
    with Recording.open(folder / "rest.h5") as recording:
        tap = recording.tap("baseband")
        late = tap.time_s > 9.0
        z1, z2 = (np.asarray(tap[f"{axis}_in_phase"])[late] + 1j * np.asarray(tap[f"{axis}_quadrature"])[late] for axis in ("primary", "secondary"))
        frequency = np.asarray(tap["drive_frequency"])[late]
    assert frequency.mean() == pytest.approx(float(expected.frequency_hz), rel=2e-8)
    assert abs((z2 / z1).mean() - complex(expected.ratio)) < 3e-6
    # noise of the lock-in: white noise of the converter and its quantiser in the band of 50 Hz frames
    adc = described.electronics.adc
    code = 2.0 ** (1 - adc.bits)
    per_frame = described.electronics.sample_rate_hz / 50.0
    white = math.sqrt(2.0 * (adc.noise_fs_rms**2 + code**2 / 12.0) / per_frame)
    assert np.std(np.diff(z2.imag)) / math.sqrt(2.0) == pytest.approx(white, rel=0.25)


def test_null_rate_follows_the_table(plain):
    """Rebalance: rate and true rate differ by no more than bias tolerance, noise and what the split's quadrature leaks."""
    with Recording.open(plain["rebalance"][0]) as recording:
        rate, true = np.asarray(recording.tap("output")["rate"]), np.asarray(recording.tap("reference")["true_rate"])
        time_s = recording.tap("output").time_s
    for begin, end in ((6.3, 6.9), (8.0, 9.5), (10.8, 11.4)):
        part = (time_s > begin) & (time_s < end)
        assert abs(np.mean(rate[part] - true[part])) < 8e-5
        assert np.std(rate[part]) < 4e-4


def test_a_turned_frame_turns_nothing():
    """Without damping and forces an oscillation keeps its plane while the frame turns under it, g = 2, through a ramp of the rate: x2/x1 is the
    tangent of the angle at every single sample. Numbers held over several samples would fail here."""
    changes = {"device": "paper", "duration_s": 0.2, "temperature": {"kind": "constant"}, "command": [], "recording": FRAMES,
               "rate": {"kind": "steps", "times_s": [0.0], "values_deg_s": [900.0], "edge_s": 0.1},
               "override": {"resonator.cross_damping_rad_s": [0.0], "electronics.adc.bits": 32, "electronics.adc.snr_db": 0.0}}
    case = generator.Case(cases.day(**changes))
    described = making.describe(case)
    world = World(described, described.override({"noise_floor.rate_bias_instability_rad_s": 0.0, "noise_floor.frequency_ppm": 0.0,
                                                 "noise_floor.drive_level_relative": 0.0}), case.scenario, 1)
    world.decay_1 = world.decay_2 = 0.0
    world.drive_force = world.rebalance_force = 0.0
    with Plant(world, cases.block(case)) as plant:
        library().exam_set_state(plant._exam, ffi.new("double[]", [0.5, 0.0, 0.0, 0.0]))
        codes = plant.run(world.n_blocks, codes=True)[1]
    time_s = np.arange(len(codes)) / 50_000.0
    full, edge = math.radians(900.0), 0.1
    angle = np.where(time_s < edge, 0.5 * full / edge * time_s**2, full * (time_s - 0.5 * edge))
    carrier = 0.5 * np.cos(2 * math.pi * 5000.0 * time_s)
    np.testing.assert_allclose(codes[:, 0] * 2.0**-31, carrier * np.cos(angle), rtol=0, atol=5e-8)
    np.testing.assert_allclose(codes[:, 1] * 2.0**-31, carrier * np.sin(angle), rtol=0, atol=5e-8)


def test_another_unit_stays_within_the_tolerances():
    described = devices.load("metal")
    draws = [unit.drawn(described, np.random.default_rng(seed)) for seed in range(300)]
    for path, tolerance in described.tolerance.items():
        values = np.array([np.atleast_1d(draw[path]) for draw in draws], float)
        nominal = np.atleast_1d(np.asarray(_field(described, path), float))
        size = np.abs(nominal) * tolerance.relative if tolerance.relative else np.atleast_1d(tolerance.absolute)
        assert np.all(np.abs(values - nominal) <= 2.0 * size + 1e-15), path
        spread = np.sqrt(np.mean((values - nominal) ** 2, axis=0))
        np.testing.assert_allclose(spread, 0.88 * size, rtol=0.15, err_msg=path)  # a normal cut at two sigma
    assert unit.another(described, draws[0]) != described


def _field(device, path):
    for part in path.split("."):
        device = getattr(device, part)
    return device


# --- recordings ------------------------------------------------------------------------------------------------------


def test_a_recording_is_whole(folder, plain):
    """Every tap, a burst with its snapshot, frames lost on the wire, and a description that knows of the noise."""
    path = made(folder, plain["open"][1], "open", another_unit=True, lost_fraction=0.02, noise_factor=2.0)
    with Recording.open(path) as recording:
        assert {"baseband", "output", "reference"} <= set(recording.taps)
        assert len(recording.bursts) == 1 and recording.bursts[0].state_snapshot and recording.bursts[0].length == 1000
        assert 0.002 < np.asarray(recording.tap("output").lost).mean() < 0.06
        told = devices.loads(recording.device_toml)
    described = devices.load("metal-fast")
    assert told.electronics.adc.snr_db == pytest.approx(described.electronics.adc.snr_db - 6.02, abs=0.01)
    assert told.resonator == described.resonator


@pytest.mark.parametrize("one", [Applied("thermometer_lag", "two_poles", 1.0), Applied("firmware_mismatch", "other_bias", 30.0),
                                 Applied("clock_error", "constant", 200.0), Applied("time_stamps", "constant", 0.05)], ids=lambda one: one.id)
def test_nothing_beside_the_data_tells_a_case_from_a_null(folder, plain, one):
    path, block = plain["open"]
    with Recording.open(made(folder, block, "open", one, another_unit=True)) as changed, Recording.open(path) as null:
        for name in ("device_toml", "calibration_json", "calibration_block", "firmware_version", "source", "counter_rate_hz"):
            assert getattr(changed, name) == getattr(null, name), name
        assert [(event.sample, event.kind, event.value) for event in changed.events] == [(e.sample, e.kind, e.value) for e in null.events]
        assert {tap: sorted(changed.tap(tap).channels) for tap in changed.taps} == {tap: sorted(null.tap(tap).channels) for tap in null.taps}


def test_the_same_case_gives_the_same_bytes_and_another_seed_others(folder, plain):
    block = plain["open"][1]
    again = made(folder, block, "open", name="again.h5")
    other = folder / "other.h5"
    generator.make(cases.case("open", seed=6), other, block)
    with Recording.open(plain["open"][0]) as a, Recording.open(again) as b, Recording.open(other) as c:
        codes = [np.asarray(one.tap("output").codes("rate")) for one in (a, b, c)]
    assert np.array_equal(codes[0], codes[1]) and not np.array_equal(codes[0], codes[2])


# --- effects ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def healthy():
    """A healthy short day as the plant gets it."""
    case = cases.case()
    described = making.describe(case)
    return described, _inputs(making.world_of(case, described, {}))


@pytest.mark.parametrize("one", VARIANTS, ids=lambda one: f"{one.id}-{one.name}")
def test_strength_zero_is_the_healthy_device_and_the_typical_one_is_not(healthy, one):
    described, expected = healthy
    found = [_inputs(making.world_of(cases.case(effects=(Applied(one.id, one.name, size),)), described, {})) for size in (0.0, one.typical)]
    assert found[0] == expected and found[1] != expected


def _inputs(world: World) -> dict[str, object]:
    """All that plant, recorder and bench are given, as values that compare."""
    columns = {name: np.asarray(value, float).tobytes() for name, value in world.columns().items()}
    curves = [None if curve is None else curve.tobytes() for curve in (*world.adc_error, *world.dac_error)]
    return columns | {"thermometer": world.thermometer_codes().tobytes(), "curves": curves, "tones": repr(world.tones), "troubles": world.troubles,
                      "bench": repr(world.bench), "patches": len(world.output_patches) + len(world.calibration_patches),
                      "rest": (world.quantum, world.amplitude_power, world.jitter_memory)}


SEED = int(os.environ.get("WINEGLASS_SEED", "1"))  # chooses one variant of every effect


@pytest.mark.parametrize("id", generator.ids())
def test_every_effect_shows_where_it_is_said_to(folder, plain, id):
    """Three times the typical size: a quarter of a minute is no bench day. All variants: tests/campaigns/generator_variants.py."""
    one = generator.variants(id)[SEED % len(generator.variants(id))]
    loop = one.loop or "open"
    path, block = plain[loop]
    grade = generator.grade(made(folder, block, loop, Applied(one.id, one.name, 3.0 * one.typical)), path)
    shown = max(_seen(grade, channel) for channel in one.channels)
    assert shown > 8.0, f"variant {one.name} (seed {SEED}), {one.channels}: {shown:.1f}, most in {grade.channel}: {grade.snr:.1f}"


def _seen(grade, channel: str) -> float:
    found = grade.channels[channel.removeprefix("noise of ")]
    return max(found.noise, found.shift) if channel.startswith("noise of ") else found.shift


def test_strength_scales_what_is_seen(folder, plain):
    path, block = plain["open"]
    snr = [generator.grade(made(folder, block, "open", Applied("cross_damping", "constant", size)), path).channels["rate"].shift for size in (60.0, 180.0)]
    assert snr[1] == pytest.approx(3.0 * snr[0], rel=0.1)


def test_strengths_are_found_for_a_wanted_snr(plain):
    case = cases.case("open", effects=(Applied("cross_damping", "constant", 600.0), Applied("ageing", "linear", 300.0)))
    scaled, grade = generator.scaled_to(case, plain["open"][1], 40.0)
    assert 25.0 < grade.snr < 60.0
    assert scaled.effects[0].strength / scaled.effects[1].strength == pytest.approx(2.0) and scaled.scenario == case.scenario


def test_the_oracle_sees_nothing_in_a_null(plain):
    case = cases.case("open")
    assert generator.oracle(case, plain["open"][1]).snr == 0.0


def test_the_library_has_no_twin_in_it():
    text = native.library_path().read_bytes()
    assert b"exam_run" in text and b"twin_create" not in text and b"envelope_create" not in text


def test_the_page_lists_every_variant_with_its_size():
    text = (paths.repository_root() / "docs/GENERATOR.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.count("|") == 6]
    listed, current = set(), ""
    for effect, name, unit_text, typical, _ in rows:
        current = effect.strip("`") or current
        listed.add((current, name.strip("`"), unit_text, typical))
    assert {(one.id, one.name, one.unit, f"{one.typical:g}") for one in VARIANTS} <= listed


@pytest.mark.parametrize("effects", [
    [("vibration", "near_carrier", 100.0), ("interference", "alias", 10.0), ("clock_jitter", "periodic", 1.0), ("swept_rocking", "swept", 0.5)],
    [("amplitude_frequency", "duffing", 3.0), ("amplitude_damping", "quartic", 0.02)],
], ids=["four tones", "two powers"])
def test_effects_that_exclude_each_other_are_refused(effects):
    case = cases.case(effects=tuple(Applied(*one) for one in effects))
    with pytest.raises(BadInput, match="at once"):
        making.world_of(case, making.describe(case), {}).columns()


def test_a_wrong_clock_shifts_the_whole_day():
    """Rate, chamber, shell and everything that hangs on them are those of the true time; the order of effects does not matter."""
    effects = (Applied("drive_feedthrough", "resistive", 100.0), Applied("thermometer_lag", "one_pole", 0.5), Applied("clock_error", "constant", 1e4))
    worlds = [making.world_of(one, making.describe(one), {}) for one in (cases.case(effects=effects), cases.case(effects=effects[::-1]), cases.case())]
    assert _inputs(worlds[0]) == _inputs(worlds[1]) != _inputs(worlds[2])
    fast, right = worlds[0], worlds[2]
    late = np.interp(fast.time_s, right.time_s, right.shell_degc)
    np.testing.assert_allclose(fast.shell_degc, late, atol=1e-3)
    np.testing.assert_allclose(fast.frequency_hz, np.interp(fast.time_s, right.time_s, right.frequency_hz), rtol=2e-7)


def test_a_day_that_does_not_fit_into_memory_is_refused():
    case = generator.Case(cases.day(duration_s=20_000.0))
    with pytest.raises(BadInput, match="memory"):
        making.world_of(case, making.describe(case), {})

"""The envelope twin against closed forms, and against the sampled twin over everything that a scenario can ask for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from both_twins import both, case, rms

from wineglass import paths, scenario
from wineglass.effects import Setting
from wineglass.envelope import Envelope
from wineglass.errors import BadInput

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

Q, F = 1e4, 5000.0
TAU_S = Q / (math.pi * F)
HELD = ("rate", "rate_uncompensated", "quadrature", "drive_frequency", "drive_level")


def run_of(**fields) -> scenario.Run:
    return scenario.prepare(scenario.parse({"device": "paper", "duration_s": 10.0, **fields}, "case"))


def frames_of(run: scenario.Run, **options):
    with Envelope(run, **{"frame_ticks": 20, **options}) as twin:
        return twin.run()


# ---- closed forms -----------------------------------------------------------------------------------------------------------


def test_open_loop_rate_follows_a_step_with_the_decay_time():
    frames = frames_of(run_of(duration_s=14.0, mode={"compensation": "none", "output_filter_hz": 0.0},
                              override={"resonator.cross_damping_rad_s": [0.0]},
                              rate={"kind": "steps", "times_s": [8.0], "values_deg_s": [1.0], "edge_s": 1e-6}))
    after = (frames.end_s > 8.03) & (frames.end_s < 12.0)
    middle = frames.end_s[after] - 0.5 * 0.02 - 8.0 - 0.18e-3
    mean = math.sinh(0.01 / TAU_S) / (0.01 / TAU_S)  # of an exponential over a frame, against its middle
    assert np.degrees(frames["rate"][after]) == pytest.approx(1.0 - mean * np.exp(-middle / TAU_S), abs=2e-4)


def test_closed_loop_rate_is_the_true_one_and_its_force_the_one_that_balances_coriolis():
    run = run_of(duration_s=6.0, mode={"loop": "rebalance", "compensation": "static"}, rate={"value_deg_s": 30.0})
    frames = frames_of(run)
    assert np.degrees(frames["rate"][-50:]) == pytest.approx(30.0, rel=1e-6)
    full = run.device.holding_acceleration_fs_s2 * 2.6 * math.sin(0.1 * math.pi) / (0.1 * math.pi)
    wanted = 2.0 * (math.radians(30.0) + 1.0792e-3) * 0.9 * 2 * math.pi * F / full
    assert frames["rebalance_in_phase"][-1] == pytest.approx(-wanted, rel=1e-4)


def test_level_is_what_holds_the_amplitude():
    frames = frames_of(run_of())
    held = math.sin(0.1 * math.pi) / (0.1 * math.pi)  # fundamental of a force held for a sample
    assert frames["drive_level"][-1] == pytest.approx(0.5 / held, rel=1e-5)
    assert frames["primary_in_phase"][-1] == pytest.approx(0.9, abs=1e-7)


def test_split_at_45_degrees_is_quadrature():
    frames = frames_of(run_of(mode={"loop": "rebalance", "compensation": "static"},
                              override={"resonator.split_hz": 0.02, "resonator.split_axis_deg": 45.0}))
    assert frames["quadrature"][-1] == pytest.approx(2 * math.pi * 0.02 / 2.0, rel=1e-4)


def test_a_lag_of_the_force_moves_the_frequency_by_its_tangent():
    frames = frames_of(run_of(plant={"override": {"electronics.dac.latency_samples": 2}}))
    angle = 2 * math.pi * F / 50e3
    assert frames["drive_frequency"][-1] == pytest.approx(F - math.tan(angle) / (2 * math.pi * TAU_S), abs=2e-5)
    assert frames["drive_level"][-1] == pytest.approx(0.50833 / math.cos(angle), rel=1e-3)


def test_ring_down_is_exponential():
    frames = frames_of(run_of(duration_s=10.0, override={"resonator.cross_damping_rad_s": [0.0]}, command=[{"at_s": 6.0, "kind": "amplitude", "set_point_fs": 0.04}]))
    falling = (frames.end_s > 6.05) & (frames.end_s < 7.4)
    slope = np.polyfit(frames.end_s[falling], np.log(frames["primary_in_phase"][falling]), 1)[0]
    assert -1.0 / slope == pytest.approx(TAU_S, rel=1e-6)
    assert np.all(frames["drive_level"][falling] == 0.0)


def test_frequency_and_temperature_follow_the_device_s_laws():
    run = scenario.prepare(scenario.parse({"device": "metal", "duration_s": 8.0, "temperature": {"value_degc": 60.0}}, "case"))
    frames = frames_of(run)
    assert frames["temperature_measured"][-1] == pytest.approx(60.0, abs=1e-9)
    assert frames["drive_frequency"][-1] == pytest.approx(run.device.resonator.frequency_at(60.0) + 0.01 * math.cos(math.radians(40)), abs=1e-4)


# ---- against the sampled twin -----------------------------------------------------------------------------------------------

RAMPS = {"kind": "ramps", "start_degc": 25, "ramps": [{"to_degc": 60, "speed_degc_per_min": 200}, {"to_degc": 30, "speed_degc_per_min": 200}]}
STEPS = {"kind": "steps", "times_s": [4, 8, 12], "values_deg_s": [20, -5, 0], "edge_s": 0.3}

# A scenario, and what it is compared with: the same without what it is about.
CASES: dict[str, tuple[dict, dict]] = {
    "rate sine 1 Hz": ({"rate": {"kind": "sine", "amplitude_deg_s": 5, "frequency_hz": 1}}, {}),
    "rate sine 5 Hz": ({"rate": {"kind": "sine", "amplitude_deg_s": 5, "frequency_hz": 5}}, {}),
    "rate chirp": ({"rate": {"kind": "chirp", "amplitude_deg_s": 5, "start_hz": 0.2, "end_hz": 6, "begin_s": 4, "duration_s": 10}}, {}),
    "rate steps": ({"rate": STEPS}, {}),
    "temperature ramps": ({"device": "metal-fast", "temperature": RAMPS}, {"device": "metal-fast"}),
    "thermometer lag": ({"device": "metal-fast", "temperature": RAMPS, "plant": {"override": {"thermal.thermometer_lag_s": 3.0}}},
                        {"device": "metal-fast", "temperature": RAMPS}),
    "other Q over temperature": ({"device": "metal-fast", "temperature": RAMPS, "plant": {"override": {"resonator.q_slope_per_degc": -0.003}}},
                                 {"device": "metal-fast", "temperature": RAMPS}),
    "split": ({"rate": STEPS, "plant": {"override": {"resonator.split_hz": 0.05, "resonator.split_axis_deg": 25}}}, {"rate": STEPS}),
    "damping mismatch": ({"rate": STEPS, "plant": {"override": {"resonator.damping_mismatch": 0.05}}}, {"rate": STEPS}),
    "cross stiffness": ({"rate": STEPS, "plant": {"override": {"resonator.quadrature_rad_s": 0.02}}}, {"rate": STEPS}),
    "angular gain": ({"rate": STEPS, "plant": {"override": {"resonator.angular_gain": 1.95}}}, {"rate": STEPS}),
    "pickoff delay": ({"rate": STEPS, "plant": {"override": {"electronics.adc.delay_samples": 0.1}}}, {"rate": STEPS}),
    "secondary pickoff's delay": ({"rate": STEPS, "plant": {"override": {"electronics.adc.secondary_delay_samples": 0.1}}}, {"rate": STEPS}),
    "a delay that both know": ({"rate": STEPS, "override": {"electronics.adc.secondary_delay_samples": 0.3}}, {"rate": STEPS}),
    "force delay": ({"rate": STEPS, "plant": {"override": {"electronics.dac.latency_samples": 2}}}, {"rate": STEPS}),
    "weaker drive": ({"plant": {"override": {"electronics.dac.drive_reach": 1.8}}}, {}),
    "amplitude steps": ({"command": [{"at_s": 6, "kind": "amplitude", "set_point_fs": 0.8}, {"at_s": 9, "kind": "amplitude", "set_point_fs": 0.9}]},
                        {}),
    "ring-down": ({"command": [{"at_s": 6, "kind": "amplitude", "set_point_fs": 0.1}, {"at_s": 9, "kind": "amplitude", "set_point_fs": 0.9}]}, {}),
    "drive off": ({"rate": STEPS, "command": [{"at_s": 6, "kind": "drive", "on": False}, {"at_s": 7.5, "kind": "drive", "on": True}]}, {"rate": STEPS}),
    "test force in phase": ({"command": [{"at_s": 6, "kind": "test_signal", "in_phase_fs": 0.05}, {"at_s": 10, "kind": "test_signal"}]}, {}),
    "test force in quadrature": ({"command": [{"at_s": 6, "kind": "test_signal", "quadrature_fs": 0.05}, {"at_s": 10, "kind": "test_signal"}]},
                                 {}),
    "test tone": ({"command": [{"at_s": 6, "kind": "test_signal", "in_phase_fs": 0.03, "quadrature_fs": 0.02, "frequency_hz": 3.0}]}, {}),
    "phase set-point": ({"rate": STEPS, "command": [{"at_s": 6, "kind": "phase_set_point", "phase_deg": 2}]}, {"rate": STEPS}),
}
# The rebalance force is held for a loop tick, which at 5 kHz is a turn of the carrier: a force that changes at W' then pushes the quadrature axis by
# W'/2w, in a phase that is the sampling clock's. The envelope twin has no such phase.
HELD_FORCE = {"rate sine 5 Hz": 6e-4, "rate chirp": 6e-4}
SETTLED_S = 0.4  # after a change of the amplitude's set-point, when the drive force stands at its limits


def kept_frames(fields: dict, n: int, start_s: float) -> np.ndarray:
    time_s = start_s + 0.02 * np.arange(n)
    jumps = [command["at_s"] for command in fields.get("command", []) if command["kind"] in ("amplitude", "drive", "phase_set_point")]
    return np.all([(time_s < jump - 0.04) | (time_s > jump + SETTLED_S) for jump in jumps] or [time_s > 0], axis=0)


@pytest.mark.parametrize("mode", [{"loop": "open", "compensation": "g2"}, {"loop": "open", "compensation": "static"},
                                  {"loop": "open", "compensation": "none"}, {"loop": "rebalance", "compensation": "static"}],
                         ids=lambda mode: f"{mode['loop']}-{mode['compensation']}")
@pytest.mark.parametrize("name", CASES)
def test_the_change_is_that_of_the_sampled_twin(name, mode):
    common = {"device": "metal", "duration_s": 16.0, "mode": {**mode, "output_filter_hz": 50.0}}
    changed, plain = ({**common, **fields} for fields in CASES[name])
    start_s = 3.5
    fast0, slow0 = both(case(plain), start_s)
    fast, slow = both(case(changed), start_s)
    kept = kept_frames(changed, len(fast["rate"]), start_s)
    for channel in HELD:
        true, found = (slow[channel] - slow0[channel])[kept], (fast[channel] - fast0[channel])[kept]
        allowance = ALLOWED[channel] + 2.0 * rms((fast0[channel] - slow0[channel])[kept])
        if channel == "quadrature":
            allowance += HELD_FORCE.get(name, 0.0) * rms((slow["rate"] - slow0["rate"])[kept])
        assert rms(found - true) <= 0.01 * rms(true) + allowance, channel


# What no effect is meant to be seen below: rad/s, Hz, FS. The converters of the default device alone make more noise at 50 Hz.
ALLOWED = {"rate": 5e-6, "rate_uncompensated": 5e-6, "quadrature": 1e-5, "drive_frequency": 2e-5, "drive_level": 2e-5}


def test_the_paper_s_fast_swing_is_the_same_in_both():
    fields = {"device": "paper", "duration_s": 16.0, "temperature": {"kind": "sine", "mean_degc": 25, "amplitude_degc": 50, "period_s": 1.0, "acts_on": "shell"}}
    for compensation in ("none", "static", "g2"):
        fast, slow = both(case({**fields, "mode": {"compensation": compensation, "output_filter_hz": 50.0}}, frame_ticks=5), 8.0)
        assert rms(fast["rate"] - slow["rate"]) <= 0.01 * 5.0e-4, compensation


def test_cold_start_takes_as_long_as_in_the_sampled_twin():
    fast, slow = both(case({"device": "metal", "duration_s": 2.0}), 0.24)
    assert rms(fast["primary_in_phase"] - slow["primary_in_phase"]) <= 0.02 * 0.9


def test_full_range_saturates_alike():
    fields = {"device": "metal", "duration_s": 8.0, "mode": {"loop": "rebalance", "compensation": "none", "output_filter_hz": 0.0},
              "rate": {"kind": "table", "times_s": [0, 4, 4.5, 5.5, 6], "values_deg_s": [0, 0, 360, 360, 0]}}
    fast, slow = both(case(fields), 3.5)
    assert np.abs(slow["rebalance_in_phase"]).max() == pytest.approx(0.9, rel=1e-3)  # the force ends before the rate does
    assert rms(fast["rate"] - slow["rate"]) <= 0.01 * rms(slow["rate"])


# ---- frames, steps, starts --------------------------------------------------------------------------------------------------


def test_longer_frames_are_means_of_shorter_ones():
    run = run_of(device="metal-fast", temperature=RAMPS, rate=STEPS, mode={"loop": "rebalance", "compensation": "static"})
    short, long = frames_of(run, frame_ticks=20), frames_of(run, frame_ticks=100)
    for name in ("rate", "drive_frequency", "drive_level", "quadrature"):
        assert long[name] == pytest.approx(short[name].reshape(-1, 5).mean(axis=1), rel=1e-12, abs=1e-15), name


def test_longer_steps_change_little():
    run = run_of(device="metal-fast", duration_s=20.0, temperature=RAMPS, rate=STEPS)
    fine, coarse = frames_of(run, frame_ticks=20, step_ticks=1), frames_of(run, frame_ticks=20, step_ticks=20)
    late = fine.end_s > 4.0
    for name, size in (("rate", 0.2), ("drive_frequency", 1.0), ("quadrature", 0.04)):
        assert rms((fine[name] - coarse[name])[late]) <= 2e-4 * size, name


def test_frames_end_where_telemetry_s_do():
    run = run_of()
    with Envelope(run, frame_ticks=20) as twin:
        assert [twin.end_sample(frame) for frame in (0, 1, 2)] == [956, 1956, 2956]  # docs/SPEC.md: published in the sixth sample


@pytest.mark.parametrize("mode", [{"loop": "open", "compensation": "g2"}, {"loop": "open", "compensation": "static"},
                                  {"loop": "rebalance", "compensation": "static"}], ids=str)
def test_a_settled_start_is_the_state_after_a_long_time(mode):
    fields = {"device": "metal", "duration_s": 20.0, "mode": mode, "rate": {"value_deg_s": 3.0},
              "plant": {"override": {"resonator.split_hz": 0.05, "electronics.adc.delay_samples": 0.05}}}
    run = scenario.prepare(scenario.parse(fields, "case"))
    cold, settled = frames_of(run), frames_of(run, settled=True)
    for name in ("rate", "rate_uncompensated", "quadrature", "drive_frequency", "drive_level", "primary_in_phase", "secondary_in_phase",
                 "secondary_quadrature", "rebalance_in_phase"):
        assert settled[name][0] == pytest.approx(settled[name][-1], rel=1e-6, abs=1e-9), name
        assert settled[name][-1] == pytest.approx(cold[name][-1], rel=1e-6, abs=1e-9), name


def test_a_second_run_is_the_first_one_again():
    run = run_of(command=[{"at_s": 4.0, "kind": "loop", "mode": "rebalance"}, {"at_s": 6.0, "kind": "output_filter", "corner": "0.01"}])
    with Envelope(run, frame_ticks=20) as twin:
        first, second = twin.run(), twin.run()
        assert twin.single_ticks < 3000
    assert all(np.array_equal(first[name], second[name]) for name in first.channels)


def test_a_run_that_needs_more_single_ticks_than_allowed_is_refused_and_one_that_does_not_is_the_same():
    """A rate beyond the rebalance force's range, all along: ticks are done one by one."""
    beyond = run_of(duration_s=10.0, mode={"loop": "rebalance"}, rate={"value_deg_s": 400.0})
    usual = run_of(duration_s=10.0, mode={"loop": "rebalance"}, rate={"value_deg_s": 3.0})
    with Envelope(usual, frame_ticks=20) as free, Envelope(usual, frame_ticks=20, most_single_ticks=3000) as bounded:
        first, second = free.run(), bounded.run()
        assert 0 < free.single_ticks < 3000
    assert all(np.array_equal(first[name], second[name]) for name in first.channels)
    with Envelope(beyond, frame_ticks=20) as free:
        free.run()
        assert free.single_ticks > 5000
    with Envelope(beyond, frame_ticks=20, most_single_ticks=3000) as bounded:
        with pytest.raises(BadInput, match="at their limits"):
            bounded.run()
        assert bounded.single_ticks <= 3020, "it stops at the next frame"


# ---- refusals ---------------------------------------------------------------------------------------------------------------


def test_a_mode_that_rings_without_bound_is_refused_and_ends():
    """The drive chases an amplitude that a clipped converter never shows, and strong coupling carries it on."""
    clipped = Setting("adc_saturation", {"loss_fs": 0.8})
    coupled = Setting("frequency_split", {"split_hz": -20.0, "curve_20_degc": -12.5, "curve_30_degc": -12.5})
    toothed = Setting("adc_nonlinearity", {"teeth_fs": -0.005})
    for settings in ([clipped, toothed], [coupled, toothed]):
        with Envelope(run_of(duration_s=10.0), frame_ticks=20, effects=settings) as twin:
            assert np.isfinite(twin.run().channels["drive_level"]).all()
    with Envelope(run_of(duration_s=100.0), frame_ticks=20, effects=[clipped, coupled, toothed]) as twin, pytest.raises(BadInput, match="rings without bound"):
        twin.run()


def test_commands_that_it_does_not_have_are_refused():
    with pytest.raises(BadInput, match="no command 'restart'"):
        frames_of(run_of(command=[{"at_s": 1.0, "kind": "restart"}]))


def test_frames_that_are_no_whole_steps_are_refused():
    with pytest.raises(BadInput, match="whole number of steps"):
        Envelope(run_of(), frame_ticks=20, step_ticks=7)


def test_a_block_that_the_firmware_refuses_is_refused_with_its_reason():
    with pytest.raises(BadInput, match="refuses the calibration"):
        Envelope(run_of(), calibration_block=bytes(100))


def test_inputs_that_are_no_numbers_are_refused():
    with Envelope(run_of(), frame_ticks=20) as twin:
        inputs = twin.inputs()
        inputs.rate_mean_rad_s[7] = np.nan
        with pytest.raises(BadInput):
            twin.run(inputs)


def test_a_closed_one_says_so():
    twin = Envelope(run_of())
    twin.close()
    twin.close()
    with pytest.raises(ValueError, match="closed"):
        twin.run()

"""What noise, lines, single events and raw codes say: floors against the full twin and by another method, and each effect named on twin recordings."""

import numpy as np
import pytest

from wineglass import device as devices
from wineglass import nominal, scenario
from wineglass.calibration_block import from_binary
from wineglass.diagnosis import noise_floor, noise_level, noise_windows, raw_codes, thermometer_codes
from wineglass.effects import Setting
from wineglass.recording import Recording
from wineglass.simulation import simulate

SEED = 40
DURATION_S = 130.0


def make(path, loop="open", effects=(), seed=SEED, device="metal-fast", **changes):
    run = scenario.prepare(scenario.parse({
        "device": device, "duration_s": DURATION_S, "seed": seed, "mode": {"loop": loop},
        "temperature": {"kind": "sine", "mean_degc": 25, "amplitude_degc": 20, "period_s": 120},
        "recording": {"baseband_hz": 50.0, "output_hz": 50.0, "reference_hz": 50.0,
                      "bursts": [{"time_s": t, "samples": 2500} for t in (10.0, 60.0, 120.0)]}, **changes}, "test"))
    simulate(run, path, effects=effects)
    return path


def examined(path):
    with Recording.open(path) as recording:
        return noise_level.examine(recording)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("noise")
    return {loop: make(folder / f"{loop}.h5", loop) for loop in ("open", "rebalance")}


# ---- floors --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("loop", "channel"), [("open", "primary_in_phase"), ("open", "primary_quadrature"), ("open", "secondary_in_phase"),
                                               ("open", "secondary_quadrature"), ("rebalance", "rebalance_in_phase"),
                                               ("rebalance", "rebalance_quadrature"), ("rebalance", "secondary_in_phase")])
def test_floor_is_that_of_the_full_twin(sound, loop, channel):
    """Mean ratio over thirds of the band: within what so many windows leave of chance (2 % per bin-window root) and 5 %."""
    with Recording.open(sound[loop]) as recording:
        described, calibration = devices.loads(recording.device_toml), from_binary(recording.calibration_block)
        windows = noise_windows.quiet(recording, recording.tap("baseband"), calibration)
        model = noise_floor.FloorModel(described, calibration, 50.0, windows.frequency_hz, loop)
        floor = windows.leaked(model.of_white(channel)) * noise_floor.Pickoff.of(described).whole
        ratio = (windows.densities(recording.tap("baseband")[channel]) / floor)[:, 12:124].mean(axis=0)
    assert len(windows) > 20
    for part in np.array_split(ratio, 3):
        assert part.mean() == pytest.approx(1.0, abs=0.05 + 3.0 / np.sqrt(2.0 * len(windows) * len(part)))


def test_white_noise_through_mixer_and_decimator_by_brute_force():
    """Random samples, mixed and weighed with triangles in numpy; the variance of means over an interval against the model's density."""
    described = devices.load("metal")
    rng = np.random.default_rng(SEED)
    n, ticks, count = 10, 100, 3000
    samples = rng.standard_normal((ticks * count + 1) * n)
    mixed = 2.0 * samples * np.cos(2 * np.pi * 0.1 * np.arange(len(samples)) + 0.3)
    weights = np.concatenate([np.arange(1, n + 1), np.arange(n - 1, 0, -1)]) / n**2
    amplitude = np.convolve(mixed, weights, "valid")[::n][:ticks * count]
    means = amplitude.reshape(count, ticks).mean(axis=1)
    calibration = nominal.calibration(scenario.prepare(scenario.parse({"device": "metal"}, "test")))
    frequency = np.linspace(0.1, 24.9, 249)
    density = noise_floor.FloorModel(described, calibration, 50.0, frequency, "open").of_white("secondary_in_phase")
    assert means.var() == pytest.approx(float(np.mean(density) * 25.0), rel=4 * np.sqrt(2 / count))


def test_trimmed_mean_is_unbiased_for_gamma_powers_and_ignores_a_few_bad_windows():
    rng = np.random.default_rng(SEED)
    power = rng.gamma(3.0, 1.0 / 3.0, (400, 50))
    assert noise_windows.trimmed(power, 3.0).mean() == pytest.approx(1.0, abs=0.02)
    power[:40] *= 1000.0
    assert noise_windows.trimmed(power, 3.0).mean() < 1.25


# ---- nulls and effects ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("loop", ["open", "rebalance"])
def test_a_sound_recording_is_silent(sound, loop):
    found = examined(sound[loop])
    assert found.named == [] and found.where == []
    assert max(found.log_evidence.values()) < 4.0
    assert found.replay.ok is True


CASES = [
    ("excess_noise", {"primary_fs": 6e-5, "secondary_fs": 0.0}), ("excess_noise", {"primary_fs": 0.0, "secondary_fs": 6e-5}),
    ("clock_jitter", {"jitter_s": 2e-9}), ("dropped_samples", {"distance_samples": 1.1e6, "doubled": 0}),
    ("dropped_samples", {"distance_samples": 4e5, "doubled": 1}), ("dropped_samples", {"distance_samples": 1e4, "doubled": 0}), ("interference", {"amplitude_fs": 3e-6, "frequency_hz": 5003.0}),
    ("interference", {"amplitude_fs": 3e-5, "frequency_hz": 13210.0}), ("vibration", {"rate_rad_s": 2e-4, "frequency_hz": 7.3}),
    ("thermometer_quantisation", {"step_degc": 0.25}), ("adc_saturation", {"loss_fs": 0.15}), ("adc_nonlinearity", {"cubic": 3e-4}),
    ("firmware_mismatch", {"scale": 0.01, "bias": 0.0}),
]


@pytest.mark.parametrize(("loop", "effect", "values"), [("open", *case) for case in CASES] + [("rebalance", *case) for case in CASES[1:9:2]])
def test_each_effect_is_named_alone(tmp_path, loop, effect, values):
    found = examined(make(tmp_path / "x.h5", loop, [Setting(effect, values)]))
    assert found.named == [effect]
    given = {name: value for name, value in values.items() if value != 0}
    for name, value, (low, high), _ in found.parameters(effect):
        if name in given and effect not in ("firmware_mismatch", "adc_nonlinearity"):
            assert low - 0.1 * abs(value) <= given[name] <= high + 0.1 * abs(value), (name, value, low, high)
    rivals = [score for chosen, score in found.log_evidence.items() if effect not in chosen]
    assert found.log_evidence[frozenset({effect})] > max(rivals) + 5.0


def test_flicker_noise_of_a_poor_shell_is_named(tmp_path):
    found = examined(make(tmp_path / "x.h5", "open", [Setting("flicker_noise", {"bias_rad_s": 2e-5})]))
    assert found.named == ["flicker_noise"]


def test_noise_within_the_stated_tolerance_is_no_gap(tmp_path):
    """1 dB is the standard deviation that the description states."""
    found = examined(make(tmp_path / "x.h5", "open", **{"plant": {"override": {"electronics.adc.snr_db": 89.0}}}))
    assert found.named == []


def test_steps_of_the_thermometer_by_hand():
    """Readings of a creeping temperature through a coarse sensor, rounded to the device's codes and averaged; and through a fine one."""
    rng = np.random.default_rng(SEED)
    described = devices.load("metal")
    truth = 25.0 + 20.0 * (1.0 - np.exp(-np.linspace(0.0, 8.0, 20 * 6000)))

    def telemetry(step):
        sensed = truth + 0.004 * rng.standard_normal(len(truth))
        coarse = np.round(sensed / step) * step if step else sensed
        codes = np.round(coarse * 128) / 128
        return codes.reshape(-1, 20).mean(axis=1)

    for step in (0.05, 0.3):
        found = thermometer_codes.find(_Output(telemetry(step)), described)
        assert found.coarse and found.step_degc == pytest.approx(step, rel=0.02) and found.log_evidence > 15
    assert not thermometer_codes.find(_Output(telemetry(0.0)), described).coarse


class _Output:
    """A recording of nothing but temperature."""

    def __init__(self, readings):
        self._readings = readings
        self.valid = np.ones(len(readings), bool)

    def __contains__(self, name):
        return name in ("output", "temperature_measured")

    def __getitem__(self, name):
        return self._readings

    def tap(self, name):
        return self


# ---- less than everything ---------------------------------------------------------------------------------------------------------


def without(path, tmp_path, *groups):
    import shutil

    import h5py

    copy = tmp_path / "less.h5"
    shutil.copy(path, copy)
    with h5py.File(copy, "r+") as file:
        for group in groups:
            del file[group]
    return copy


def test_without_raw_codes_the_converters_are_not_judged(sound, tmp_path):
    found = examined(without(sound["open"], tmp_path, "raw"))
    assert found.looks["adc_saturation"] == [] and found.looks["excess_noise"] == ["spectra"]
    assert found.log_evidence[frozenset({"adc_saturation"})] == 0.0
    assert any("raw burst" in note for note in found.notes)


def test_without_baseband_a_line_is_a_vibration_or_a_tone(sound, tmp_path):
    silent = examined(without(sound["open"], tmp_path, "baseband", "raw"))
    assert silent.named == [] and silent.looks["clock_jitter"] == [] and silent.looks["vibration"] == ["lines"]
    shaken = make(tmp_path / "x.h5", "open", [Setting("vibration", {"rate_rad_s": 2e-4, "frequency_hz": 3.3})])
    found = examined(without(shaken, tmp_path, "baseband", "raw"))
    one, two = (found.log_evidence[frozenset({effect})] for effect in ("vibration", "interference"))
    assert min(one, two) > 20 and abs(one - two) < 1


def test_with_nothing_but_the_rate(sound, tmp_path):
    found = examined(without(sound["open"], tmp_path, "baseband", "raw", "device_toml", "calibration_block", "calibration_json", "reference"))
    assert found.named == [] and set(found.log_evidence.values()) <= {0.0, -1.0, -4.0}


# ---- raw codes by themselves -------------------------------------------------------------------------------------------------------


def test_curve_of_a_converter_by_hand():
    """A sine through a known polynomial, quantised: the harmonics give its coefficients back."""
    rng = np.random.default_rng(SEED)
    n = np.arange(2500)
    bursts = []
    for number, amplitude in enumerate((0.9, 0.6, 0.9)):
        x = amplitude * np.cos(2 * np.pi * 0.10007 * n + number)
        x = x + 8e-4 * x**3 - 5e-4 * x**2 + 2.2e-5 * rng.standard_normal(len(n))
        codes = np.round(x * 32768).astype(np.int32)
        bursts.append(raw_codes._burst(_Codes({"primary_adc_raw": codes}), "primary_adc_raw", number))
    evidence, values = {}, {}
    raw_codes._curvature(bursts, evidence, values)
    found = {name: (value, sigma) for name, value, sigma, _ in values["adc_nonlinearity"]}
    for name, truth in (("cubic", 8e-4), ("quadratic", -5e-4), ("quintic", 0.0)):
        assert abs(found[name][0] - truth) < 4 * found[name][1] + 2e-6, (name, found[name])
    assert evidence["adc_nonlinearity"] > 100


def swung(curve, noise_fs=2.2e-5, count=14):
    """Bursts of a sine through a characteristic, quantised with 16 bits."""
    rng, n = np.random.default_rng(SEED), np.arange(2500)
    bursts = []
    for number in range(count):
        amplitude = 0.9 if number % 5 else 0.6
        x = amplitude * np.cos(2 * np.pi * (0.1 + 1e-6 * rng.standard_normal()) * n + number)
        codes = np.round(curve(x + noise_fs * rng.standard_normal(len(n))) * 32768).astype(np.int32)
        bursts.append(raw_codes._burst(_Codes({"primary_adc_raw": codes}), "primary_adc_raw", number))
    evidence, values = {}, {}
    raw_codes._clipping(bursts, evidence, values)
    raw_codes._curvature(bursts, evidence, values)
    return evidence, {name: value for name, value, *_ in values.get("adc_nonlinearity", [])}


def test_repeating_steps_of_a_converter_are_found_and_noise_is_not():
    evidence, values = swung(lambda x: x + 2 / 32768 * ((x * 512) % 1 - 0.5))
    assert evidence["adc_nonlinearity"] > 100 and values["ripple_period_fs"] == pytest.approx(1 / 512, rel=0.01)
    evidence, _ = swung(lambda x: x)
    assert evidence["adc_nonlinearity"] < 0


def test_an_amplifier_that_gives_way_near_its_end_may_be_either():
    evidence, _ = swung(lambda x: np.where(np.abs(x) > 0.7, np.sign(x) * (0.7 + 0.25 * np.tanh((np.abs(x) - 0.7) / 0.25)), x))
    assert evidence["adc_saturation"] > max(100.0, evidence["adc_nonlinearity"] - 3.0)


class _Codes:
    """As much of a burst as the raw look needs."""

    def __init__(self, channels):
        self._channels = channels
        self.lost = np.zeros(len(next(iter(channels.values()))), bool)

    def __len__(self):
        return len(self.lost)

    def __contains__(self, name):
        return name in self._channels

    def __getitem__(self, name):
        return self._channels[name] / 32768.0

    def codes(self, name):
        return self._channels[name]

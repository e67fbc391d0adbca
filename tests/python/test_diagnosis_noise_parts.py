"""The parts of the look at noise, each against another method: evidence against sums over a fine grid, lines, curves and events against drawn ones."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp

from wineglass.diagnosis import curve_of_codes, line_spectra, noise_events, raw_codes
from wineglass.diagnosis.noise_mixture import WANDERS, Mixture

SEED = 42


# ---- evidence of strengths --------------------------------------------------------------------------------------------------------


def by_grid(mixture, answer, low, high):
    """One strength squared, log-uniform, and the floor's tolerance, summed over a fine grid."""
    t = np.linspace(-5.0, 5.0, 81) * mixture.tolerance
    weight = -0.5 * (t / mixture.tolerance) ** 2
    strengths = np.geomspace(low, high, 6001)
    rows = []
    for wander in WANDERS:
        floor = mixture.noise * np.exp(t)[:, None] + mixture.steps + wander**2 * mixture.wander
        joint = mixture.log_likelihood(floor[:, None, :] + strengths[:, None] * answer) + (weight - logsumexp(weight))[:, None]
        rows.append(logsumexp(joint) - np.log(len(strengths)))
    return float(logsumexp(rows) - np.log(len(WANDERS)))


@pytest.mark.parametrize("strength", [0.0, 0.05, 1.0, 40.0])
def test_evidence_is_the_integral_over_strengths(strength):
    """Powers drawn as gamma noise. Laplace's method is good to a nat where it decides, whatever the strength."""
    rng = np.random.default_rng(SEED)
    n = 14
    shape, slope = rng.uniform(40.0, 250.0, n), np.geomspace(2.0, 0.1, n)
    floor = np.ones(n)
    power = rng.gamma(shape, 1.0 / shape) * (1.1 * floor + strength * slope)
    mixture = Mixture(power, shape, floor, 0.05 * floor, 0.2 * slope, 0.23)
    low, high = 1e-2, 1e4
    found = mixture.log_evidence(slope[None, :], np.array([low]), np.array([high]))
    assert found == pytest.approx(by_grid(mixture, slope, low, high), abs=1.0)


# ---- lines ------------------------------------------------------------------------------------------------------------------------


def test_a_slope_is_no_line_and_a_line_is_found():
    rng = np.random.default_rng(SEED)
    count = np.full(128, 60.0)
    slope = np.geomspace(300.0, 1.0, 128)
    power = slope * rng.gamma(60.0, 1.0 / 60.0, 128)
    _, quiet = line_spectra.score(power, count, 8)
    power[50] *= 4.0
    ratio, loud = line_spectra.score(power, count, 8)
    assert quiet.max() < 12.0
    assert np.argmax(loud) == 50 and loud[50] > 40.0 and 2.0 < ratio[50] < 5.0


def test_bins_that_do_not_count_are_no_lines_and_no_neighbours():
    power = np.ones(64)
    power[20] = np.nan
    power[30:33] = np.nan
    ratio, found = line_spectra.score(power, np.full(64, 50.0))
    assert np.isfinite(found).all() and found.max() == 0.0 and ratio[20] == 0.0


def test_a_single_jolt_is_no_line():
    powers = np.ones((40, 16))
    powers[:6] *= 1e4
    mean, _ = line_spectra.usual(powers)
    assert mean == pytest.approx(np.ones(16))


# ---- converters' curves -------------------------------------------------------------------------------------------------------------


class _Codes:
    """What raw_codes asks of a tap."""

    def __init__(self, channels):
        self._channels, self.lost = channels, np.zeros(len(next(iter(channels.values()))), bool)

    def __contains__(self, name):
        return name in self._channels

    def __getitem__(self, name):
        return self._channels[name] / 32768.0

    def codes(self, name):
        return self._channels[name]

    def __len__(self):
        return len(self.lost)


def bursts_of(curve, amplitudes=(0.9, 0.6, 0.9, 0.9)):
    rng = np.random.default_rng(SEED)
    n, found = np.arange(2500), []
    for number, amplitude in enumerate(amplitudes):
        x = amplitude * np.cos(2 * np.pi * 0.10007 * n + number)
        codes = np.round((x + curve(x) + 2.2e-5 * rng.standard_normal(len(n))) * 32768).astype(np.int32)
        found.append(raw_codes._burst(_Codes({"primary_adc_raw": codes}), "primary_adc_raw", number))
    return found


CURVES = {"cubic": lambda x: 3e-4 * x**3, "sawtooth": lambda x: 3e-4 * ((4 * x) % 1.0 - 0.5), "step": lambda x: 2e-4 * np.sign(x) * (np.abs(x) > 0.5),
          "knee": lambda x: -0.01 * np.sign(x) * np.maximum(np.abs(x) - 0.7, 0.0), "one_sided": lambda x: -0.01 * np.maximum(x - 0.75, 0.0)}


def test_a_straight_converter_has_no_curve():
    assert curve_of_codes.repeated(bursts_of(lambda x: 0.0 * x)) < 0.0


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_of_any_form_is_seen_and_its_kind_known(name):
    bursts = bursts_of(CURVES[name])
    assert curve_of_codes.repeated(bursts) > 50.0
    assert (curve_of_codes.giving_way(bursts) > 10.0) == (name in ("knee", "one_sided"))


@pytest.mark.parametrize("name", CURVES)
def test_what_is_left_beside_a_curve_is_the_noise(name):
    """0.72 LSB of noise and rounding: 2.4e-5 FS. A step's own bin is left out, so the rest is not jitter."""
    for burst in bursts_of(CURVES[name]):
        straight = curve_of_codes.straightened(burst)
        noise = 2.2e-5**2 + 2.0**-30 / 12.0
        assert straight.variance == pytest.approx(noise, rel=0.2, abs=straight.doubt)
        assert abs(straight.modulation) < 4.0 * straight.modulation_sigma


# ---- events ----------------------------------------------------------------------------------------------------------------------------


def test_instants_of_chance_swing_and_others_do_not():
    rng = np.random.default_rng(SEED)
    assert noise_events._swings(np.sin(rng.uniform(0.0, 2 * np.pi, 60)))
    assert not noise_events._swings(0.1 * rng.standard_normal(60))
    assert not noise_events._swings(np.abs(np.sin(rng.uniform(0.0, 2 * np.pi, 60))))


# ---- lines in codes ---------------------------------------------------------------------------------------------------------------


def line_of(added):
    """Evidence of a line, and the values: bursts of secondary codes with white noise and something added to it, (samples,) of a generator and a burst."""
    rng = np.random.default_rng(SEED)
    n, bursts = np.arange(2500), []
    for number in range(8):
        x = 0.2 * np.cos(2 * np.pi * 0.10007 * n + number) + 2.2e-5 * rng.standard_normal(len(n)) + added(rng, n)
        codes = np.round(x * 32768).astype(np.int32)
        bursts.append(raw_codes._burst(_Codes({"secondary_adc_raw": codes}), "secondary_adc_raw", number))
    evidence, values = {}, {}
    raw_codes._lines(bursts, SimpleNamespace(bursts=[SimpleNamespace(sample_rate_hz=5e4)]), evidence, values)
    return evidence["interference"], values


def hump(rng, n):
    """As strong as a line in all, spread over a hundredth of the sampling rate."""
    narrow = np.exp(-0.5 * ((np.fft.rfftfreq(len(n)) - 0.085) / 0.004) ** 2)
    noise = np.fft.irfft(np.fft.rfft(rng.standard_normal(len(n))) * narrow, len(n))
    return 2e-5 * noise / np.std(noise)


def test_a_line_in_codes_is_found_and_a_hump_is_none():
    score, values = line_of(lambda rng, n: 6e-6 * np.cos(2 * np.pi * 0.0871 * n + rng.uniform(0.0, 6.28)))
    assert score > 10.0
    assert dict((name, value) for name, value, _, _ in values["interference"]) == pytest.approx({"amplitude_fs": 6e-6, "frequency_hz": 4355.0}, rel=0.15)
    assert line_of(hump)[0] < 0.0
    assert line_of(lambda rng, n: 0.0)[0] < 0.0

"""The examiner's plant against other solvers and closed forms."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from wineglass.blind.generator.native import QUANTITIES, ffi, library, pointer

FS, CARRIER_HZ = 50_000.0, 5000.0
W = 2 * math.pi * CARRIER_HZ


def exam(**changes):
    """A plant with the compiled-in calibration; only its shell is used."""
    cfg = ffi.new("struct exam_cfg *")
    cfg.sample_rate_hz, cfg.carrier_hz, cfg.block_samples = FS, CARRIER_HZ, 50
    cfg.adc_bits, cfg.dac_bits, cfg.dac_latency_samples, cfg.seed, cfg.amplitude_power = 16, 16, 1, 1, 2
    cfg.quantum[0:2] = [1, 1]
    for name, value in changes.items():
        setattr(cfg, name, value)
    return library().exam_create(cfg, ffi.NULL, 0)


def quantities(**given) -> np.ndarray:
    values = np.zeros(len(QUANTITIES))
    nominal = {"stiffness_11": W**2, "stiffness_22": W**2, "damping_11": math.pi, "damping_22": math.pi, "angular_gain": 2.0,
               "drive_force_1": 1e5, "rebalance_force_2": 2e5, "sample_period": 1 / FS}
    for name, value in (nominal | given).items():
        values[QUANTITIES[name]] = value
    return values


def run(q: np.ndarray, start, dac: np.ndarray) -> np.ndarray:
    """States x1, x1'/w, x2, x2'/w after each period, (n, 4)."""
    plant, n = exam(), len(dac)
    state, dac = np.empty((n, 4)), np.ascontiguousarray(dac)
    library().exam_set_state(plant, ffi.new("double[]", list(map(float, start))))
    library().exam_shell_run(plant, pointer(q, "double"), n, pointer(dac, "double"), pointer(state, "double"))
    library().exam_destroy(plant)
    return state


def motion(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrix over (x1, v1, x2, v2) and force columns, written down once more from the equations of motion."""
    at = {name: q[index] for name, index in QUANTITIES.items()}
    rate, push = at["rate"], at["angular_gain"] * at["rate"]
    a = np.array([
        [0, 1, 0, 0],
        [-(at["stiffness_11"] - rate**2), -at["damping_11"], -at["stiffness_12"], -at["damping_12"] - push],
        [0, 0, 0, 1],
        [-at["stiffness_21"], -at["damping_21"] + push, -(at["stiffness_22"] - rate**2), -at["damping_22"]]])
    b = np.array([[0, 0], [at["drive_force_1"], at["rebalance_force_1"]], [0, 0], [at["drive_force_2"], at["rebalance_force_2"]]])
    return a, b


@pytest.fixture(params=[1, 2, 3])
def random(request):
    return np.random.default_rng(request.param)


def test_held_forces_against_dop853(random):
    """Everything coupled to everything, random forces: against an adaptive Runge-Kutta of order 8."""
    q = quantities(stiffness_11=W**2 * 1.0004, stiffness_12=3e4, stiffness_21=3e4, damping_11=40.0, damping_22=55.0, damping_12=-3.0,
                   damping_21=-3.0, rate=6.0, angular_gain=1.6, drive_force_2=2e3, rebalance_force_1=-1e3)
    dac, start = random.uniform(-1, 1, (60, 2)), random.uniform(-0.5, 0.5, 4)
    found = run(q, start, dac)
    (a, b), y, period = motion(q), start * [1, W, 1, W], 1 / FS
    for row, force in zip(found, dac, strict=True):
        y = solve_ivp(lambda t, y, force=force: a @ y + b @ force, (0, period), y, method="DOP853", rtol=1e-11, atol=1e-9).y[:, -1]
        np.testing.assert_allclose(row, y / [1, W, 1, W], rtol=0, atol=2e-9)


def test_late_forces_against_the_exact_exponential(random):
    """The force of the period before acts on until the new one arrives."""
    late_s = 7.3e-6
    q = quantities(drive_delay=late_s, rebalance_delay=0.4e-6, drive_force_2=3e3)
    dac = random.uniform(-1, 1, (40, 2))
    found, (a, b) = run(q, (0.1, 0, 0, 0.2), dac), motion(q)
    y, before = np.array([0.1, 0, 0, 0.2 * W]), np.zeros(2)
    for row, force in zip(found, dac, strict=True):
        edges = [0.0, 0.4e-6, late_s, 1 / FS]
        for begin, end in zip(edges, edges[1:], strict=False):
            u = np.array([force[0] if begin >= late_s else before[0], force[1] if begin >= 0.4e-6 else before[1]])
            whole = expm(np.block([[a, (b @ u)[:, None]], [np.zeros((1, 5))]]) * (end - begin))
            y = (whole @ np.append(y, 1.0))[:4]
        before = force
        np.testing.assert_allclose(row, y / [1, W, 1, W], rtol=0, atol=1e-12)


def test_frequency_and_q_of_free_decay():
    q_factor = 5000.0
    decay = W / (2 * q_factor)
    state = run(quantities(damping_11=2 * decay), (0.9, 0, 0, 0), np.zeros((20_000, 2)))
    z = state[:, 0] - 1j * state[:, 1]
    t = np.arange(1, len(z) + 1) / FS
    fit = np.polyfit(t, np.unwrap(np.angle(z)), 1)[0]
    assert fit / (2 * math.pi) == pytest.approx(CARRIER_HZ * math.sqrt(1 - 1 / (4 * q_factor**2)), rel=1e-10)
    assert -np.polyfit(t, np.log(np.abs(z)), 1)[0] == pytest.approx(decay, rel=1e-4)


@pytest.mark.parametrize("given, what", [
    (dict(rate=0.3), "scale factor"), (dict(damping_21=-0.4, damping_12=-0.4), "cross damping"),
    (dict(stiffness_12=2e3, stiffness_21=2e3), "quadrature"), (dict(stiffness_22=W**2 * 0.9999), "split"),
    (dict(rate=-0.2, stiffness_12=1e3, stiffness_21=1e3, stiffness_22=W**2 * 1.0001, damping_21=-0.2, damping_12=-0.2), "all"),
])
def test_steady_state_against_the_transfer_function(given, what):
    """Driven at a fixed frequency: x2/x1 = (j w (g W - c21) - k21)/(k22 - W^2 - w^2 + j w c22)."""
    q = quantities(damping_11=200.0, damping_22=200.0, **given)
    n = 15_000
    phase = 2 * math.pi * CARRIER_HZ / FS * np.arange(n)
    state = run(q, (0, 0, 0, 0), np.stack([np.cos(phase), np.zeros(n)], axis=1))[-1000:]
    turn = np.exp(-1j * phase[-1000:])
    z1, z2 = ((state[:, i] * turn).mean() for i in (0, 2))
    value = {name: q[index] for name, index in QUANTITIES.items()}
    push = 1j * W * (value["angular_gain"] * value["rate"] - value["damping_21"]) - value["stiffness_21"]
    expected = push / (value["stiffness_22"] - value["rate"] ** 2 - W**2 + 1j * W * value["damping_22"])
    assert abs(z2 / z1 - expected) < 3e-6 * max(1.0, abs(expected)) + 2e-7, what


def test_normal_numbers():
    """Moments, tails and shape against the normal distribution; channels independent."""
    n = 1_000_000
    first, second = np.empty(n), np.empty(n)
    library().exam_normals(7, 1, n, pointer(first, "double"))
    library().exam_normals(7, 2, n, pointer(second, "double"))
    assert abs(first.mean()) < 5 / math.sqrt(n) and first.var() == pytest.approx(1, abs=5 * math.sqrt(2 / n))
    assert stats.kurtosis(first) == pytest.approx(0, abs=5 * math.sqrt(24 / n))
    assert stats.kstest(first[::10], "norm").pvalue > 1e-4
    for limit in (2.0, 3.0, 3.7, 4.2):
        expected = 2 * stats.norm.sf(limit) * n
        assert abs(np.count_nonzero(np.abs(first) > limit) - expected) < 5 * math.sqrt(expected) + 1
    assert abs(np.corrcoef(first, second)[0, 1]) < 5 / math.sqrt(n)
    assert abs(np.corrcoef(first[1:], first[:-1])[0, 1]) < 5 / math.sqrt(n)


@pytest.mark.parametrize("changes", [dict(sample_rate_hz=0.0), dict(carrier_hz=30_000.0), dict(block_samples=0), dict(dac_latency_samples=127),
                                     dict(jitter_memory=1.0)])
def test_impossible_plants_are_refused(changes):
    assert exam(**changes) == ffi.NULL

"""The plant in C against scipy's DOP853 on the equations of motion as written, and its noise against scipy's Gaussian.

DOP853 (the compiled one, scipy.integrate.ode) runs in the phase plane scaled by K, at rtol 1e-12, restarted wherever a held force or a
held parameter jumps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.integrate import ode

from wineglass.native import ffi, library, pointer

RATE_HZ = 50_000.0
TOLERANCE_FS = 5e-9
K = 2 * math.pi * 5000.0
SCALE = np.array([1.0, K, 1.0, K])
"""Velocities are divided by K, so that all four numbers are amplitudes of full scale."""
Motion = Callable[[float, np.ndarray], tuple[float, float, float, float]]
BIAS = (1.0792e-3, -4.631e-5, 7.7044e-7, -5.8598e-9)


@dataclass(frozen=True)
class Plant:
    """Parameters of one case; the equations are written out from these again, not shared with the C code."""

    quality: float = 1e4
    gain: float = 2.0
    split_hz: float = 0.5
    split_axis_deg: float = 20.0
    quadrature_rad_s: float = 0.01
    slope_ppm: float = 5.0
    curvature_ppm: float = 0.02
    quality_slope: float = -0.002
    decay_mismatch: float = 0.05
    decay_axis_deg: float = 30.0
    bias_factor: float = 100.0
    drive_force: float = 1.8e5
    rebalance_force: float = 2.3e5

    def configuration(self):
        """The C structure."""
        cfg = ffi.new("struct resonator_cfg *")
        cfg.reference_degc, cfg.frequency_hz, cfg.quality_factor = 25.0, 5000.0, self.quality
        cfg.frequency_slope_ppm_per_degc, cfg.frequency_curvature_ppm_per_degc2 = self.slope_ppm, self.curvature_ppm
        cfg.quality_slope_per_degc, cfg.quality_knee_degc = self.quality_slope, 1000.0
        cfg.split_hz, cfg.split_axis_deg = self.split_hz, self.split_axis_deg
        cfg.decay_mismatch, cfg.decay_axis_deg = self.decay_mismatch, self.decay_axis_deg
        cfg.quadrature_rad_s, cfg.angular_gain = self.quadrature_rad_s, self.gain
        cfg.drive_force_fs_s2, cfg.rebalance_force_fs_s2 = self.drive_force, self.rebalance_force
        for i, value in enumerate(BIAS):
            cfg.bias_rad_s[i] = self.bias_factor * value
        return cfg

    def motion(self, degc: float, rate: Callable[[float], float], rate_dot: Callable[[float], float],
               push: tuple[float, float] = (0.0, 0.0)) -> Motion:
        """Derivative of (x1, x1'/K, x2, x2'/K) by paper eqs 1, 2 and 12; push: held accelerations. Plain numbers: it runs a million times."""
        t = degc - 25.0
        k = 2 * math.pi * 5000.0 * (1 + 1e-6 * (self.slope_ppm * t + self.curvature_ppm * t**2))
        decay = k / (self.quality * (1 + self.quality_slope * t))
        difference = self.decay_mismatch * math.cos(2 * math.radians(self.decay_axis_deg)) / 2
        damping_1, damping_2 = decay * (1 + difference), decay * (1 - difference)
        split, angle = 2 * math.pi * self.split_hz, 2 * math.radians(self.split_axis_deg)
        k1_squared, k2_squared = k * (k + split * math.cos(angle)), k * (k - split * math.cos(angle))
        k12 = k * split * math.sin(angle) + self.gain * k * self.quadrature_rad_s
        two_zeta_k = self.gain * self.bias_factor * sum(value * t**i for i, value in enumerate(BIAS))
        g, (push_1, push_2) = self.gain, push

        def derivative(time: float, y: np.ndarray) -> tuple[float, float, float, float]:
            x1, u1, x2, u2 = y.tolist()
            v1, v2 = K * u1, K * u2
            w, w_dot = rate(time), rate_dot(time)
            a1 = push_1 - damping_1 * v1 - (k1_squared - w * w) * x1 - k12 * x2 - g * w * v2 - g / 2 * w_dot * x2 + two_zeta_k * v2
            a2 = push_2 - damping_2 * v2 - (k2_squared - w * w) * x2 - k12 * x1 + g * w * v1 + g / 2 * w_dot * x1 + two_zeta_k * v1
            return v1, a1 / K, v2, a2 / K

        return derivative

    def held(self, degc: float, rate: float, rate_dot: float, push: tuple[float, float] = (0.0, 0.0)) -> Motion:
        """The same with constant rate and derivative."""
        return self.motion(degc, lambda _: rate, lambda _: rate_dot, push)


def run_c(plant: Plant, block_samples: int, state: np.ndarray, forces: np.ndarray | None = None, degc: np.ndarray | None = None,
          rate: np.ndarray | None = None, rate_dot: np.ndarray | None = None, samples: int = 0) -> np.ndarray:
    """Trajectory (samples, 4) of the C plant."""
    arrays = [None if a is None else np.ascontiguousarray(a, dtype=np.float64) for a in (degc, rate, rate_dot, forces)]
    trajectory = np.zeros((samples, 4))
    end = state.copy()
    error = library().plant_run(plant.configuration(), RATE_HZ, block_samples, samples // block_samples,
                                *(pointer(a, "double") for a in arrays), pointer(end, "double"), pointer(trajectory, "double"))
    assert error == 0
    assert np.array_equal(end, trajectory[-1])
    return trajectory


def integrate(motion: Motion, start: float, end: float, state: np.ndarray) -> np.ndarray:
    """Physical state at `end` by DOP853."""
    solver = ode(motion).set_integrator("dop853", rtol=1e-12, atol=1e-14, nsteps=10**8)
    solver.set_initial_value(state / SCALE, start)
    final = solver.integrate(end)
    assert solver.successful()
    return final * SCALE


def assert_close(c_states: np.ndarray, references: np.ndarray) -> None:
    """Displacements and velocities over k, of full scale; and something must be moving in both modes."""
    moving = np.abs(references[-1] / SCALE)
    assert moving[0] + moving[1] > 0.1 and moving[2] + moving[3] > 0.01
    worst = np.max(np.abs((c_states - references) / SCALE))
    print(f"worst difference {worst:.2e} of full scale")
    assert worst < TOLERANCE_FS


def test_free_motion_one_second_all_couplings() -> None:
    plant = Plant()
    state = np.array([0.9, 0.0, 0.0, 0.0])
    rate = math.radians(200.0)
    trajectory = run_c(plant, 50, state, rate=np.full(1000, rate), samples=50_000)
    assert_close(trajectory[-1:], integrate(plant.held(25.0, rate, 0.0), 0.0, 1.0, state)[None])


def test_temperature_and_rate_jump_every_20_ms() -> None:
    """Rate within +-200 deg/s, its derivative, temperature within -40 ... 70 degC; one second, DOP853 restarted at every jump."""
    plant = Plant(gain=1.6)
    random = np.random.default_rng(20)
    blocks = 50
    rate = np.radians(random.uniform(-200, 200, blocks))
    rate_dot = random.uniform(-500, 500, blocks)
    degc = random.uniform(-40, 70, blocks)
    state = np.array([0.9, 0.0, 0.1, 0.0])
    trajectory = run_c(plant, 1000, state, degc=degc, rate=rate, rate_dot=rate_dot, samples=50_000)
    references = []
    for i in range(blocks):
        motion = plant.held(float(degc[i]), float(rate[i]), float(rate_dot[i]))
        state = integrate(motion, i / blocks, (i + 1) / blocks, state)
        references.append(state)
    assert_close(trajectory[999::1000], np.array(references))


def test_held_forces() -> None:
    """Forces as a DAC gives them: held over five samples (a square wave near resonance, random size), 0.1 s."""
    plant = Plant(drive_force=3e6, rebalance_force=2e6)
    random = np.random.default_rng(21)
    steps, hold = 1000, 5
    levels = random.uniform(0.2, 1.0, (steps, 2)) * (-1.0) ** np.arange(steps)[:, None]
    rate = math.radians(-150.0)
    state = np.zeros(4)
    trajectory = run_c(plant, 50, state, forces=np.repeat(levels, hold, axis=0), rate=np.full(100, rate), samples=steps * hold)
    references = []
    for i, (drive, rebalance) in enumerate(levels.tolist()):
        motion = plant.held(25.0, rate, 0.0, (drive * plant.drive_force, rebalance * plant.rebalance_force))
        state = integrate(motion, i * hold / RATE_HZ, (i + 1) * hold / RATE_HZ, state)
        references.append(state)
    assert_close(trajectory[hold - 1::hold], np.array(references))


def test_rate_that_changes_all_the_time() -> None:
    """200 deg/s sine of 1 Hz with its Euler force: blocks of one sample at their middles against the continuous equations."""
    plant = Plant()
    samples = 50_000
    middle = (np.arange(samples) + 0.5) / RATE_HZ
    size, w = math.radians(200.0), 2 * math.pi
    state = np.array([0.9, 0.0, 0.0, 0.0])
    trajectory = run_c(plant, 1, state, rate=size * np.sin(w * middle), rate_dot=size * w * np.cos(w * middle), samples=samples)
    motion = plant.motion(25.0, lambda time: size * math.sin(w * time), lambda time: size * w * math.cos(w * time))
    assert_close(trajectory[-1:], integrate(motion, 0.0, 1.0, state)[None])


def noise(seed: int, stream: int, n: int) -> np.ndarray:
    values = np.empty(n)
    library().noise_fill(seed, stream, n, pointer(values, "double"))
    return values


def test_noise_is_gaussian() -> None:
    values = noise(5, 0, 2_000_000)
    assert stats.kstest(values, "norm").pvalue > 1e-4
    edges = np.concatenate([[-np.inf], stats.norm.ppf(np.linspace(0.002, 0.998, 499)), [np.inf]])
    counts, _ = np.histogram(values, edges)
    assert stats.chisquare(counts, len(values) * np.diff(stats.norm.cdf(edges))).pvalue > 1e-4


def test_noise_beyond_the_base_of_the_ziggurat() -> None:
    """The tail has its own generator: its numbers, moved onto (0, 1) by their distribution, are uniform."""
    base = 3.6541528853610088
    values = noise(6, 1, 12_000_000)
    tail = np.abs(values[np.abs(values) > base])
    expected = len(values) * 2 * stats.norm.sf(base)
    assert abs(len(tail) - expected) < 4.5 * np.sqrt(expected)
    uniform = stats.norm.sf(tail) / stats.norm.sf(base)
    assert stats.kstest(uniform, "uniform").pvalue > 1e-4
    assert abs(np.mean(-np.log(uniform)) - 1.0) < 4.5 / np.sqrt(len(tail))


def test_noise_is_white() -> None:
    values = noise(7, 0, 1 << 20)
    power = np.abs(np.fft.rfft(values))[1:-1] ** 2 / len(values)
    assert stats.kstest(power, "expon").pvalue > 1e-4


def test_noise_streams_are_independent_and_repeatable() -> None:
    assert np.array_equal(noise(8, 0, 1000), noise(8, 0, 1000))
    streams = [noise(seed, stream, 200_000) for seed in (8, 9) for stream in (0, 1, 2)]
    correlation = np.corrcoef(streams) - np.eye(6)
    assert np.max(np.abs(correlation)) < 4.5 / np.sqrt(200_000)

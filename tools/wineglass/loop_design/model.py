"""A loop of the firmware as an exact discrete system: plant, mixer and decimator, PI controller, computation slots, held force.

Everything is seen in the frame that turns with the oscillator. There the carrier stands still, a force is a complex number q + j p (quadrature
and in phase), an amplitude is one too, and plant and controller are linear with constant coefficients, sample by sample. The one thing left out is the
image at twice the carrier, on which the decimator has a double null.

One loop tick, N samples long:

    sample       0 ........ slot ........... N - 1 | 0
                 amplitude  force of this tick     | next amplitude
                 is taken   is computed, goes out with the next sample and acts `latency` samples after that

A force therefore acts on the samples slot + 1 + latency ... slot + N + latency of its tick. Amplitudes are the sum of the last 2 N - 1 samples with
triangular weights (a second-order CIC decimator).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm

Matrix = np.ndarray
_FORCES = 3  # the force of this tick and of the two before it: enough for a latency below slot + N


@dataclass(frozen=True)
class Gains:
    """PI controller at loop ticks: output = proportional error + integral; afterwards integral += error integral_per_s tick_s."""

    proportional: float
    integral_per_s: float


@dataclass(frozen=True)
class Schedule:
    """When a loop runs. latency_samples: from a sample's output to the start of its effect, pickoff delay included; -1 acts at once."""

    sample_rate_hz: float
    decimation: int
    slot: int
    latency_samples: float

    @property
    def tick_s(self) -> float:
        return self.decimation / self.sample_rate_hz

    @property
    def loop_rate_hz(self) -> float:
        return 1.0 / self.tick_s


@dataclass(frozen=True)
class Plant:
    """x' = a x + b u in the laboratory frame, measured x[0] times `turn`, seen in a frame that turns with carrier_rad_s.

    a: (n, n), b: (n,); `turn`: rotation between measured amplitude and force, sign included, that the firmware applies.
    """

    a: Matrix
    b: Matrix
    carrier_rad_s: float
    turn: complex


@dataclass(frozen=True)
class Tick:
    """z[k+1] = a z[k] + b u[k], amplitude[k] = c z[k]; u the force computed in tick k."""

    a: Matrix
    b: Matrix
    c: Matrix


@dataclass(frozen=True)
class Loop:
    """A closed loop. Frequencies in Hz, any shape, both signs: a complex loop need not be symmetrical."""

    plant: Plant
    schedule: Schedule
    gains: Gains

    @cached_property
    def tick(self) -> Tick:
        """Plant, decimator and held force over one loop tick, in the turning frame."""
        return _lifted(self.plant, self.schedule)

    def z(self, frequency_hz: np.ndarray | float) -> np.ndarray:
        return np.exp(2j * np.pi * np.asarray(frequency_hz) * self.schedule.tick_s)

    def plant_response(self, frequency_hz: np.ndarray | float) -> np.ndarray:
        """Measured amplitude, turned, per force."""
        tick, z = self.tick, self.z(frequency_hz)
        resolvent = z[..., None, None] * np.eye(len(tick.a)) - tick.a
        return self.plant.turn * (np.linalg.solve(resolvent, tick.b[:, None])[..., 0] @ tick.c)

    def controller(self, frequency_hz: np.ndarray | float) -> np.ndarray:
        """C(z) = Kp + Ki T / (z - 1)."""
        return self.gains.proportional + self.gains.integral_per_s * self.schedule.tick_s / (self.z(frequency_hz) - 1.0)

    def open_loop(self, frequency_hz: np.ndarray | float) -> np.ndarray:
        """L: the loop is stable and steady where 1 + L keeps away from zero."""
        return self.controller(frequency_hz) * self.plant_response(frequency_hz)

    def sensitivity(self, frequency_hz: np.ndarray | float) -> np.ndarray:
        """1/(1 + L): what the loop leaves of a disturbance."""
        return 1.0 / (1.0 + self.open_loop(frequency_hz))

    def complementary(self, frequency_hz: np.ndarray | float) -> np.ndarray:
        """L/(1 + L): force that answers a force of the test signal, with the opposite sign."""
        open_loop = self.open_loop(frequency_hz)
        return open_loop / (1.0 + open_loop)

    @cached_property
    def closed(self) -> Tick:
        """Closed loop; states (plant, decimator, forces, integral), input a force added to the controller's, output the controller's force."""
        tick, ki = self.tick, self.gains.integral_per_s * self.schedule.tick_s
        size = len(tick.a)
        error = -self.plant.turn * tick.c
        force = np.concatenate([self.gains.proportional * error, [1.0]])
        a = np.zeros((size + 1, size + 1), complex)
        a[:size, :size] = tick.a
        a[:size] += np.outer(tick.b, force)
        a[size, :size], a[size, size] = ki * error, 1.0
        return Tick(a, np.concatenate([tick.b, [0.0]]), force)

    @cached_property
    def poles(self) -> np.ndarray:
        """Of the closed loop, in the plane of z, one per loop tick."""
        return np.linalg.eigvals(self.closed.a)

    @property
    def stable(self) -> bool:
        return bool(np.max(np.abs(self.poles)) < 1.0)


def lag_samples(schedule: Schedule) -> float:
    """Mean delay of the loop beyond the plant: decimator N - 1, slots and latency, half of the held force, all in samples."""
    return schedule.decimation - 1 + schedule.slot + 1 + schedule.latency_samples + schedule.decimation / 2.0


def resonant_plant(frequency_hz: float, decay_per_s: float, force_fs_s2: float, carrier_hz: float, lead_samples: float,
                   sample_rate_hz: float) -> Plant:
    """x'' + 2 decay x' + k^2 x = force u. The firmware sends q + j p turned by the loop delay, and forms q + j p = -j C amplitude."""
    k, w = 2.0 * math.pi * frequency_hz, 2.0 * math.pi * carrier_hz
    a = np.array([[0.0, 1.0], [-k * k, -2.0 * decay_per_s]])
    return Plant(a, np.array([0.0, force_fs_s2]), w, 1j * np.exp(1j * w * lead_samples / sample_rate_hz))


def phase_plant(decay_per_s: float) -> Plant:
    """Phase of the primary against the oscillator [rad] per frequency step of the oscillator [rad/s]; sign of the feedback included."""
    return Plant(np.array([[-decay_per_s]]), np.array([1.0]), 0.0, 1.0 + 0.0j)


def decimator_response(schedule: Schedule, frequency_hz: np.ndarray | float) -> np.ndarray:
    """CIC of order 2, gain 1 at zero; time counts from its newest sample."""
    n = schedule.decimation
    weights = np.concatenate([np.arange(1, n + 1), np.arange(n - 1, 0, -1)]) / n**2
    angle = -2j * np.pi * np.asarray(frequency_hz)[..., None] / schedule.sample_rate_hz * np.arange(2 * n - 1)
    return np.exp(angle) @ weights


def _held(a: Matrix, b: Matrix, duration_s: float) -> tuple[Matrix, Matrix]:
    """Transition and input of x' = a x + b u over a duration with u held."""
    n = len(b)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = a, b
    whole = expm(block * duration_s)
    return whole[:n, :n], whole[:n, n]


def _lifted(plant: Plant, schedule: Schedule) -> Tick:
    """Runs unit vectors through one tick. State: (x after the tick's first sample, weighted sum carried over, its amplitude, last two forces)."""
    n = len(plant.b)
    size = n + 2 + _FORCES - 1
    columns = np.eye(size + 1, dtype=complex)  # state and, last, the force of this tick
    x, carried = columns[:n], columns[n]
    forces = [columns[size], columns[n + 2], columns[n + 3]]
    x, amplitude, carried = _advance(plant, schedule, x, carried, forces)
    after = np.vstack([x, carried, amplitude, forces[0], forces[1]])
    output = np.zeros(size, complex)
    output[n + 1] = 1.0
    return Tick(after[:, :size], after[:, size], output)


def _advance(plant: Plant, schedule: Schedule, x: Matrix, carried: Matrix, forces: list[Matrix]) -> tuple[Matrix, Matrix, Matrix]:
    """x, amplitude and what is carried over, one tick later. Samples before the DAC's instant feel the force of the sample before."""
    period = 1.0 / schedule.sample_rate_hz
    whole = math.floor(schedule.latency_samples)
    fraction = schedule.latency_samples - whole
    transition, late = _held(plant.a, plant.b, (1.0 - fraction) * period)
    early_transition, early = _held(plant.a, plant.b, fraction * period)
    transition_all, early = transition @ early_transition, transition @ early
    turn_back = np.exp(-1j * plant.carrier_rad_s * period)
    n, total, next_carried = schedule.decimation, carried.copy(), np.zeros_like(carried)
    for i in range(n):
        pushed = np.outer(late, _force_of(schedule, forces, i - whole) * turn_back**whole)
        pushed += np.outer(early, _force_of(schedule, forces, i - whole - 1) * turn_back**(whole + 1))
        x = turn_back * (transition_all @ x + pushed)
        total = total + (n - i) / n**2 * x[0]
        next_carried = next_carried + i / n**2 * x[0]
    return x, total, next_carried


def _force_of(schedule: Schedule, forces: list[Matrix], sample: int) -> Matrix:
    """The force that goes out with a sample of this tick (negative: of earlier ticks)."""
    age = -((sample - schedule.slot - 1) // schedule.decimation)
    return forces[age]

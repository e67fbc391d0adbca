"""Bode plot of the rebalance loop, measured on the full twin: by a rate of many sines at once, and by the firmware's own test force, tone by tone.

    measured = rate_response(run, calibration, FREQUENCIES_HZ)

Whole periods are read, so that neither windows nor fits are needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wineglass.calibration_block import Calibration, to_binary
from wineglass.commands_wire import CommandEncoder, Reason
from wineglass.errors import BadInput
from wineglass.scenario import Run
from wineglass.telemetry import Decoder, Frames, worst_status
from wineglass.twin import Twin
from wineglass.wire import Status

FREQUENCIES_HZ = (1.0, 2.0, 5.0, 10.0, 20.0, 33.0, 50.0, 70.0, 100.0, 130.0, 160.0, 200.0)
RATE_RAD_S = 0.15  # of each sine, or less where the device's range is small
PART_OF_RANGE = 0.5  # that all sines together, or a step, may ask for
TEST_FORCE_FS = 0.05
STEP_RAD_S = 0.5  # or less
STEP_WINDOW_S = 0.5
LOCK_S = 120.0  # longest time from cold to lock
LOCK_CHECK_S = 0.5
SETTLE_S = 1.0  # from lock to balance
QUIET_S = 0.25  # after a change of the test tone
WINDOW_S = 2.0
_PROGRESS_BLOCKS = 500

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Response:
    """frequency_hz (n,), complex gain (n,); noise: rms of one gain, from the lines between the excited ones"""

    frequency_hz: np.ndarray
    gain: np.ndarray
    noise: float


@dataclass(frozen=True)
class _Heard:
    """Per slow tick: rate output [rad/s] and in-phase force [FS], (n,)."""

    rate_rad_s: np.ndarray
    force_fs: np.ndarray


def rate_response(run: Run, calibration: Calibration, frequencies_hz: tuple[float, ...] = FREQUENCIES_HZ, progress: Progress | None = None,
                  seed: int | None = None) -> Response:
    """Rate output over true rate; time of an output: first sample of its slow tick. frequencies_hz: multiples of 1/WINDOW_S."""
    frequency = _checked(run, frequencies_hz)
    with _Bench(run, calibration, progress, seed) as bench:
        slow_hz = run.device.slow_rate_hz
        bench.settle()
        size = min(RATE_RAD_S, PART_OF_RANGE * _range_rad_s(calibration) / _crest(frequency))
        lead, count = round(0.5 * slow_hz), round(WINDOW_S * slow_hz)
        edges = (bench.twin.blocks_done + np.arange(lead + count + 1)) / slow_hz
        heard = bench.listen(0.5 * (edges[:-1] + edges[1:]), frequency, size)
    lines = _lines(heard.rate_rad_s[-count:])
    start = edges[lead]
    bins = np.round(frequency * WINDOW_S).astype(int)
    # An output stands at the first sample of its slow tick, one sample period behind the block's edge.
    moment = start + 1.0 / run.device.electronics.sample_rate_hz
    excitation = size * np.exp(1j * (_phases(len(frequency)) + 2.0 * np.pi * frequency * moment))
    return Response(frequency, lines[bins] / (excitation * _of_tangents(frequency / slow_hz)), _between(lines, bins) / size)


def _of_tangents(turns: np.ndarray) -> np.ndarray:
    """How much larger a cosine is when every block follows the tangent at its middle; turns per block."""
    return 2.0 * np.sinc(turns) - np.cos(np.pi * turns)


def test_force_response(run: Run, calibration: Calibration, frequencies_hz: tuple[float, ...] = FREQUENCIES_HZ, progress: Progress | None = None,
                        seed: int | None = None) -> Response:
    """In-phase force of the loop (mean over a slow period) over the in-phase test force added to it."""
    frequency = _checked(run, frequencies_hz)
    slow_hz, loop_hz = run.device.slow_rate_hz, calibration.loop_rate_hz
    lead, count = round(QUIET_S * slow_hz), round(WINDOW_S * slow_hz)
    gains, noise = [], []
    with _Bench(run, calibration, progress, seed) as bench:
        bench.settle()
        for tone in frequency:
            bench.send(lambda encoder, tone=tone: encoder.test_signal(TEST_FORCE_FS, 0.0, tone, loop_hz))
            heard = bench.still(QUIET_S + WINDOW_S)
            bench.send(lambda encoder: encoder.test_signal(0.0, 0.0, 0.0, loop_hz))
            bench.still(2.0 / slow_hz)
            lines, k = _lines(heard.force_fs[-count:]), round(tone * WINDOW_S)
            # The device takes a configuration over when it publishes, in the first loop tick of a slow period: the tone begins in the second.
            phase = 2.0 * np.pi * tone * (lead / slow_hz - 1.0 / loop_hz)
            gains.append(lines[k] / (TEST_FORCE_FS * np.exp(1j * phase)))
            noise.append(_between(lines, np.array([k])) / TEST_FORCE_FS)
    return Response(frequency, np.array(gains), float(np.sqrt(np.mean(np.square(noise)))))


@dataclass(frozen=True)
class StepResponse:
    """rate_rad_s: output (n,) at time_s (n,) after the step; overshoot: beyond the final value, of it; noise_rad_s: rms at rest"""

    time_s: np.ndarray
    rate_rad_s: np.ndarray
    overshoot: float
    noise_rad_s: float


def step_response(run: Run, calibration: Calibration, progress: Progress | None = None, seed: int | None = None) -> StepResponse:
    """A step of the rate. The overshoot includes what noise adds."""
    slow_hz = run.device.slow_rate_hz
    count = round(STEP_WINDOW_S * slow_hz)
    with _Bench(run, calibration, progress, seed) as bench:
        bench.settle()
        rest = bench.still(STEP_WINDOW_S).rate_rad_s
        size = min(STEP_RAD_S, PART_OF_RANGE * _range_rad_s(calibration))
        rate = bench.turn(np.full(count, size), np.zeros(count)).rate_rad_s
    step = (rate - np.mean(rest)) / (np.mean(rate[count // 2:]) - np.mean(rest))
    return StepResponse(np.arange(count) / slow_hz, rate, max(0.0, float(np.max(step)) - 1.0), float(np.std(rest)))


class _Bench:
    """A twin on a rate table, its outputs collected from telemetry."""

    def __init__(self, run: Run, calibration: Calibration, progress: Progress | None, seed: int | None):
        block = to_binary(calibration.with_changes(loop="rebalance", output_filter="none"))
        self.run, self.twin, self._progress = run, Twin(run, calibration_block=block, seed=seed), progress
        self._decoder, self._encoder, self._settled = Decoder(), CommandEncoder(), False
        self.send(lambda encoder: encoder.divisors(1, 1))

    def __enter__(self) -> _Bench:
        return self

    def __exit__(self, *unused: object) -> None:
        self.twin.close()

    def send(self, command: Callable[[CommandEncoder], bytes]) -> None:
        """Counts from the next sample on."""
        self.twin.command(command(self._encoder))
        self.twin.poll()

    def settle(self) -> None:
        """From cold until the drive loop is locked, and a while longer."""
        for _ in range(round(LOCK_S / LOCK_CHECK_S)):
            self.still(LOCK_CHECK_S)
            if self.twin.signals()["status"] & Status.LOCKED:
                break
        self.still(SETTLE_S)
        self._settled = True

    def still(self, seconds: float) -> _Heard:
        nothing = np.zeros(round(seconds * self.run.device.slow_rate_hz))
        return self.turn(nothing, nothing)

    def listen(self, middle_s: np.ndarray, frequency_hz: np.ndarray, size_rad_s: float) -> _Heard:
        """Sum of cosines: in each block the tangent at its middle."""
        angle = 2.0 * np.pi * middle_s[:, None] * frequency_hz + _phases(len(frequency_hz))
        rate = size_rad_s * np.cos(angle).sum(axis=1)
        return self.turn(rate, -size_rad_s * (2.0 * np.pi * frequency_hz * np.sin(angle)).sum(axis=1))

    def turn(self, rate: np.ndarray, slope: np.ndarray) -> _Heard:
        """Rate [rad/s] and slope [rad/s^2] of each block."""
        parts = []
        temperature = np.full(len(rate), self.run.initial_degc)
        for at in range(0, len(rate), _PROGRESS_BLOCKS):
            chosen = slice(at, at + _PROGRESS_BLOCKS)
            self.twin.step_with(rate[chosen], slope[chosen], temperature[chosen])
            parts.append(self._heard(self._decoder.feed(self.twin.telemetry())))
            if self._progress is not None:
                self._progress(len(rate[chosen]))
        heard = _Heard(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        if len(heard.rate_rad_s) != len(rate):
            raise BadInput(f"{len(rate) - len(heard.rate_rad_s)} outputs were lost", "measurement on the twin", "report this")
        return heard

    def _heard(self, frames: Frames) -> tuple[np.ndarray, np.ndarray]:
        refused = [Reason(int(ack["reason"])).name.lower() for ack in frames.ack if ack["reason"] != Reason.OK]
        if refused:
            raise BadInput(f"the firmware refuses a command ({refused[0]})", "measurement on the twin", "check the gains and the test force")
        if self._settled:
            _check_status(worst_status(frames.baseband))
        return frames.output["rate"] * 2.0**-28, frames.baseband["rebalance_in_phase"] * 2.0**-31


def _check_status(status: np.ndarray) -> None:
    for flag, wrong, text in ((Status.LOCKED, False, "the drive loop is not locked"), (Status.REBALANCE_ACTIVE, False, "the loop is not closed"),
                              (Status.REBALANCE_SATURATED, True, "the rebalance force saturates"),
                              (Status.ADC_SATURATED, True, "a converter saturates")):
        if np.any(((status & flag) != 0) == wrong):
            raise BadInput(text, "measurement on the twin", "choose a smaller bandwidth, or design with --no-measure")


def _checked(run: Run, frequencies_hz: tuple[float, ...]) -> np.ndarray:
    frequency = np.asarray(frequencies_hz, float)
    bins = frequency * WINDOW_S
    if np.any(np.abs(bins - np.round(bins)) > 1e-9) or np.any(frequency <= 0) or np.any(frequency >= 0.4 * run.device.slow_rate_hz):
        raise BadInput("a frequency does not fit", "measurement on the twin",
                       f"take multiples of {1 / WINDOW_S:g} Hz below {0.4 * run.device.slow_rate_hz:g} Hz")
    return frequency


def _range_rad_s(calibration: Calibration) -> float:
    """Rate that the largest in-phase force balances."""
    full = calibration.rebalance_scale_rad_s_per_ratio[0] / calibration.amplitude_set_point_fs
    return full * calibration.rebalance_in_phase_limit_fs


def _crest(frequency_hz: np.ndarray) -> float:
    """Highest value of the sum of unit sines."""
    time = np.arange(0.0, WINDOW_S, 0.1 / np.max(frequency_hz))
    return float(np.max(np.abs(np.cos(2.0 * np.pi * np.outer(time, frequency_hz) + _phases(len(frequency_hz))).sum(axis=1))))


def _phases(n: int) -> np.ndarray:
    """Schroeder's: a sum of n equal sines stays low."""
    return -np.pi * np.arange(n) * (np.arange(n) + 1) / n


def _lines(values: np.ndarray) -> np.ndarray:
    """Complex amplitude of every whole number of periods in the window."""
    return 2.0 * np.fft.rfft(values) / len(values)


def _between(lines: np.ndarray, excited: np.ndarray) -> float:
    """Rms of the lines that nobody excited, up to twice the highest that somebody did."""
    used = np.arange(1, min(len(lines), 2 * int(np.max(excited)) + 10))
    quiet = np.setdiff1d(used, excited)
    return float(np.sqrt(np.mean(np.abs(lines[quiet]) ** 2)))

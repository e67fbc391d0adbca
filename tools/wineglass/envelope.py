"""The fast twin: means over frames, as telemetry would send them without noise, tens of thousands of times faster than real time.

    run = scenario.prepare(scenario.load("rate-steps"))
    with Envelope(run, effects=[Setting("frequency_split", {"split_hz": 0.05})]) as envelope:
        frames = envelope.run()
    frames["rate"], frames.end_s

Takes the same device, scenario, calibration block and commands as `wineglass.twin`; docs/NUMBERS.md says how far the two are apart.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np

from wineglass import effects as catalogue
from wineglass import twin
from wineglass.calibration_block import COMPENSATIONS, LOOPS, OUTPUT_FILTERS
from wineglass.effects import Setting
from wineglass.errors import BadInput
from wineglass.native import ffi, library, pointer
from wineglass.scenario import Run

LONGEST_STEP_S = 0.02
CHANNELS = tuple(name for name, _ in ffi.typeof("struct envelope_record").fields)
"""Names and units as in a recording: FS, Hz, degC, rad/s."""


@dataclass(frozen=True)
class Event:
    """A command that reaches the device at time_s: amplitude (FS), compensation, loop, output_filter (names), test_signal (in phase FS, quadrature
    FS, tone Hz), phase_set_point (rad), pll_gains (1/s, 1/s^2), agc_gains (FS/FS, FS/FS/s), rebalance (FS/FS, FS/FS/s, limits FS)."""

    time_s: float
    command: str
    values: tuple[float | str, ...]


@dataclass(frozen=True)
class Inputs:
    """What happens to the device, per step, (n,) each: rate mean over the step and at its end [rad/s], chamber (or imposed shell)
    temperature at its end [degC]."""

    rate_mean_rad_s: np.ndarray
    rate_end_rad_s: np.ndarray
    chamber_degc: np.ndarray

    def __len__(self) -> int:
        return len(self.rate_mean_rad_s)


@dataclass(frozen=True)
class Frames:
    """Means over frames: channels[name] (n,), and the time [s since power-up] at which each frame ends."""

    end_s: np.ndarray
    channels: dict[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.channels[name]


class Envelope:
    """Envelope twin of a scenario. `run` starts from power-up, every time."""

    def __init__(self, run: Run, *, calibration_block: bytes | None = None, frame_ticks: int | None = None, step_ticks: int | None = None,
                 effects: Iterable[Setting] = (), settled: bool = False, seed: int | None = None):
        """frame_ticks: slow ticks per frame, None: the scenario's output rate. step_ticks: per step, None: the longest divisor of a frame up to 20 ms.
        settled: begin in the steady state instead of with a cold start."""
        self.scenario_run = run
        self.frame_ticks = run.divisor(run.scenario.recording.output_hz) if frame_ticks is None else frame_ticks
        self.step_ticks = _step_ticks(self.frame_ticks, run.device.slow_rate_hz) if step_ticks is None else step_ticks
        if self.frame_ticks < 1 or self.step_ticks < 1 or self.frame_ticks % self.step_ticks:
            raise BadInput(f"a frame of {self.frame_ticks} slow ticks is not a whole number of steps of {self.step_ticks}", "envelope twin",
                           "choose frames of one slow tick or more and a divisor of them")
        self.calibration_block = twin.block_for(run) if calibration_block is None else calibration_block
        self._envelope = ffi.NULL
        self._create(run, list(effects), settled, run.scenario.seed if seed is None else seed)

    def _create(self, run: Run, effects: list[Setting], settled: bool, seed: int) -> None:
        settings = catalogue.settings(effects)
        block, error = self.calibration_block, ffi.new("int32_t *")
        cfg = ffi.new("struct envelope_cfg *", {"step_ticks": self.step_ticks, "frame_steps": self.frame_ticks // self.step_ticks,
                                                "start": int(settled), "n_effects": len(effects), "effects": settings})
        self._envelope = library().envelope_create(twin.configuration(run, seed), cfg, ffi.from_buffer(block) if block else ffi.NULL,
                                                   len(block), error)
        if self._envelope == ffi.NULL:
            raise twin.refusal(run, int(error[0]), block)

    @property
    def frame_s(self) -> float:
        return self.frame_ticks / self.scenario_run.device.slow_rate_hz

    def end_sample(self, frame: int) -> int:
        """Sample counter at the end of a frame, as in telemetry."""
        return int(library().envelope_end_sample(self._open(), (frame + 1) * self.frame_ticks // self.step_ticks - 1))

    def inputs(self, n_frames: int | None = None) -> Inputs:
        """The scenario's inputs; None: all whole frames of its duration."""
        run = self.scenario_run
        slow_s = 1.0 / run.device.slow_rate_hz
        frames = int(run.n_blocks // self.frame_ticks) if n_frames is None else n_frames
        ticks, steps = frames * self.frame_ticks, frames * self.frame_ticks // self.step_ticks
        start_s = self.end_sample(0) / run.device.electronics.sample_rate_hz - self.frame_ticks * slow_s
        middles = start_s + (np.arange(ticks) + 0.5) * slow_s
        ends = start_s + np.arange(1, steps + 1) * self.step_ticks * slow_s
        rate = run.scenario.rate
        return Inputs(rate.at(middles).reshape(steps, self.step_ticks).mean(axis=1), np.ascontiguousarray(rate.at(ends), float),
                      np.ascontiguousarray(run.scenario.temperature.at(ends), float))

    def run(self, events: Sequence[Event] = (), inputs: Inputs | None = None) -> Frames:
        """From power-up through the inputs (None: the scenario's)."""
        inputs = self.inputs() if inputs is None else inputs
        columns = [np.ascontiguousarray(values, np.float64) for values in (inputs.rate_mean_rad_s, inputs.rate_end_rad_s, inputs.chamber_degc)]
        n_frames = len(inputs) * self.step_ticks // self.frame_ticks
        listed = ffi.new("struct envelope_event[]", [_event(event) for event in sorted(events, key=lambda event: event.time_s)])
        profile = ffi.new("struct envelope_profile *", [len(inputs), *(pointer(values, "double") for values in columns), len(listed), listed])
        channels = {name: np.empty(n_frames) for name in CHANNELS}
        record = ffi.new("struct envelope_record *", [pointer(values, "double") for values in channels.values()])
        library().envelope_reset(self._open())
        result = library().envelope_run(self._envelope, profile, record)
        if result != 0:
            raise twin.refusal(self.scenario_run, int(result), self.calibration_block)
        rate_hz = self.scenario_run.device.electronics.sample_rate_hz
        return Frames((self.end_sample(0) / rate_hz) + np.arange(n_frames) * self.frame_s, channels)

    @property
    def single_ticks(self) -> int:
        """Slow ticks of the last run that were done one by one."""
        return int(library().envelope_single_ticks(self._open()))

    def close(self) -> None:
        if self._envelope != ffi.NULL:
            library().envelope_destroy(self._envelope)
            self._envelope = ffi.NULL

    def __enter__(self) -> Envelope:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __del__(self) -> None:
        if getattr(self, "_envelope", ffi.NULL) != ffi.NULL:
            self.close()

    def _open(self) -> Any:
        if self._envelope == ffi.NULL:
            raise ValueError("the envelope twin is closed")
        return self._envelope


def _step_ticks(frame_ticks: int, slow_rate_hz: float) -> int:
    longest = max(1, math.floor(LONGEST_STEP_S * slow_rate_hz + 1e-9))
    return next(ticks for ticks in range(min(longest, max(frame_ticks, 1)), 0, -1) if frame_ticks % ticks == 0)


_COMMANDS = ("amplitude", "compensation", "loop", "test_signal", "phase_set_point", "pll_gains", "agc_gains", "rebalance", "output_filter")
_CHOICES = {"compensation": COMPENSATIONS, "loop": LOOPS, "output_filter": OUTPUT_FILTERS}


def _event(event: Event) -> tuple[float, int, int, list[float]]:
    if event.command not in _COMMANDS:
        raise BadInput(f"the command '{event.command}' is unknown", "envelope twin", f"choose one of {', '.join(_COMMANDS)}")
    choices: tuple[str, ...] = _CHOICES.get(event.command, ())
    unknown = [value for value in event.values if isinstance(value, str) and value not in choices]
    if unknown:
        raise BadInput(f"'{unknown[0]}' is no {event.command}", "envelope twin", f"choose one of {', '.join(choices)}")
    numbers = [float(choices.index(value)) if isinstance(value, str) else float(value) for value in event.values]
    return event.time_s, _COMMANDS.index(event.command), 0, numbers + [0.0] * (4 - len(numbers))

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
from wineglass import schedule, twin
from wineglass.calibration_block import COMPENSATIONS, LOOPS, OUTPUT_FILTERS
from wineglass.effects import Setting
from wineglass.errors import BadInput
from wineglass.native import ffi, library, pointer
from wineglass.scenario import Run
from wineglass.schedule import Command

LONGEST_STEP_S = 0.02
CHANNELS = tuple(name for name, _ in ffi.typeof("struct envelope_record").fields)
"""Names and units as in a recording: FS, Hz, degC, rad/s."""


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
                 effects: Iterable[Setting] = (), settled: bool = False, seed: int | None = None,
                 most_single_ticks: int = 0):
        """frame_ticks: slow ticks per frame, None: the scenario's output rate. step_ticks: per step, None: the longest divisor of a frame up to 20 ms.
        effects: beside those of the device. settled: begin in the steady state instead of with a cold start. most_single_ticks: a run
        that needs more slow ticks one by one is refused; 0: any number."""
        self.scenario_run = run
        self.frame_ticks = run.divisor(run.scenario.recording.output_hz) if frame_ticks is None else frame_ticks
        self.step_ticks = _step_ticks(self.frame_ticks, run.device.slow_rate_hz) if step_ticks is None else step_ticks
        if self.frame_ticks < 1 or self.step_ticks < 1 or self.frame_ticks % self.step_ticks:
            raise BadInput(f"a frame of {self.frame_ticks} slow ticks is not a whole number of steps of {self.step_ticks}", "envelope twin",
                           "choose frames of one slow tick or more and a divisor of them")
        self.calibration_block = twin.block_for(run) if calibration_block is None else calibration_block
        self._envelope = ffi.NULL
        self._most_single_ticks = most_single_ticks
        self._create(run, [*run.truth.effects, *effects], settled, run.scenario.seed if seed is None else seed)

    def _create(self, run: Run, effects: list[Setting], settled: bool, seed: int) -> None:
        settings = catalogue.settings(effects)
        block, error = self.calibration_block, ffi.new("int32_t *")
        cfg = ffi.new("struct envelope_cfg *", {"step_ticks": self.step_ticks, "frame_steps": self.frame_ticks // self.step_ticks,
                                                "start": int(settled), "n_effects": len(effects), "effects": settings, "most_single_ticks": self._most_single_ticks})
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
        start_s = (self.end_sample(0) - 1) / run.device.electronics.sample_rate_hz - self.frame_ticks * slow_s  # as Run.block_times_s
        middles = start_s + (np.arange(ticks) + 0.5) * slow_s
        ends = start_s + np.arange(1, steps + 1) * self.step_ticks * slow_s
        rate = run.scenario.rate
        return Inputs(rate.at(middles).reshape(steps, self.step_ticks).mean(axis=1), np.ascontiguousarray(rate.at(ends), float),
                      np.ascontiguousarray(run.scenario.temperature.at(ends), float))

    def run(self, inputs: Inputs | None = None, commands: Sequence[Command] | None = None) -> Frames:
        """From power-up through inputs and commands (None: the scenario's)."""
        inputs = self.inputs() if inputs is None else inputs
        commands = self.scenario_run.scenario.command if commands is None else commands
        columns = [np.ascontiguousarray(values, np.float64) for values in (inputs.rate_mean_rad_s, inputs.rate_end_rad_s, inputs.chamber_degc)]
        n_frames = len(inputs) * self.step_ticks // self.frame_ticks
        events = self._events(commands)
        profile = ffi.new("struct envelope_profile *", [len(inputs), *(pointer(values, "double") for values in columns), len(events), events])
        channels = {name: np.empty(n_frames) for name in CHANNELS}
        record = ffi.new("struct envelope_record *", [pointer(values, "double") for values in channels.values()])
        library().envelope_reset(self._open())
        result = library().envelope_run(self._envelope, profile, record)
        if result != 0:
            raise twin.refusal(self.scenario_run, int(result), self.calibration_block)
        rate_hz = self.scenario_run.device.electronics.sample_rate_hz
        return Frames((self.end_sample(0) / rate_hz) + np.arange(n_frames) * self.frame_s, channels)

    def _events(self, commands: Sequence[Command]) -> Any:
        """struct envelope_event[]. Like the simulation, which sends commands between slow periods."""
        rate_hz = self.scenario_run.device.slow_rate_hz
        timed = sorted((round(command.at_s * rate_hz) / rate_hz, order, command) for order, command in enumerate(commands)
                       if not isinstance(command, schedule.SyncPulse))
        return ffi.new("struct envelope_event[]", [(time_s, *_event(command)) for time_s, _, command in timed])

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


_ORDER = ("amplitude", "compensation", "loop", "test_signal", "phase_set_point", "pll_gains", "agc_gains", "rebalance", "output_filter", "drive")
"""enum envelope_command"""


def _event(command: Command) -> tuple[int, int, list[float]]:
    """Number, 0 and values of struct envelope_event."""
    values = _values(command)
    return _ORDER.index(command.kind), 0, [*values, *[0.0] * (4 - len(values))]


def _values(command: Command) -> list[float]:
    match command:
        case schedule.AmplitudeCommand():
            return [command.set_point_fs]
        case schedule.CompensationCommand():
            return [COMPENSATIONS.index(command.mode)]
        case schedule.LoopCommand():
            return [LOOPS.index(command.mode)]
        case schedule.TestSignalCommand():
            return [command.in_phase_fs, command.quadrature_fs, command.frequency_hz]
        case schedule.PhaseSetPointCommand():
            return [math.radians(command.phase_deg)]
        case schedule.DriveCommand():
            return [float(command.on)]
        case schedule.RebalanceCommand():
            return [command.kp, command.ki_per_s, command.in_phase_limit_fs, command.quadrature_limit_fs]
        case schedule.OutputFilterCommand():
            return [OUTPUT_FILTERS.index(command.corner)]
    raise BadInput(f"the envelope twin has no command '{command.kind}'", f"command at {command.at_s:g} s", "leave it out, or use the full twin")

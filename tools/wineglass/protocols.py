"""Bench protocols: what a bench day does to a device, in times and sizes that follow the device. One file serves twin and bench.

    run = scenario.prepare(protocols.scenario("full", device="metal-fast", loop="rebalance", seed=3))
    protocols.segments(run.scenario)

A protocol is a list of segments, one after the other. Times are in the device's own units: segments in its thermal unit (`thermal.protocol_unit`
of the shell's time constant), ring-downs and frequencies in the resonator's decay. Sizes are parts: temperatures of the way from T0 to the
ends of the device's range, rates of what the loop in use can follow, amplitudes of the set-point."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from wineglass import device as devices
from wineglass import nominal, paths, schedule, toml_text
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.fields import Section, quantity, validate
from wineglass.profiles import ChirpRate, ConstantRate, StepRate, SumRate, TableTemperature
from wineglass.scenario import Burst, Mode, Recording, Scenario, Segment

FOLDER = paths.repository_root() / "protocols"
Loop = Literal["open", "rebalance"]
DEVICE = "metal-fast"

UNIT_WITHOUT_SHELL_S = 60.0
OPEN_LOOP_RATIO = 0.25  # of secondary over primary amplitude: where the open loop is still linear and far from the converters' ends
REBALANCE_SHARE = 0.5  # of the force's limit: leaves room for quadrature, gain errors and the test force
EDGE_S = 0.1
OUTPUT_FILTER = 0.05  # corner, of the slow tick's rate
DRIVE_OFF_AT = 0.25  # part of a ring-down's segment
CHIRP_FROM, CHIRP_TO = 0.2, 4.0  # half bandwidths of the resonator
CHIRP_CYCLES = 1.5, 6.0  # at least so many per segment at the chirp's first and last frequency
CHIRP_POINTS = 50  # a cycle, in a table's profile
TONE_CYCLES = 3.0  # at least so many per step of the test signal


class TestForce(Section):
    """One step of the test signal; nothing given: off."""

    __test__ = False  # no test class, whatever its name begins with

    in_phase: float = quantity(0.0, "FS", "part that acts like a rate, of rebalance DAC full scale", ge=-0.5, le=0.5)
    quadrature: float = quantity(0.0, "FS", "part that acts like quadrature", ge=-0.5, le=0.5)
    tone: float = quantity(0.0, "half bandwidth", "frequency of a tone about the carrier; 0: a constant", ge=0, le=100)


class ProtocolSegment(Section):
    """One stretch; what is not given rests. Lists share the segment in equal steps and end in the state of rest (zero rate, force off)."""

    name: str = quantity(..., "", "what it is called", min_length=1)
    lasts: float = quantity(..., "thermal unit", "its length", gt=0, le=1000)
    at_least: float = quantity(0.0, "decay time", "but no shorter than this, of the resonator", ge=0, le=100)
    temperature: float | None = quantity(None, "1", "at its end, of the way from T0 to the range's ends; left out: held", ge=-1, le=1)
    rate_steps: list[float] = quantity([], "1", "rates, of the loop's range")
    rate_chirp: float = quantity(0.0, "1", "amplitude of a sine of rising frequency, of the loop's range", ge=0, le=1)
    amplitude: list[float] = quantity([], "1", "set-points of the primary amplitude, of the device's own; the last one stays")
    drive_off: float = quantity(0.0, "decay time", "how long the drive is off, after a quarter of the segment", ge=0, le=5)
    open_loop: bool = quantity(False, "", "the rebalance loop is open meanwhile")
    test_signal: list[TestForce] = quantity([], "", "forces on the sense axis")
    bursts: list[float] = quantity([], "1", "when raw codes are recorded, parts of the segment")
    check: str = quantity("", "", "what the person at the bench looks at")

    @model_validator(mode="after")
    def _sound(self) -> ProtocolSegment:
        if self.rate_steps and self.rate_chirp:
            raise ValueError("rate_steps and rate_chirp exclude each other")
        if any(abs(value) > 1 for value in self.rate_steps):
            raise ValueError("rate_steps are parts of the range, -1 to 1")
        if any(not 0.1 <= value <= 1.05 for value in self.amplitude):
            raise ValueError("amplitude is a part of the set-point, 0.1 to 1.05")
        if any(not 0 <= value < 1 for value in self.bursts):
            raise ValueError("bursts are parts of the segment, 0 to 1")
        return self


class Protocol(Section):
    """One bench day."""

    name: str = quantity("", "", "the file's name")
    description: str = quantity("", "", "what it is for")
    record_hz: float = quantity(50.0, "Hz", "frames of baseband, output and reference", gt=0)
    burst_samples: int = quantity(2500, "sample", "length of each raw burst", ge=1, le=100_000)
    segment: list[ProtocolSegment] = quantity(..., "", "one after the other", min_length=1)

    @property
    def units(self) -> float:
        """Its length in thermal units."""
        return sum(segment.lasts for segment in self.segment)


@dataclass(frozen=True)
class Placed:
    """A segment of a protocol on a device: times in s, temperatures in degC at its start and end."""

    segment: ProtocolSegment
    begin_s: float
    end_s: float
    from_degc: float
    to_degc: float

    @property
    def length_s(self) -> float:
        return self.end_s - self.begin_s

    @property
    def speed_degc_per_min(self) -> float:
        return (self.to_degc - self.from_degc) / self.length_s * 60.0

    def at(self, part: float) -> float:
        """Time [s] at a part of the segment."""
        return self.begin_s + part * self.length_s

    def shares(self, count: int) -> list[float]:
        """Starts [s] of `count` equal steps."""
        return [self.at(i / count) for i in range(count)]


def names() -> list[str]:
    """Names of the protocols that ship."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load(name_or_path: str | Path) -> Protocol:
    """A shipped protocol by its name, or one by its path."""
    text = str(name_or_path)
    path = Path(text) if text.endswith(".toml") else FOLDER / f"{text}.toml"
    if not path.is_file():
        raise BadInput("no such protocol", text, f"choose one of {', '.join(names())}, or give the path of a .toml file")
    protocol: Protocol = validate(Protocol, {"name": path.stem, **toml_text.read(path)}, str(path))
    return protocol


def unit_s(device: Device) -> float:
    """The thermal unit [s] in which segments are measured."""
    return device.thermal.protocol_unit * (device.thermal.shell_time_constant_s or UNIT_WITHOUT_SHELL_S)


def rate_range_rad_s(device: Device, loop: Loop) -> float:
    """Rate [rad/s] that a protocol's 1 stands for: what the loop follows linearly over the whole range of temperatures."""
    shift = np.linspace(*device.calibration_range_degc(), 101) - device.resonator.reference_temperature_degc
    if loop == "open":
        return OPEN_LOOP_RATIO * float(np.min(np.polynomial.polynomial.polyval(shift, nominal.scale_fit(device).coefficients)))
    scale = float(np.min(np.polynomial.polynomial.polyval(shift, nominal.rebalance_scale_fit(device).coefficients)))
    return REBALANCE_SHARE * scale * device.firmware.rebalance_in_phase_limit_fs / device.firmware.amplitude_fs


def half_bandwidth_hz(device: Device) -> float:
    """Of the resonator at T0: what the open loop follows."""
    return 1.0 / (2.0 * math.pi * decay_s(device))


def decay_s(device: Device) -> float:
    """The resonator's decay time at T0."""
    return 1.0 / float(device.resonator.decay_rate_at(device.resonator.reference_temperature_degc))


def temperature_degc(device: Device, part: float) -> float:
    """Temperature [degC] at a part of the way from T0 to the end of the device's range."""
    middle = device.resonator.reference_temperature_degc
    low, high = device.calibration_range_degc()
    return middle + part * (high - middle if part > 0 else middle - low)


def placed(protocol: Protocol, device: Device) -> list[Placed]:
    """The protocol's segments at their times and temperatures."""
    unit, decay, begin, part, found = unit_s(device), decay_s(device), 0.0, 0.0, []
    for segment in protocol.segment:
        before, part = part, part if segment.temperature is None else segment.temperature
        end = begin + max(segment.lasts * unit, segment.at_least * decay)
        found.append(Placed(segment, begin, end, temperature_degc(device, before), temperature_degc(device, part)))
        begin = end
    return found


def scenario(name: str | Path | Protocol, device: str | Device = DEVICE, loop: Loop = "open", seed: int = 1, **changes: Any) -> Scenario:
    """The protocol as a scenario for both twins. changes: fields by dotted name, as in `Scenario.changed`:
    scenario("full", **{"plant.override": {"resonator.split_hz": 0.03}})."""
    protocol = name if isinstance(name, Protocol) else load(name)
    described = device if isinstance(device, Device) else devices.load(device)
    parts = placed(protocol, described)
    record_hz = _record_hz(protocol, described)
    made = Scenario(
        name=protocol.name, description=protocol.description, device=_named(device),
        duration_s=parts[-1].end_s, seed=seed, temperature=_temperature(parts), rate=_rate(parts, described, loop),
        mode=Mode(loop=loop, output_filter_hz=OUTPUT_FILTER * described.slow_rate_hz),
        recording=Recording(baseband_hz=record_hz, output_hz=record_hz, reference_hz=record_hz,
                            bursts=[Burst(time_s=part.at(at), samples=protocol.burst_samples) for part in parts for at in part.segment.bursts]),
        segment=[Segment(name=part.segment.name, begin_s=part.begin_s, end_s=part.end_s, what=describe(part, described, loop)) for part in parts],
        command=[command for part in parts for command in commands(part, described, loop) if command.at_s < parts[-1].end_s],
    )
    return made.changed(changes, f"protocol {protocol.name}")


def segments(scenario_or_protocol: Scenario | Protocol | str, device: str | Device = DEVICE, loop: Loop = "open") -> list[Segment]:
    """Named segments with start, end and what happens; device and loop matter only for a protocol."""
    if isinstance(scenario_or_protocol, Scenario):
        return list(scenario_or_protocol.segment)
    return list(scenario(scenario_or_protocol, device, loop).segment)


def profile(run: Scenario) -> np.ndarray:
    """What chamber and table play, straight lines between rows: (n, 3) of time [s], chamber [degC], rate [deg/s]. A chirp has CHIRP_POINTS rows
    in its shortest cycle."""
    rates = run.rate.parts if isinstance(run.rate, SumRate) else [run.rate]
    times = [np.array([0.0, run.duration_s]), np.array(run.temperature.boundaries_s), *(np.array(rate.boundaries_s) for rate in rates)]
    for rate in rates:
        if isinstance(rate, ChirpRate):
            count = math.ceil(rate.duration_s * max(rate.start_hz, rate.end_hz) * CHIRP_POINTS)
            times.append(rate.begin_s + rate.duration_s * np.arange(count + 1) / count)
    rows = np.unique(np.round(np.concatenate(times), 6))
    rows = rows[rows <= run.duration_s]
    return np.column_stack([rows, run.temperature.at(rows), np.degrees(run.rate.at(rows))])


def _named(device: str | Device) -> str:
    """As a scenario names it: a file by its whole path, so that the scenario may be written anywhere."""
    if isinstance(device, Device):
        return device.name
    return str(devices.find(device).resolve()) if device.endswith(".toml") else device


def cut(run: Scenario, duration_s: float) -> Scenario:
    """The beginning of a run; what comes later is left out."""
    bursts = [burst for burst in run.recording.bursts if burst.time_s < duration_s]
    commands = [command for command in run.command if command.at_s < duration_s]
    segments = [segment.model_copy(update={"end_s": min(segment.end_s, duration_s)}) for segment in run.segment if segment.begin_s < duration_s]
    recording = run.recording.model_copy(update={"bursts": bursts})
    return run.model_copy(update={"duration_s": min(duration_s, run.duration_s), "recording": recording, "command": commands, "segment": segments})


def _record_hz(protocol: Protocol, device: Device) -> float:
    """The nearest rate that the device can send: its slow rate over a whole number."""
    return device.slow_rate_hz / max(1, round(device.slow_rate_hz / protocol.record_hz))


# --- what a segment does ---------------------------------------------------------------------------------------------


def _temperature(parts: list[Placed]) -> TableTemperature:
    times, values = [0.0], [parts[0].from_degc]
    for part in parts:
        times.append(part.end_s)
        values.append(part.to_degc)
    return TableTemperature(times_s=times, values_degc=values)


def _rate(parts: list[Placed], device: Device, loop: Loop) -> ConstantRate | SumRate:
    full = math.degrees(rate_range_rad_s(device, loop))
    profiles = [_steps(parts, full), *(chirp(part, device, full) for part in parts if part.segment.rate_chirp)]
    given = [profile for profile in profiles if profile is not None]
    return SumRate(parts=given) if given else ConstantRate()


def _steps(parts: list[Placed], full_deg_s: float) -> StepRate | None:
    times, values = [], []
    for part in parts:
        rates = part.segment.rate_steps
        wanted = [*zip(part.shares(len(rates)), rates, strict=True), *([(part.end_s, 0.0)] if rates else [])]
        for time_s, rate in wanted:
            if rate * full_deg_s != (values[-1] if values else 0.0):
                times.append(time_s)
                values.append(rate * full_deg_s)
    return StepRate(times_s=times, values_deg_s=values, edge_s=EDGE_S) if times else None


def chirp(part: Placed, device: Device, full_deg_s: float) -> ChirpRate:
    """From below to well above the resonator's half bandwidth, in a whole number of cycles so that the table ends at rest."""
    half, length = half_bandwidth_hz(device), part.length_s
    low = max(CHIRP_FROM * half, CHIRP_CYCLES[0] / length)
    high = max(CHIRP_TO * half, CHIRP_CYCLES[1] / length)
    cycles = math.ceil(0.5 * (low + high) * length)
    return ChirpRate(amplitude_deg_s=part.segment.rate_chirp * full_deg_s, start_hz=low, end_hz=2.0 * cycles / length - low,
                     begin_s=part.begin_s, duration_s=length)


def commands(part: Placed, device: Device, loop: Loop) -> Iterator[schedule.AnyCommand]:
    """What is asked of the device during a segment."""
    segment = part.segment
    for time_s, wanted in zip(part.shares(len(segment.amplitude)), segment.amplitude, strict=True):
        yield schedule.AmplitudeCommand(at_s=time_s, set_point_fs=round(wanted * device.firmware.amplitude_fs, 6))
    if segment.open_loop and loop == "rebalance":
        yield schedule.LoopCommand(at_s=part.begin_s, mode="open")
        yield schedule.LoopCommand(at_s=part.end_s, mode="rebalance")
    if segment.drive_off:
        off_s = part.at(DRIVE_OFF_AT)
        yield schedule.DriveCommand(at_s=off_s, on=False)
        yield schedule.DriveCommand(at_s=off_s + drive_off_s(part, device), on=True)
    for time_s, force in zip(part.shares(len(segment.test_signal)), segment.test_signal, strict=True):
        yield schedule.TestSignalCommand(at_s=time_s, in_phase_fs=force.in_phase, quadrature_fs=force.quadrature,
                                         frequency_hz=tone_hz(part, force, device))
    if segment.test_signal and segment.test_signal[-1] != TestForce():
        yield schedule.TestSignalCommand(at_s=part.end_s)


def tone_hz(part: Placed, force: TestForce, device: Device) -> float:
    """A few cycles fit in the step even where the resonator is slow."""
    least = TONE_CYCLES * len(part.segment.test_signal) / part.length_s
    return max(force.tone * half_bandwidth_hz(device), least) if force.tone else 0.0


def describe(part: Placed, device: Device, loop: Loop) -> str:
    """One line for a person."""
    return "; ".join(filter(None, (chamber_text(part), table_text(part, device, loop), device_text(part, device, loop)))) or "rest"


def chamber_text(part: Placed) -> str:
    """What the chamber does; nothing where it holds."""
    if part.to_degc == part.from_degc:
        return ""
    return f"ramp {part.from_degc:.1f} to {part.to_degc:.1f} degC at {part.speed_degc_per_min:+.3g} degC/min"


def table_text(part: Placed, device: Device, loop: Loop) -> str:
    """What the rate table does; nothing where it rests."""
    segment, full = part.segment, math.degrees(rate_range_rad_s(device, loop))
    if segment.rate_steps:
        step = f"every {part.length_s / len(segment.rate_steps):.3g} s" if len(segment.rate_steps) > 1 else "throughout"
        return f"rate {', '.join(f'{rate * full:.3g}' for rate in segment.rate_steps)} deg/s, {step}"
    if segment.rate_chirp:
        sweep = chirp(part, device, full)
        return f"rate sine of {sweep.amplitude_deg_s:.3g} deg/s, {sweep.start_hz:.3g} to {sweep.end_hz:.3g} Hz"
    return ""


def device_text(part: Placed, device: Device, loop: Loop) -> str:
    """What is asked of the device."""
    segment, told = part.segment, []
    if segment.open_loop and loop == "rebalance":
        told.append("loop open")
    if segment.amplitude:
        told.append("amplitude " + ", ".join(f"{wanted * device.firmware.amplitude_fs:.3g}" for wanted in segment.amplitude) + " FS")
    if segment.drive_off:
        told.append(f"drive off for {drive_off_s(part, device):.3g} s")
    if segment.test_signal:
        told.append("test force " + ", ".join(_force(part, force, device) for force in segment.test_signal))
    return "; ".join(told)


def _force(part: Placed, force: TestForce, device: Device) -> str:
    parts = [f"{name} {value:g} FS" for name, value in (("in phase", force.in_phase), ("quadrature", force.quadrature)) if value]
    tone = f" at {tone_hz(part, force, device):.3g} Hz" if force.tone else ""
    return (" and ".join(parts) + tone) if parts else "none"


def drive_off_s(part: Placed, device: Device) -> float:
    """Ring-downs follow the resonator, but end well before their segment does."""
    return min(part.segment.drive_off * decay_s(device), 0.5 * part.length_s)

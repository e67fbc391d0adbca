"""What a described device would put out over the recorded inputs: the nominal twin of recordings that hold the output but no baseband.

    expected = expect(recording, device, "rate_uncompensated", time_s)

Everything is the envelope twin's: the output itself, what one standard deviation of every uncertain value does to it, and what the effects of the catalogue
do that show in an output which is driven so. Slow content only; samples that a command disturbed are masked.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from wineglass import effects
from wineglass.calibration.lag import Lag
from wineglass.device import Device
from wineglass.diagnosis import drive
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.unit import Unit
from wineglass.effects import Setting
from wineglass.envelope import Envelope
from wineglass.errors import BadInput
from wineglass.recording import Recording
from wineglass.scenario import Run

OWN_FORMS = ("ageing",)
"""columns.py has more shapes of it than the twin."""
NOISE_LIKE = ("excess_noise", "flicker_noise", "clock_jitter", "interference", "dropped_samples", "adc_saturation", "thermometer_quantisation")
OF_THE_THERMOMETER = ("thermometer_lag", "thermometer_error")
AXES_DEG = (0.0, 45.0)
HALF_WIDTHS_DEGC = (2.0, 5.0, 12.0, 25.0)
LAGS = 24  # time constants tried, of the thermometer
UNIT_ROUNDS, UNIT_BLOCKS = 3, 400
EXPLAINED, UNLIKELY = 2.0, 2.9  # times the noise of a block's mean that a unit may leave which explains the recording; standard deviations
SURE = 10.0  # times the least squares that the best lag leaves: another one leaves more than that, or there is none
REACH = 10.0  # of an effect's typical size: what it may have at most, and half as much again is no surprise
NUDGE = 0.1  # standard deviations
GAIN = "resonator.angular_gain"
SETTLED_DECAYS = 8.0
LONGEST_SETTLING = 0.02  # of the record: the twin follows what is slower
LOCK_S = 1.0


@dataclass(frozen=True)
class Strength:
    """One strength of an effect: its name, unit and the size that its response (n,) belongs to."""

    name: str
    unit: str
    size: float
    response: np.ndarray


@dataclass(frozen=True)
class Expected:
    """rate (n,) [rad/s]; uncertain (n, k): per standard deviation; shown: effect -> shapes of its strengths at typical size; use (n,): not disturbed by
    a command; measured_minus_shell (n,) [degC]: what its thermometer would do; rest: of the bias over temperature [rad/s/degC] (n,)."""

    rate: np.ndarray
    uncertain: np.ndarray
    shown: dict[str, list[list[Strength]]]
    use: np.ndarray
    measured_minus_shell: np.ndarray
    slope: np.ndarray
    notes: tuple[str, ...] = field(default_factory=tuple)

    def at(self, use: np.ndarray) -> Expected:
        """Of some of the observations only."""
        shown = {name: [[replace(s, response=s.response[use]) for s in shape] for shape in shapes] for name, shapes in self.shown.items()}
        return replace(self, rate=self.rate[use], uncertain=self.uncertain[use], shown=shown, use=self.use[use],
                       measured_minus_shell=self.measured_minus_shell[use], slope=self.slope[use])


@dataclass(frozen=True)
class _Bench:
    driven: Driven
    channel: str
    tap_time_s: np.ndarray
    tap_rate_hz: float
    time_s: np.ndarray
    always: tuple[Setting, ...] = ()
    truth: Device | None = None

    def run(self, settings: list[Setting] | None = None, truth: Device | None = None) -> dict[str, np.ndarray]:
        run = self.driven.run
        changed = Run(run.scenario, run.device, truth or self.truth or run.truth)
        ticks = max(1, round(run.device.slow_rate_hz / self.tap_rate_hz))
        with Envelope(changed, calibration_block=self.driven.calibration_block, frame_ticks=ticks, effects=[*self.always, *(settings or [])]) as envelope:
            frames = envelope.run()
        frame_s = ticks / run.device.slow_rate_hz
        return {name: self._at(frames.end_s, frame_s, frames[name]) for name in (self.channel, "temperature_measured", "shell_degc")}

    def rate(self, settings: list[Setting] | None = None, truth: Device | None = None) -> np.ndarray:
        return self.run(settings, truth)[self.channel]

    def _at(self, end_s: np.ndarray, frame_s: float, values: np.ndarray) -> np.ndarray:
        """At the observed times (n,). A recorded frame is the twin's of the same number, wherever inside its time stamp lies."""
        if abs(frame_s * self.tap_rate_hz - 1.0) > 1e-6:
            return np.interp(self.time_s, end_s - 0.5 * frame_s, values)
        place = np.clip(np.floor(self.tap_time_s * self.tap_rate_hz + 1e-9).astype(int), 0, len(values) - 1)
        return np.interp(self.time_s, self.tap_time_s, values[place])


def expect(recording: Recording, device: Device, channel: str, time_s: np.ndarray, measured_degc: np.ndarray, rate_rad_s: np.ndarray) -> Expected:
    """time_s, measured_degc, rate_rad_s (n,): of the observations, the rate NaN where it is no good. The twin is of the unit that the recording shows,
    within its tolerances. Where the shell's own temperature was recorded, the thermometer is taken as it was found: what
    it makes of scale and compensation is no news."""
    driven = drive.from_recording(recording, device)
    tap = recording.tap("output")
    bench = _Bench(driven, channel, tap.time_s, tap.sample_rate_hz, time_s)
    nominal = bench.run()
    shell, measured = nominal["shell_degc"], nominal["temperature_measured"]
    use = undisturbed(recording, driven, time_s)
    found = thermometer_as_found(time_s, shell, measured_degc - (measured - shell)) if driven.shell_known else []
    if found:
        bench = replace(bench, always=tuple(found))
    unit = _unit(bench, rate_rad_s, use & np.isfinite(rate_rad_s))
    bench = replace(bench, truth=unit.device)
    rate = bench.rate()
    warm = np.array(device.resonator.cross_damping_rad_s or [0.0], float)
    slope = np.polynomial.Polynomial(warm).deriv()(shell - device.resonator.reference_temperature_degc) if len(warm) > 1 else np.zeros(len(rate))
    return Expected(rate, _uncertain(bench, unit, rate), _shown(bench, rate), use, measured - shell, slope * np.ones(len(rate)), driven.notes)


def thermometer_as_found(time_s: np.ndarray, shell: np.ndarray, measured: np.ndarray) -> list[Setting]:
    """Lag, offset and gain of a thermometer against the shell, all (n,); nothing where it is as described."""
    stride = max(1, len(time_s) // 4000)
    time_s, shell, measured = time_s[::stride], shell[::stride], measured[::stride]
    span = float(time_s[-1] - time_s[0])
    lags = np.concatenate([[0.0], np.geomspace(3e-4 * span, 0.6 * span, LAGS)])
    best: tuple[float, float, np.ndarray] | None = None
    for _ in range(3):  # finer about the best
        for lag_s in lags:
            late = Lag(time_s, np.full(len(time_s), lag_s))(shell) if lag_s > 0.0 else shell
            columns = np.column_stack([np.ones(len(late)), late - 25.0])
            numbers = np.linalg.lstsq(columns, measured - late, rcond=None)[0]
            left = float(np.sum((measured - late - columns @ numbers) ** 2))
            if best is None or left < best[0]:
                best = (left, float(lag_s), numbers)
        assert best is not None
        lags = best[1] * np.geomspace(0.8, 1.25, 9) if best[1] > 0.0 else np.zeros(0)
    plain = float(np.sum((measured - shell - np.mean(measured - shell)) ** 2))
    if plain < SURE * best[0]:
        return []
    settings = [Setting("thermometer_lag", {"lag_s": best[1]})] if best[1] > 0.0 else []
    return [*settings, Setting("thermometer_error", {"offset_degc": float(np.clip(best[2][0], -30, 30)), "gain": float(np.clip(best[2][1], -0.2, 0.2))})]


def _unit(bench: _Bench, recorded: np.ndarray, use: np.ndarray) -> Unit:
    """Within the tolerances, nearest to the recording; the nominal one where no unit explains all of it: then an effect is there, which would bend every value."""
    unit = Unit.of(bench.driven.run.device)
    if not len(unit.uncertain) or use.sum() < UNIT_BLOCKS:
        return unit
    edges = np.linspace(0, int(use.sum()), UNIT_BLOCKS + 1).astype(int)[:-1]
    sizes = np.diff([*edges, int(use.sum())])

    def means(values: np.ndarray) -> np.ndarray:
        return (np.add.reduceat(values[use], edges, axis=0).T / sizes).T

    nominal, left = unit, np.inf
    white = float(np.median(np.abs(np.diff((recorded - bench.rate())[use], 2)))) / 0.6745 / np.sqrt(6.0 * np.mean(sizes))
    for _ in range(UNIT_ROUNDS):
        here = replace(bench, truth=unit.device)
        rate = here.rate()
        off, slopes = means(recorded - rate), means(_uncertain(here, unit, rate))
        noise = float(np.std(off)) + 1e-15
        for _ in range(4):
            tied = np.vstack([slopes / noise, np.eye(slopes.shape[1])])
            change = np.linalg.lstsq(tied, np.concatenate([off / noise, -unit.off, np.zeros(slopes.shape[1] - len(unit.off))]), rcond=None)[0]
            noise = left = float(np.sqrt(np.mean((off - slopes @ change) ** 2))) + 1e-15
        moved = unit.toward(change[: len(unit.off)])
        if float(np.max(np.abs(moved.off - unit.off))) < 0.02:
            break
        unit = moved
    return unit if left < EXPLAINED * white and float(np.max(np.abs(unit.off))) < UNLIKELY else nominal


def _uncertain(bench: _Bench, unit: Unit, rate: np.ndarray) -> np.ndarray:
    """(n, k): per standard deviation, about the unit; last, what the unit cannot move to both sides."""
    columns = []
    for index in range(len(unit.uncertain)):
        try:
            columns.append((bench.rate(truth=unit.nudged(index, NUDGE)) - rate) / NUDGE)
        except BadInput:
            columns.append((rate - bench.rate(truth=unit.nudged(index, -NUDGE))) / NUDGE)
    gain = unit.device.tolerance.get(GAIN)
    if gain is not None and GAIN not in {item.path for item in unit.uncertain}:  # no shell has more than its nominal
        described = unit.device.resonator.angular_gain
        step = float(gain.absolute) if isinstance(gain.absolute, float) else described * float(gain.relative or 0.0)
        columns.append((rate - bench.rate(truth=unit.device.override({GAIN: described - NUDGE * step}))) / NUDGE)
    return np.array(columns).reshape(len(columns), len(rate)).T


def _shown(bench: _Bench, rate: np.ndarray) -> dict[str, list[list[Strength]]]:
    skipped = {*OWN_FORMS, *NOISE_LIKE, *OF_THE_THERMOMETER}
    found: dict[str, list[list[Strength]]] = {}
    for effect in effects.catalogue():
        if effect.id in skipped:
            continue
        if effect.id == "thermal_hysteresis":
            shapes = [[{"half_width_degc": width}] for width in HALF_WIDTHS_DEGC]
        else:
            shapes = [[{"axis_deg": axis} for axis in AXES_DEG] if any(p.name == "axis_deg" for p in effect.parameters) else [{}]]
        kept = [strengths for strengths in (_responses(bench, rate, effect, shape) for shape in shapes) if strengths]
        if kept:
            found[effect.id] = kept
    return found


def _responses(bench: _Bench, rate: np.ndarray, effect: effects.Effect, shapes: list[dict[str, float]]) -> list[Strength]:
    found = []
    for shape in shapes:
        for p in (p for p in effect.parameters if p.strength):
            try:
                response = bench.rate([Setting(effect.id, {p.name: min(max(p.typical, p.low), p.high), **shape})]) - rate
            except BadInput:
                continue
            found.append(Strength(p.name, p.unit, p.typical, response))
    return found


def undisturbed(recording: Recording, driven: Driven, time_s: np.ndarray) -> np.ndarray:
    """(n,): samples after the first lock that no command disturbed, nor what it took to forget it."""
    settle_s = _settling_s(driven)
    use = time_s > min(settle_s + LOCK_S, LONGEST_SETTLING * float(time_s[-1]) + LOCK_S)
    driving_off = testing = None
    for command in driven.run.scenario.command:
        at = command.at_s
        if command.kind == "drive":
            driving_off = at if not getattr(command, "on") else driving_off
            start = driving_off if driving_off is not None else at
            use &= ~((time_s >= start) & (time_s <= at + settle_s + LOCK_S))
            driving_off = None if getattr(command, "on") else driving_off
        elif command.kind == "test_signal":
            if testing is not None:
                use &= ~((time_s >= testing) & (time_s <= at + settle_s))
            testing = at if getattr(command, "in_phase_fs") or getattr(command, "quadrature_fs") else None
        else:
            use &= ~((time_s >= at) & (time_s <= at + settle_s))
    for open_end in (driving_off, testing):
        if open_end is not None:
            use &= time_s < open_end
    return use


def _settling_s(driven: Driven) -> float:
    device = driven.run.device
    decay = np.pi * device.resonator.frequency_hz / device.resonator.q
    return float(min(SETTLED_DECAYS / decay, LONGEST_SETTLING * driven.run.scenario.duration_s))

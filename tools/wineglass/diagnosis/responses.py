"""What every effect, and everything the description calls uncertain, would do to every slow channel: differences of envelope-twin runs.

A column is the difference between a run with one probe and the run without. Its coefficient is in multiples of the probe; the prior says
how large it may be. Effects whose shape cannot be had by adding columns come in several variants, each with another shape.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from wineglass import effects
from wineglass.device import Device
from wineglass.diagnosis import curves
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.described_noise import FLAT_ALLAN, direct_floors
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.thermometer_codes import Steps
from wineglass.diagnosis.unit import Unit
from wineglass.effects import Setting
from wineglass.envelope import CHANNELS as ENVELOPE_CHANNELS
from wineglass.envelope import Envelope, Inputs
from wineglass.errors import BadInput
from wineglass.scenario import Run

NOISE_LIKE = ("excess_noise", "flicker_noise", "clock_jitter", "interference", "dropped_samples")
"""Effects whose mean over a frame is nothing, or that are over within a few: diagnosis/noise_level.py looks for them."""
STEP_S = 0.04  # of the envelope twin
STAIRS, DEAD_BANDS = "thermometer_quantisation", (0.0, 0.25)
COMPRESSED = (0.005, 0.05)  # of what exceeds the knee: a knee below the amplitude says little of how much is lost beyond it
MOST_LIMITED = 0.1  # of a run's slow ticks, beyond the nominal run's: an effect that holds the forces at their limits for longer is refused
SLOPE_STEP = 0.02  # standard deviations
WANDER, WANDER_TERMS = "wander of ", {"losses": 48}
USUAL_TERMS = 24
WANDER_PROBE, WANDER_PROBE_RAD_S = 1e-3, 1e-5
REACH = 10.0  # prior of a strength: so many times its typical size
OFFSET_S = 1e-3  # between the clocks of rate table and device
SHELL, MEASURED = "shell reference", "temperature_measured"
SHELL_OFFSET_DEGC = 0.05  # of a bench's shell thermometer
POLAR = {"frequency_split": ("split_hz", "slope_hz_per_degc"), "damping_mismatch": ("mismatch", "slope_per_degc")}
"""Effects with an axis: size and axis are two Cartesian components of double the angle."""
AXES_DEG = (0.0, 45.0)  # of these


@dataclass(frozen=True)
class Column:
    """effect: '' for a nuisance. probe: what was switched on, scale: the prior's standard deviation in multiples of the probe."""

    effect: str
    probe: Setting | None
    name: str
    scale: float


@dataclass(frozen=True, eq=False)
class Variant:
    """One shape of an effect: its columns, and the shape's parameters."""

    effect: str
    columns: tuple[int, ...]
    shapes: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Responses:
    """values (columns, channels, n) on the grid of the recording; nominal (channels, n): the run without anything."""

    names: tuple[str, ...]
    nominal: np.ndarray
    columns: tuple[Column, ...]
    values: np.ndarray
    nuisances: tuple[int, ...]
    centre: np.ndarray
    """(nuisances,): where the bench's unit has them, in standard deviations"""
    variants: dict[str, list[Variant]]
    tolerances: int = 0
    """how many of the nuisances, the first ones, are a unit's"""


class Bench:
    """Runs the envelope twin over the recorded inputs, again and again. unit: the device in truth; shell_off: by how much the bench's shell
    thermometer reads too little, in standard deviations; stairs: steps that the recorded thermometer was seen to have."""

    def __init__(self, driven: Driven, grid: Grid, names: Sequence[str], unit: Unit | None = None, shell_off: float = 0.0, stairs: Steps | None = None):
        self.driven, self.grid, self.shell_off = driven.warmer(shell_off * SHELL_OFFSET_DEGC), grid, shell_off
        self.stairs = stairs
        self._as_recorded = driven
        self.unit = Unit.of(driven.run.device) if unit is None else unit
        self.names = tuple(name for name in names if name in ENVELOPE_CHANNELS)
        self._ticks = max(1, round(grid.frame_s * driven.run.device.slow_rate_hz))
        longest = STEP_S * driven.run.device.slow_rate_hz
        self._step = max(ticks for ticks in range(1, self._ticks + 1) if self._ticks % ticks == 0 and ticks <= max(1.0, longest + 1e-9))
        self._inputs: Inputs | None = None
        self._truth = self.unit.device
        self.nominal = self.run()
        self._most_single_ticks = self._singles + int(MOST_LIMITED * self._ticks * (grid.first + grid.count))
        self.slopes: list[tuple[str, np.ndarray]] | None = None
        """`uncertainties` about this bench, once they are known"""
        self.wander: list[tuple[str, np.ndarray]] | None = None

    @property
    def shell_degc(self) -> np.ndarray:
        """(n,): as far as it is known, where the shell has been."""
        return self.driven.run.scenario.temperature.at(self.grid.time_s)

    @property
    def measured_degc(self) -> np.ndarray:
        """(n,): what the thermometer says, or the shell's temperature, where it says nothing."""
        return self.nominal[self.names.index(MEASURED)] if MEASURED in self.names else self.shell_degc

    def at(self, unit: Unit, shell_off: float) -> Bench:
        return Bench(self._as_recorded, self.grid, self.names, unit, shell_off, self.stairs)

    def centre(self, nuisances: Sequence[str], unit: Unit | None = None) -> np.ndarray:
        """(m,): where the bench's runs have what is uncertain, in standard deviations. unit: None is the bench's own."""
        found = np.zeros(len(nuisances))
        off = (unit or self.unit).off
        found[: len(off)] = off
        if SHELL in nuisances:
            found[nuisances.index(SHELL)] = self.shell_off
        return found

    def tried(self, settings: Sequence[Setting]) -> np.ndarray:
        """(channels, n): what effects do to the nominal run. BadInput where the twin refuses them, and where the forces would stand at their limits for long."""
        return self.run(settings, most_single_ticks=self._most_single_ticks) - self.nominal

    def run(self, settings: Sequence[Setting] = (), truth: Device | None = None, shell_offset_degc: float = 0.0, most_single_ticks: int = 0) -> np.ndarray:
        """(channels, n) with effects switched on, or with another device in truth."""
        run = self.driven.run
        changed = Run(run.scenario, run.device, self._truth if truth is None else truth)
        with Envelope(changed, calibration_block=self.driven.calibration_block, frame_ticks=self._ticks, step_ticks=self._step, effects=settings,
                      most_single_ticks=most_single_ticks) as envelope:
            if self._inputs is None:
                self._inputs = envelope.inputs()
            inputs = self._inputs
            if shell_offset_degc:
                inputs = Inputs(inputs.rate_mean_rad_s, inputs.rate_end_rad_s, inputs.chamber_degc + shell_offset_degc)
            frames = envelope.run(inputs)
            self._singles = envelope.single_ticks
        wanted = slice(self.grid.first, self.grid.first + self.grid.count)
        values = np.array([frames[name][wanted] for name in self.names])
        missing = self.grid.count - values.shape[1]
        return np.pad(values, ((0, 0), (0, missing)), "edge") if missing > 0 else values


def respond(bench: Bench, without: frozenset[str] = frozenset(), advance: Callable[[], None] = lambda: None, bend: bool = True) -> Responses:
    """without: effects taken out of the catalogue (for tests of honesty). bend: laws may be curves over temperature."""
    columns: list[Column] = []
    values: list[np.ndarray] = []
    variants: dict[str, list[Variant]] = {}
    for name, response in uncertainties(bench):
        columns.append(Column("", None, name, 1.0))
        values.append(response)
    nuisances = tuple(range(len(columns)))
    switched = _Switched(bench)
    for effect in effects.catalogue():
        if effect.id in NOISE_LIKE or effect.id in without:
            continue
        found = []
        for shapes, probes in _variants(bench, effect):
            places = []
            for name, probe, scale in probes:
                try:
                    response = switched(probe) if effect.id in _LATER else bench.tried([probe])
                except BadInput:
                    continue
                places.append(len(columns))
                columns.append(Column(effect.id, probe, name, scale))
                values.append(response)
            if places:
                found.append(Variant(effect.id, tuple(places), shapes))
            simple = _simplest(effect.id, [columns[i] for i in places], places)
            if simple:
                found.append(Variant(effect.id, simple, shapes))
        curve = list(_curve(bench, effect)) if bend else []
        if found and curve:
            found.append(Variant(effect.id, (*found[0].columns, *range(len(columns), len(columns) + len(curve)))))
            columns += [column for column, _ in curve]
            values += [response for _, response in curve]
        if found:
            variants[effect.id] = found
        advance()
    centre = bench.centre([columns[i].name for i in nuisances])
    return Responses(bench.names, bench.nominal, tuple(columns), np.array(values), nuisances, centre, variants, len(bench.unit.off))


# --- nuisances -----------------------------------------------------------------------------------------------------------


def uncertainties(bench: Bench, settings: Sequence[Setting] = (), unit: Unit | None = None) -> list[tuple[str, np.ndarray]]:
    """What one standard deviation of everything uncertain does, (channels, n) each, with the effects of `settings` switched on, about a unit
    (None: the bench's). Slopes, not differences: a tolerance and an effect that is the same thing must look the same."""
    if settings or unit is not None:
        about = unit or bench.unit
        return _slopes(bench, settings, about, bench.run(settings, truth=about.device))
    if bench.slopes is None:
        bench.slopes = _slopes(bench, settings, bench.unit, bench.nominal)
    return bench.slopes


def _slopes(bench: Bench, settings: Sequence[Setting], about: Unit, at: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """at (channels, n): the run that they start from."""
    found = []
    for i, item in enumerate(about.uncertain):
        try:
            slope = (bench.run(settings, truth=about.nudged(i, SLOPE_STEP)) - at) / SLOPE_STEP
        except BadInput:
            slope = (at - bench.run(settings, truth=about.nudged(i, -SLOPE_STEP))) / SLOPE_STEP
        found.append((item.name, slope))
    if bench.driven.shell_known:
        found.append((SHELL, bench.run(settings, shell_offset_degc=SHELL_OFFSET_DEGC) - at))
    if bench.driven.rate_known:
        found.append(("clock of the rate table", np.gradient(at, bench.grid.frame_s, axis=1) * OFFSET_S))
    if bench.wander is None:
        bench.wander = _wander(bench)
    return [*found, *bench.wander]


def _wander(bench: Bench) -> list[tuple[str, np.ndarray]]:
    """What the description's noise floors allow a healthy device to wander slowly: cosines over the record, as large as their share of flicker noise."""
    n, found = bench.grid.count, []
    for source, response in _slow_sources(bench).items():
        order = np.arange(1, WANDER_TERMS.get(source, USUAL_TERMS) + 1)
        waves = np.cos(np.pi * np.outer(order, np.arange(n) + 0.5) / n) * np.sqrt(2.0 / (FLAT_ALLAN * order))[:, None]
        found += [(f"{WANDER}{source} {k}", response * wave) for k, wave in zip(order, waves, strict=True)]
    return found


def wandering(names: Sequence[str]) -> frozenset[int]:
    """Places of what is noise of a described floor."""
    return frozenset(i for i, name in enumerate(names) if name.startswith(WANDER))


def _slow_sources(bench: Bench) -> dict[str, np.ndarray]:
    """(channels, n): what one described floor, held, does to every channel."""
    floor, truth = bench.driven.run.device.noise_floor, bench.unit.device
    found = {}
    for name, size in direct_floors(bench.driven).items():
        if name in bench.names and size > 0.0:
            found[name] = np.zeros_like(bench.nominal)
            found[name][bench.names.index(name)] = size
    if floor.drive_level_relative > 0.0:
        lossy = bench.run([Setting("damping_step", {"damping": WANDER_PROBE, "time_s": 0.0})])
        found["losses"] = (lossy - bench.nominal) * (floor.drive_level_relative / WANDER_PROBE)
    if floor.rate_bias_instability_rad_s > 0.0:
        bias = list(truth.resonator.cross_damping_rad_s) or [0.0]
        bias[0] += WANDER_PROBE_RAD_S
        biased = bench.run(truth=truth.override({"resonator.cross_damping_rad_s": bias}))
        found["bias"] = (biased - bench.nominal) * (floor.rate_bias_instability_rad_s / WANDER_PROBE_RAD_S)
    return found


def _simplest(effect: str, columns: list[Column], places: list[int]) -> tuple[int, ...]:
    """Of an effect with several strengths the first alone: what needs no slope should not pay for one."""
    names = list(dict.fromkeys(column.name for column in columns))
    if len(names) < 2:
        return ()
    return tuple(place for place, column in zip(places, columns, strict=True) if column.name == names[0])


# --- effects -------------------------------------------------------------------------------------------------------------

Probe = tuple[str, Setting, float]


def _variants(bench: Bench, effect: effects.Effect) -> list[tuple[dict[str, float], list[Probe]]]:
    """Shapes, and the probes of each: name of the strength, setting, prior in multiples of the setting."""
    if effect.id in POLAR:
        return [({}, [probe for axis in AXES_DEG for probe in _strengths(effect, {"axis_deg": axis})])]
    if effect.id == STAIRS and bench.stairs is not None:
        shapes = stairs_as_seen(bench.stairs, bench.unit.device)
        return [(shape, [("step_degc", Setting(STAIRS, {"step_degc": bench.stairs.step_degc, **shape}), 1.0)]) for shape in shapes]
    if effect.id in _WHOLE:
        return [(shape, [(name, Setting(effect.id, {name: value, **shape}), 1.0)]) for name, value, shape in _WHOLE[effect.id](bench)]
    if effect.id in _APART:
        return [({}, [probe for probe in _strengths(effect, {}) if probe[0] in names]) for names in _APART[effect.id]]
    shapes = _SHAPES.get(effect.id, lambda _: [{}])(bench)
    return [(shape, _strengths(effect, shape)) for shape in shapes]


def _strengths(effect: effects.Effect, shape: dict[str, float]) -> list[Probe]:
    return [(p.name, Setting(effect.id, {p.name: min(max(p.typical, p.low), p.high), **shape}), REACH)
            for p in effect.parameters if p.strength and not (effect.id == "vibration" and p.name == "rate_rad_s")]


def _curve(bench: Bench, effect: effects.Effect) -> Iterator[tuple[Column, np.ndarray]]:
    """One column per control point: the response to a curve that is the same everywhere, weighted as the point counts at the temperature of the moment."""
    points = curves.seen(effect, bench.shell_degc)
    if not points:
        return
    for shape in [{"axis_deg": axis} for axis in AXES_DEG] if effect.id in POLAR else [{}]:
        everywhere = Setting(effect.id, {p.name: p.typical for p in curves.points(effect)} | shape)
        response = bench.run([everywhere]) - bench.nominal
        for point in points:
            probe = Setting(effect.id, {point.name: point.typical, **shape})
            yield Column(effect.id, probe, point.name, REACH), response * curves.weight(bench.measured_degc, point.name)


Whole = tuple[str, float, dict[str, float]]


def _lags(bench: Bench) -> list[Whole]:
    span = bench.grid.count * bench.grid.frame_s
    return [("lag_s", span / part, {}) for part in (10000, 3000, 1000, 300, 100, 30, 10)]


def _clips(bench: Bench) -> list[Whole]:
    """Flat on both sides or on one, just below the amplitude; or less steep from well below it on."""
    amplitude = bench.driven.run.device.firmware.amplitude_fs
    flat = [("loss_fs", min(0.8, 1.0 - amplitude * (1.0 - part)), shape) for part in (0.003, 0.02, 0.1) for shape in ({}, {"negative_part": 0.0})]
    return [*flat, *(("loss_fs", min(0.8, 1.0 - 0.75 * amplitude), {"positive_part": part, "negative_part": part}) for part in COMPRESSED)]


def stairs_as_seen(stairs: Steps, unit: Device) -> list[dict[str, float]]:
    """Readings, of which a unit's zero is taken, say where the codes are, but not whether one is held on to."""
    origin_degc = (stairs.offset_degc + unit.electronics.thermometer.zero_degc - unit.resonator.reference_temperature_degc) % stairs.step_degc
    return [{"origin_degc": origin_degc, "dead_band": part} for part in DEAD_BANDS]


def _steps(bench: Bench) -> list[Whole]:
    lsb = bench.driven.run.device.electronics.thermometer.lsb_degc
    return [("step_degc", step, {}) for step in (0.125, 0.25, 0.5, 1.0, 2.0) if step > 2.0 * lsb]


_WHOLE: dict[str, Callable[[Bench], list[Whole]]] = {
    "thermometer_lag": _lags, "adc_saturation": _clips, STAIRS: _steps}
"""Effects that do not grow in proportion to their parameter: whole effects of several sizes, each with a coefficient of about one."""

_APART = {"adc_nonlinearity": (("cubic", "quintic", "quadratic"), ("sign_step_fs",), ("half_step_fs",), ("teeth_fs",))}
"""Strengths that seldom come together: forms of their own."""


def _step_times(bench: Bench) -> list[dict[str, float]]:
    begin, span = bench.grid.first * bench.grid.frame_s, bench.grid.count * bench.grid.frame_s
    moments = [{"time_s": begin + span * (i + 0.5) / 20, "creep_s": creep * span} for i in range(20) for creep in (0.0, 0.1)]
    return [*moments, *({"time_s": begin, "creep_s": creep * span} for creep in (0.5, 3.0))]


_LATER = ("damping_step",)
"""Effects that act from time_s on, at once or creeping within creep_s."""


class _Switched:
    """Responses of what acts from a moment on: of what acts all along, cut off there. One run serves all moments; closing an explanation runs the truth."""

    def __init__(self, bench: Bench):
        self._bench = bench
        self._always: dict[str, np.ndarray] = {}

    def __call__(self, probe: Setting) -> np.ndarray:
        always = Setting(probe.id, {**probe.values, "time_s": 0.0, "creep_s": 0.0})
        key = str(always)
        if key not in self._always:
            self._always[key] = self._bench.run([always]) - self._bench.nominal
        since_s = self._bench.grid.time_s - probe.values["time_s"]
        creep_s = probe.values.get("creep_s", 0.0)
        return self._always[key] * np.where(since_s < 0.0, 0.0, 1.0 - np.exp(-np.maximum(since_s, 0.0) / creep_s) if creep_s > 0.0 else 1.0)


def _ages(bench: Bench) -> list[dict[str, float]]:
    span = bench.grid.count * bench.grid.frame_s
    return [{"time_constant_s": span * part} for part in (0.003, 0.03, 0.3)]


def _plays(bench: Bench) -> list[dict[str, float]]:
    span = float(np.ptp(bench.driven.run.scenario.temperature.at(bench.grid.time_s)))
    return [{"half_width_degc": min(50.0, max(0.1, 0.5 * span * part))} for part in (0.03, 0.1, 0.25, 0.5, 0.8)] if span > 1.0 else [{}]


def _losses(bench: Bench) -> list[dict[str, float]]:
    """Q stays while the frequency changes, or the damping does: a second effect would stand for the difference."""
    return [{}, {"losses_stay": 1.0}]


def _softened(bench: Bench) -> list[dict[str, float]]:
    """Both modes alike, or the driven one alone, which makes a split of its own."""
    return [{}, {"on_secondary": 0.0}]


_SHAPES: dict[str, Callable[[Bench], list[dict[str, float]]]] = {
    "damping_step": _step_times, "ageing": _ages, "thermal_hysteresis": _plays, "frequency_temperature": _losses, "amplitude_frequency": _softened}

"""The paper's two experiments with the firmware in the loop: its figure 5 (fast temperature swing under rate) and its figure 2 (slow chamber
profile at zero rate).

    figure = run_fig5("paper", progress=print)
    print(figure.residual["g2"].ac_rad_s, figure.ratio("g2", to="static"))
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from wineglass import scenario as scenarios
from wineglass.commands_wire import CommandEncoder
from wineglass.errors import BadInput
from wineglass.scenario import Run, Scenario
from wineglass.telemetry import Decoder
from wineglass.twin import Twin
from wineglass.wire import Status

RATE_SCALE = 2.0**-28  # rad/s per code of the rate outputs
COMPENSATIONS = ("none", "static", "g2")
FORGETTING_TIMES = 12  # decay times until the cold start has died away
IDEAL_ADC = {"electronics.adc.bits": 32, "electronics.adc.snr_db": 0.0}  # quantiser and noise switched off
VARIANTS: dict[str, dict[str, Any]] = {"default": {}, "ideal_adc": IDEAL_ADC}

Progress = Callable[[str, float], None]
"""Called with what is running and the fraction of the whole experiment that is done."""


@dataclass(frozen=True)
class Residual:
    """rms over the evaluated stretch [rad/s]: ac without the mean, total with it; and the mean itself"""

    ac_rad_s: float
    total_rad_s: float
    mean_rad_s: float


@dataclass(frozen=True)
class Figure5:
    """Series (n,) at the slow rate. rate_rad_s: output by compensation; reference_rad_s: output of the run without cross damping and
    without compensation, from which the residuals are counted; evaluated: mask of the whole periods they are taken over."""

    device: str
    variant: str
    split_hz: float
    seed: int
    time_s: np.ndarray
    true_rate_rad_s: np.ndarray
    shell_degc: np.ndarray
    reference_rad_s: np.ndarray
    rate_rad_s: dict[str, np.ndarray]
    evaluated: np.ndarray
    residual: dict[str, Residual]

    def ratio(self, method: str, to: str) -> float:
        """ac residual of one compensation over that of another"""
        return self.residual[method].ac_rad_s / self.residual[to].ac_rad_s


@dataclass(frozen=True)
class Figure2:
    """Series (n,) at the scenario's output rate, at zero rate: the outputs are errors. evaluated: after the cold start.
    residual: by `none` and the compensation that ran."""

    device: str
    method: str
    seed: int
    time_s: np.ndarray
    chamber_degc: np.ndarray
    shell_degc: np.ndarray
    uncompensated_rad_s: np.ndarray
    compensated_rad_s: np.ndarray
    evaluated: np.ndarray
    residual: dict[str, Residual]


@dataclass(frozen=True)
class Series:
    """Output of one run next to the truth, (n,) each, one value per output frame; valid: the firmware stood by its rate throughout."""

    time_s: np.ndarray
    rate_rad_s: np.ndarray
    uncompensated_rad_s: np.ndarray
    true_rate_rad_s: np.ndarray
    chamber_degc: np.ndarray
    shell_degc: np.ndarray
    valid: np.ndarray


def run_fig5(device: str | None = None, variant: str = "default", *, split_hz: float | None = None, seed: int | None = None,
             progress: Progress | None = None) -> Figure5:
    """The paper's figure 5 on a device: four runs of the same scenario with the same inputs.

    device: None or "paper" takes the scenario paper-fig5, another one the scenario paper-fig5-metal with that device. variant: of VARIANTS.
    The reference run has no cross damping, no compensation and an ideal ADC, so the noise of the evaluated run counts in full.
    """
    base = _fig5_scenario(device, variant, split_hz, seed)
    outputs: dict[str, Series] = {}
    for number, method in enumerate(("reference", *COMPENSATIONS)):
        part = _part_of(progress, f"figure 5, {base.device}, {method}", number, 1 + len(COMPENSATIONS))
        outputs[method] = _fig5_run(base, method, part)
    reference = outputs.pop("reference")
    run = scenarios.prepare(base)
    evaluated = _whole_periods(reference.time_s, run)
    residual = {method: residual_of((series.rate_rad_s - reference.rate_rad_s)[evaluated]) for method, series in outputs.items()}
    for method, series in outputs.items():
        _require_valid(series, evaluated, f"figure 5, {method}")
    return Figure5(run.device.name, variant, run.device.resonator.split_hz, base.seed, reference.time_s, reference.true_rate_rad_s,
                   reference.shell_degc, reference.rate_rad_s, {method: series.rate_rad_s for method, series in outputs.items()},
                   evaluated, residual)


def run_fig2(device: str | None = None, method: str = "g2", *, seed: int | None = None, duration_s: float | None = None,
             progress: Progress | None = None) -> Figure2:
    """The paper's figure 2: one run of the scenario paper-fig2; the firmware reports both outputs."""
    scenario = scenarios.load("paper-fig2").changed(_given(device=device, seed=seed, duration_s=duration_s) | {"mode.compensation": method})
    run = scenarios.prepare(scenario)
    series = simulate(run, _part_of(progress, f"figure 2, {run.device.name}", 0, 1))
    evaluated = series.time_s > _forgotten_s(run)
    _require_valid(series, evaluated, "figure 2")
    residual = {"none": residual_of(series.uncompensated_rad_s[evaluated]), method: residual_of(series.rate_rad_s[evaluated])}
    return Figure2(run.device.name, method, scenario.seed, series.time_s, series.chamber_degc, series.shell_degc, series.uncompensated_rad_s,
                   series.rate_rad_s, evaluated, residual)


def simulate(run: Run, progress: Callable[[float], None] | None = None) -> Series:
    """One run through the twin; the outputs are what its telemetry says."""
    divisor = run.divisor(run.scenario.recording.output_hz) or 1
    encoder, decoder = CommandEncoder(), Decoder()
    frames: list[np.ndarray] = []
    truth: list[np.ndarray] = []
    with Twin(run) as twin:
        twin.command(encoder.divisors(0, divisor))
        twin.poll()
        for block in twin.chunks():
            frames.append(decoder.feed(twin.telemetry()).output)
            truth.append(np.stack([block.true_rate_rad_s, block.chamber_degc, block.shell_degc]))
            if progress is not None:
                progress(twin.blocks_done / run.n_blocks)
    return _aligned(run, np.concatenate(frames), np.concatenate(truth, axis=1))


def residual_of(error_rad_s: np.ndarray) -> Residual:
    mean = float(np.mean(error_rad_s))
    return Residual(float(np.std(error_rad_s)), float(np.sqrt(np.mean(error_rad_s**2))), mean)


def _aligned(run: Run, frames: np.ndarray, truth: np.ndarray) -> Series:
    """Output frames next to the truth at the end of the last whole block before each. truth: (3, blocks)"""
    samples = run.device.block_samples
    frames = frames[frames["sample_counter"] >= samples]
    at = (frames["sample_counter"] // samples).astype(np.int64) - 1
    valid = (frames["status_and"] & Status.RATE_VALID) != 0
    return Series(frames["sample_counter"] / run.device.electronics.sample_rate_hz, frames["rate"] * RATE_SCALE,
                  frames["rate_uncompensated"] * RATE_SCALE, *truth[:, at], valid)


def _fig5_scenario(device: str | None, variant: str, split_hz: float | None, seed: int | None) -> Scenario:
    if variant not in VARIANTS:
        raise BadInput(f"no variant '{variant}' of the experiment", "figure 5", f"choose one of {', '.join(VARIANTS)}")
    scenario = scenarios.load("paper-fig5" if device in (None, "paper") else "paper-fig5-metal")
    override = {**scenario.override, **VARIANTS[variant], **_given(**{"resonator.split_hz": split_hz})}
    return scenario.model_copy(update={"override": override, **_given(device=device, seed=seed)})


def _fig5_run(base: Scenario, method: str, progress: Callable[[float], None] | None) -> Series:
    if method != "reference":
        return simulate(scenarios.prepare(base.changed({"mode.compensation": method})), progress)
    ideal = base.changed({"mode.compensation": "none", "plant.cross_damping": False})
    return simulate(scenarios.prepare(ideal.model_copy(update={"override": {**base.override, **IDEAL_ADC}})), progress)


def _given(**choices: Any) -> dict[str, Any]:
    return {name: value for name, value in choices.items() if value is not None}


def _forgotten_s(run: Run) -> float:
    """When the start is forgotten: 12 of the longest decay times that the profile meets."""
    temperature = run.temperature_degc(0, run.n_blocks)
    return FORGETTING_TIMES / float(np.min(run.truth.resonator.decay_rate_at(temperature)))


def _whole_periods(time_s: np.ndarray, run: Run) -> np.ndarray:
    """Mask of whole temperature periods after the start is forgotten."""
    period_s = run.scenario.temperature.period_s
    first = math.ceil(_forgotten_s(run) / period_s)
    last = math.floor(run.scenario.duration_s / period_s)
    if last - first < 1:
        raise BadInput(f"no whole period is left after {_forgotten_s(run):.1f} s", f"scenario {run.scenario.name}", "simulate longer")
    mask = (time_s >= first * period_s) & (time_s < last * period_s)
    return mask


def _require_valid(series: Series, evaluated: np.ndarray, what: str) -> None:
    if not series.valid[evaluated].all():
        raise RuntimeError(f"{what}: the firmware did not stand by its rate at {series.time_s[evaluated][~series.valid[evaluated]][0]:.3f} s")


def _part_of(progress: Progress | None, what: str, number: int, count: int) -> Callable[[float], None] | None:
    if progress is None:
        return None
    return lambda fraction: progress(what, (number + fraction) / count)

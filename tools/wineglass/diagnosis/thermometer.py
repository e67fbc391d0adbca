"""Thermometer against the bench's own shell temperature: lag and error show there directly, whatever the rate does.

The same marginal likelihood as for the rate (bayes.py): measured minus shell, with an offset and a gain as columns and a lag as another expectation.
The result is joined with that of the rate as of an independent channel: sets of effects unite, probabilities multiply.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from wineglass.calibration.lag import Lag
from wineglass.diagnosis import bayes, gap, noise_models
from wineglass.diagnosis.blocks import Blocks
from wineglass.diagnosis.columns import Design, Variant
from wineglass.diagnosis.contract import ChannelShrink, Diagnosis, EffectFound, Hypothesis, Parameter, Region, Where
from wineglass.diagnosis.noise_models import CLASSES
from wineglass.diagnosis.vocabulary import NONE, OTHER, component_of, stage_of

CHANNEL, UNIT = "temperature_measured", "degC"
LAG_SHARES, LAG_STEPS = (3e-4, 0.6), 32  # of the record
NEAR_STEP, NEAR_STEPS = 0.02, 14  # logarithm: about the best of them
OFFSET_DEGC = 1.0  # prior
GAIN = 0.02
TOLERATED_DEGC = 0.3  # of a digital sensor, three standard deviations: a smaller offset is no gap
SURE = 0.95
LISTED = 12


@dataclass(frozen=True)
class Thermometer:
    """probability: set of effects, none or other -> probability. before, after, floor: rms [degC] over all blocks"""

    probability: dict[tuple[str, ...], float]
    parameters: dict[str, list[Parameter]]
    before: float
    after: float
    floor: float
    region: tuple[float, float]

    @property
    def found(self) -> tuple[str, ...]:
        """The set of effects that is sure; () none is."""
        best = max(self.probability, key=lambda ids: self.probability[ids])
        return best if best not in ((NONE,), (OTHER,)) and self.probability[best] >= SURE else ()


def examine(blocks: Blocks) -> Thermometer | None:
    """None where the shell's own temperature was not recorded."""
    if blocks.fine_measured_degc is None:
        return None
    fold = (blocks.fine_measured_degc - blocks.fine_temperature_degc).reshape(len(blocks), blocks.per_block)
    difference = fold.mean(axis=1)
    white = max(_white(fold), 1e-6)
    design = _design(blocks, difference)
    noise = noise_models.candidates(blocks.time_s, np.sqrt(blocks.per_block))
    candidates = [c for c in bayes.enumerate_candidates(design)]
    scores = bayes.score(design, noise, white, candidates)
    table = dict(zip(scores.supports, scores.by_support))
    floor = CLASSES.index("floor")
    logs = {ids or (NONE,): float(row[floor]) for ids, row in table.items()}
    logs[(OTHER,)] = float(logsumexp(np.delete(table[()], floor)))
    total = logsumexp(list(logs.values()))
    probability = {ids: float(np.exp(value - total)) for ids, value in logs.items()}
    best = max((ids for ids in table if ids), key=lambda ids: probability[ids])
    mixture = bayes.fits(design, scores, white, best, np.arange(len(blocks)), 0.01)
    numbers = {name: _parameters(design, mixture, name) for name in best}
    probability = _tolerated(probability, best, numbers)
    after = gap.rms(bayes.residual(design, mixture))
    return Thermometer(probability, numbers, gap.rms(difference), after, max(white, min(after, gap.rms(difference))),
                       (float(blocks.time_s[0]), float(blocks.time_s[-1])))


def join(rate: Diagnosis, thermometer: Thermometer | None) -> Diagnosis:
    """The rate's diagnosis with what the thermometer shows by itself."""
    if thermometer is None:
        return rate
    if not thermometer.found:
        off = thermometer.probability.get((OTHER,), 0.0) >= SURE and thermometer.before > TOLERATED_DEGC
        return _unexplained(rate, thermometer) if off else rate
    named = thermometer.found
    hypotheses = _united(rate, thermometer)
    effects = [EffectFound(id=e.id, stage=e.stage, confidence=_marginal(hypotheses, e.id), parameters=e.parameters, share=e.share) for e in rate.effects]
    effects += [EffectFound(id=name, stage=stage_of(name), confidence=_marginal(hypotheses, name), parameters=thermometer.parameters[name], share=1.0 / len(named))
                for name in named]
    silent = rate.verdict in ("no_gap", "insufficient")
    size = f"{thermometer.before:.3g} degC"
    added = f"Against the shell's own temperature the thermometer is off by {size} rms: {' with '.join(named)}."
    shown = _where(thermometer, named)
    return rate.model_copy(update={
        "verdict": "attributed" if silent else rate.verdict, "sentence": added if silent else f"{rate.sentence} {added}", "hypotheses": hypotheses, "effects": effects,
        "alternatives": [[*ids, *named] for ids in rate.alternatives if ids != [OTHER]] + [ids for ids in rate.alternatives if ids == [OTHER]],
        "where": shown if silent else [*(w.model_copy(update={"share": 0.5 * w.share}) for w in rate.where), *(w.model_copy(update={"share": 0.5 * w.share}) for w in shown)],
        "shrink": rate.shrink.model_copy(update={"channels": [*rate.shrink.channels, _shrink(thermometer)]}),
        "next_experiment": None if silent else rate.next_experiment})


def _unexplained(rate: Diagnosis, thermometer: Thermometer) -> Diagnosis:
    """The thermometer is off, and not by a lag, an offset or a gain."""
    region = Region(variable="time", start=thermometer.region[0], stop=thermometer.region[1], unit="s")
    shown = Where(stage="temperature", channel=CHANNEL, component="temperature", share=1.0 if not rate.where else 0.5, region=region, size=thermometer.before,
                  unit=UNIT, ratio_over_floor=thermometer.before / thermometer.floor)
    return rate.model_copy(update={
        "verdict": "unknown", "hypotheses": _united(rate, thermometer), "alternatives": [],
        "effects": [e.model_copy(update={"confidence": _marginal(_united(rate, thermometer), e.id)}) for e in rate.effects],
        "sentence": f"{rate.sentence} Against the shell's own temperature the thermometer is off by {thermometer.before:.3g} degC rms, and neither lag, offset nor gain explain it.",
        "where": [*(w.model_copy(update={"share": 0.5 * w.share}) for w in rate.where), shown]})


def _design(blocks: Blocks, difference: np.ndarray) -> Design:
    """Offset and gain as columns; per lag another target: measured minus the late shell."""
    shell, span = blocks.fine_temperature_degc, float(blocks.time_s[-1] - blocks.time_s[0])
    middle = shell - shell.mean()
    matrix = np.column_stack([np.full(len(blocks), OFFSET_DEGC), GAIN * blocks.mean(middle)])
    targets, variants = [difference], []

    def beyond(tau: float) -> np.ndarray:
        return difference - blocks.mean(Lag(blocks.fine_time_s, np.full(len(shell), tau))(shell) - shell)

    def misfit(tau: float) -> float:
        left = beyond(tau)
        return float(np.sum((left - matrix @ np.linalg.lstsq(matrix, left, rcond=None)[0]) ** 2))

    about = min(span * np.geomspace(*LAG_SHARES, LAG_STEPS), key=misfit)
    for tau in about * np.exp(np.arange(-NEAR_STEPS, NEAR_STEPS + 1) * NEAR_STEP):
        targets.append(beyond(tau))
        variants.append(Variant("thermometer late", (), len(targets) - 1, float(tau)))
    effects = {"thermometer_lag": variants, "thermometer_error": [Variant("offset", (0,)), Variant("offset and gain", (0, 1))]}
    nothing: list[tuple[int, ...]] = [()] * len(targets)
    return Design(matrix, difference, nothing, np.array(targets), effects, np.array([OFFSET_DEGC, GAIN]), True, nothing)


def _white(fold: np.ndarray) -> float:
    """Noise of a block's mean, from second differences inside the blocks."""
    if fold.shape[1] < 3:
        return float(np.median(np.abs(np.diff(fold, axis=1)))) / 0.6745 / 2.0
    second = np.diff(fold, 2, axis=1) / np.sqrt(6.0)
    return float(np.sqrt(np.mean(np.sort((second**2).ravel())[: int(0.9 * second.size) + 1]) / 0.7 / fold.shape[1]))


def _parameters(design: Design, mixture: list[bayes.Fit], name: str) -> list[Parameter]:
    if name == "thermometer_lag":
        taus = np.array([f.candidate.variants[f.candidate.support.index(name)].value for f in mixture])
        weights = np.array([f.weight for f in mixture])
        middle = float(np.exp(weights @ np.log(taus)))
        return [Parameter(name="lag_s", value=middle, interval=(float(taus.min() * np.exp(-0.5 * NEAR_STEP)), float(taus.max() * np.exp(0.5 * NEAR_STEP))), unit="s")]
    found = []
    for place, (label, unit) in enumerate((("offset_degc", "degC"), ("gain", "1"))):
        means, variances, weights = [], [], []
        for fit in mixture:
            columns = list(fit.candidate.columns)
            if place in columns:
                i = columns.index(place)
                means.append(fit.mean[i] * design.scale[place])
                variances.append(fit.covariance[i, i] * design.scale[place] ** 2)
                weights.append(fit.weight)
        if weights:
            w = np.array(weights) / np.sum(weights)
            mean = float(w @ means)
            spread = 1.96 * float(np.sqrt(w @ (np.array(variances) + (np.array(means) - mean) ** 2)))
            found.append(Parameter(name=label, value=mean, interval=(mean - spread, mean + spread), unit=unit))
    return found


def _tolerated(probability: dict[tuple[str, ...], float], best: tuple[str, ...], numbers: dict[str, list[Parameter]]) -> dict[tuple[str, ...], float]:
    """An offset within the tolerance, and no gain to speak of, is no error: its probability goes to the set without it."""
    error = "thermometer_error"
    if error not in best:
        return probability
    values = {p.name: p for p in numbers[error]}
    gain = values.get("gain")
    if abs(values["offset_degc"].value) > TOLERATED_DEGC or (gain is not None and abs(gain.value) > 0.005 and gain.interval[0] * gain.interval[1] > 0):
        return probability
    kept: dict[tuple[str, ...], float] = {}
    for ids, value in probability.items():
        without = tuple(i for i in ids if i != error) or (NONE,)
        kept[without] = kept.get(without, 0.0) + value
    return kept


def _united(rate: Diagnosis, thermometer: Thermometer) -> list[Hypothesis]:
    joint: dict[tuple[str, ...], float] = {}
    for hypothesis in rate.hypotheses:
        for ids, value in thermometer.probability.items():
            both = tuple(dict.fromkeys(i for i in (*hypothesis.ids, *ids) if i != NONE)) or (NONE,)
            key = next((k for k in joint if set(k) == set(both)), both)
            joint[key] = joint.get(key, 0.0) + hypothesis.probability * value
    order = sorted(joint, key=lambda ids: -joint[ids])
    kept = list(dict.fromkeys([*order[:LISTED], (NONE,), (OTHER,)]))
    total = sum(joint.get(ids, 0.0) for ids in kept)
    return [Hypothesis(ids=list(ids), probability=joint.get(ids, 0.0) / total) for ids in kept]


def _marginal(hypotheses: list[Hypothesis], name: str) -> float:
    return min(1.0, sum(h.probability for h in hypotheses if name in h.ids))


def _where(found: Thermometer, named: tuple[str, ...]) -> list[Where]:
    region = Region(variable="time", start=found.region[0], stop=found.region[1], unit="s")
    return [Where(stage="temperature", channel=CHANNEL, component=component_of(named[0]), share=1.0, region=region, size=found.before, unit=UNIT,
                  ratio_over_floor=found.before / found.floor)]


def _shrink(found: Thermometer) -> ChannelShrink:
    above = max(found.before**2 - found.floor**2, 1e-12 * found.before**2)
    fraction = 1.0 - float(np.sqrt(max(0.0, found.after**2 - found.floor**2) / above))
    return ChannelShrink(channel=CHANNEL, before=found.before, after=found.after, floor=found.floor, unit=UNIT, fraction=fraction, interval=None)

"""A converter's characteristic from raw codes: what is left beside the carrier, over the level that the carrier has.

Fitting the carrier takes the curve's linear part away, burst by burst: so every candidate is fitted less its own linear part."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from wineglass.diagnosis.raw_codes import Burst

BINS = 100
"""of the level, in one burst"""
SPREAD = 2.0
"""of a bin's noise over the usual: there the curve jumps"""
LEFT = 0.1
"""of a curve's power that taking it out may leave"""
KNEES = 1.0 - np.geomspace(0.5, 5e-4, 24)
"""of the largest swing: where an amplifier may begin to give way"""
PRIMARY = "primary_adc_raw"
FUNDAMENTAL, SEEN = 2.0 / np.pi, 4.0
"""of a unit jump that a sine passes up and down; deviations of a jump that is there"""
NEAR_ZERO, LEAST_NEAR = 0.1, 100
"""FS, samples: where a jump at zero is looked for"""
SIMPLE = 0.9
"""of what bends at all, that a curve must explain to be believed"""


def straightened(burst: Burst) -> Burst:
    """Without what repeats at the same level of the signal, whatever its form: what is left is noise."""
    level = burst.smooth
    low, high = float(level.min()), float(level.max())
    if high - low < 1e-3:
        return burst
    place = np.minimum((BINS * (level - low) / (high - low)).astype(int), BINS - 1)
    number = np.bincount(place, minlength=BINS)
    mean = np.bincount(place, burst.rest, BINS) / np.maximum(number, 1)
    rest = burst.rest - mean[place]
    spread = np.bincount(place, rest**2, BINS) / np.maximum(number - 1, 1)
    jumps = spread > SPREAD * np.median(spread[number > 1])  # a step of the curve lies within
    kept = ~np.isin(place, np.flatnonzero(jumps)[:, None] + np.arange(-1, 2))
    columns = np.stack([np.ones(len(rest)), -np.cos(2.0 * burst.phase)], axis=1)[kept]
    if np.count_nonzero(kept) < 0.5 * len(rest):
        return burst
    factor = number[place] / np.maximum(number[place] - 1, 1)
    variance, modulation = np.linalg.lstsq(columns, (rest**2 * factor)[kept], rcond=None)[0]
    doubt = LEFT * max(0.0, float(np.mean(burst.bent**2)) - float(variance))
    return replace(burst, rest=np.where(kept, rest, 0.0), variance=float(variance), modulation=float(modulation), doubt=doubt,
                   modulation_sigma=float(np.hypot(variance * np.sqrt(4.0 / np.count_nonzero(kept)), doubt)))


def repeated(bursts: list[Burst]) -> float:
    """Log evidence that what is left hangs on the level of the signal, in whatever form, as a mean over all bursts."""
    whole, explained, occam = _by_level(bursts)
    left = max(whole - explained, 1e-3 * whole)
    return float(0.5 * sum(len(burst.bent) for burst in bursts) * np.log(whole / left) - occam)


def _by_level(bursts: list[Burst]) -> tuple[float, float, float]:
    """Sum of squares of what is left, the part of it that means over narrow bins of the level explain, and what so many means cost [nats]."""
    level, rest = np.concatenate([burst.smooth for burst in bursts]), np.concatenate([burst.bent for burst in bursts])
    place = np.clip(((level + 1.0) * BINS).astype(int), 0, 2 * BINS - 1)
    number, total = np.bincount(place), np.bincount(place, rest)
    used = number > 1
    return float(np.sum(rest**2)), float(np.sum(total[used] ** 2 / number[used])), float(0.5 * np.sum(np.log(1.0 + number[used])))


def jump_at_zero(bursts: list[Burst]) -> tuple[float, float]:
    """Of the curve between the levels just below and just above zero [FS], and its deviation: a wrong sign bit, or the teeth of segments."""
    level, rest = np.concatenate([burst.smooth for burst in bursts]), np.concatenate([burst.bent for burst in bursts])
    near = np.abs(level) < NEAR_ZERO
    if np.count_nonzero(near) < LEAST_NEAR:
        return 0.0, np.inf
    columns = np.stack([np.ones(int(near.sum())), level[near], np.sign(level[near])], axis=1)
    found, left = np.linalg.lstsq(columns, rest[near], rcond=None)[:2]
    variance = float(left[0]) / len(columns) if len(left) else 0.0
    return 2.0 * float(found[2]), 2.0 * float(np.sqrt(variance * np.linalg.inv(columns.T @ columns)[2, 2]))


def unread_fs(bursts: list[Burst]) -> float:
    """FS: amplitude at which a jump back at zero takes all that is there from the fundamental, so that a loop that wants to read nothing may rest there; 0
    without one. Of the primary's converter: the two are alike, and the secondary's hides its own."""
    jump_fs, deviation_fs = jump_at_zero([burst for burst in bursts if burst.channel == PRIMARY])
    return -FUNDAMENTAL * jump_fs if jump_fs < -SEEN * deviation_fs else 0.0


def giving_way(bursts: list[Burst]) -> float:
    """Log likelihood ratio of a curve that is straight up to a knee and bends beyond it, on one side or both, against a polynomial of fifth order."""
    largest = max(float(np.max(np.abs(burst.smooth))) for burst in bursts)
    rest = np.concatenate([_without_line(burst.bent, burst) for burst in bursts])
    total, explained, _ = _by_level(bursts)
    noise = max((total - explained) / len(rest), 1e-3 * total / len(rest))

    def unexplained(*curves: np.ndarray) -> float:
        """curves: (samples,) each."""
        found = np.linalg.lstsq(np.stack(curves, axis=1), rest, rcond=None)
        return float(np.sum((rest - np.stack(curves, axis=1) @ found[0]) ** 2))

    def curve(form: object) -> np.ndarray:
        return np.concatenate([_without_line(form(burst.smooth), burst) for burst in bursts])  # type: ignore[operator]

    polynomial = unexplained(*(curve(lambda x, n=n: x**n) for n in (2, 3, 4, 5)))
    bent = []
    for knee in KNEES * largest:
        up, down = curve(lambda x, k=knee: np.maximum(x - k, 0.0)), curve(lambda x, k=knee: np.maximum(-x - k, 0.0))
        bent += [unexplained(up), unexplained(down), unexplained(up - down)]
    whole, best = float(np.sum(rest**2)), min(bent)
    if whole - best < SIMPLE * explained:
        return -np.inf
    return 0.5 * (polynomial - best) / noise


def _without_line(values: np.ndarray, burst: Burst) -> np.ndarray:
    """values (samples,) less what fitting offset and carrier would take away."""
    columns = np.stack([np.ones_like(burst.phase), np.cos(burst.phase), np.sin(burst.phase)], axis=1)
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]

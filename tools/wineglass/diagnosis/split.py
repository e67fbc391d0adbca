"""Which blocks are held out: whole thermal branches, never interleaved samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis.blocks import Blocks

LEAST_SHARE = 0.15
LEAST_INSIDE = 0.3
MARGIN = 0.01


@dataclass(frozen=True)
class Split:
    """Masks (n,): fit and held never overlap. Held blocks outside the temperatures of the fit part are not scored."""

    name: str
    fit: np.ndarray
    held: np.ndarray


def primary(blocks: Blocks) -> Split:
    """After the temperature maximum; else the last branch; else the last third of the time."""
    n = len(blocks)
    index = np.arange(n)
    options = [("everything after the temperature maximum", int(np.argmax(blocks.temperature_degc)))]
    if len(blocks.branches) > 1:
        options.append(("the last thermal branch", blocks.branches[-1].start))
    for name, start in options:
        split = _split(blocks, name, index >= start)
        if split is not None:
            return split
    split = _split(blocks, "the last third of the time", index >= (2 * n) // 3)
    later = index >= (2 * n) // 3
    return split or Split("the last third of the time", ~later, later)


def _split(blocks: Blocks, name: str, held: np.ndarray) -> Split | None:
    fit = ~held
    if min(fit.mean(), held.mean()) < LEAST_SHARE:
        return None
    seen = blocks.temperature_degc[fit]
    margin = MARGIN * float(np.ptp(seen))
    inside = (blocks.temperature_degc >= seen.min() - margin) & (blocks.temperature_degc <= seen.max() + margin)
    scored = held & inside
    return Split(name, fit, scored) if scored.sum() >= LEAST_INSIDE * held.sum() else None

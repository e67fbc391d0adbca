"""One row of the performance table."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

REPETITIONS = 5


@dataclass(frozen=True)
class Row:
    """ns a sample of ours and of the reference, best of a few interleaved repetitions."""

    what: str
    reference: str
    ours_ns: float
    reference_ns: float

    @property
    def speedup(self) -> float:
        return self.reference_ns / self.ours_ns


def side_by_side(what: str, reference: str, samples: int, ours: Callable[[], object], theirs: Callable[[], object],
                 reference_samples: int | None = None) -> Row:
    """Runs both in turn, so that both see the same machine; processor time, so that others on it count little."""
    best = [float("inf"), float("inf")]
    for _ in range(REPETITIONS):
        for index, call in enumerate((ours, theirs)):
            begin = time.process_time()
            call()
            best[index] = min(best[index], time.process_time() - begin)
    return Row(what, reference, 1e9 * best[0] / samples, 1e9 * best[1] / (reference_samples or samples))

"""Two device descriptions against one recording: which twin is closer, in which channel, and by how much.

Both full twins run with the recorded inputs (temperature, true rate, commands, calibration) and with the same noise; the floor is what two runs of
the closer twin differ by when only their noise does. Nothing is fitted.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wineglass.device import Device
from wineglass.diagnosis import channels as frames
from wineglass.diagnosis import drive
from wineglass.diagnosis.drive import Driven
from wineglass.errors import BadInput
from wineglass.recording import Recording
from wineglass.simulation import simulate

SEED = 0xC0FFEE  # no recording's
PIECES = 24  # contiguous, drawn again for the intervals
DRAWS = 2000
LEAST_FRAMES = 4 * PIECES
REST = 1e-9  # of a channel's size: a floor below that is none (quantised away, or imposed)


@dataclass(frozen=True)
class Interval:
    """95 %"""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Channel:
    """rms of recorded minus twin; ratio: of B's rms to A's"""

    name: str
    unit: str
    a: float
    b: float
    floor: float
    ratio: Interval


@dataclass(frozen=True)
class Comparison:
    """closer: "a", "b" or "" where the intervals do not tell. a, b: rms over all channels in multiples of their floors.
    removed: share of the farther twin's amplitude above the floor that the closer one does without; None where neither is above it"""

    channels: list[Channel]
    a: float
    b: float
    ratio: Interval
    closer: str
    removed: Interval | None
    frames: int
    frame_s: float
    temperature_from: str
    notes: list[str]


def compare(recording: Recording, a: Device, b: Device, progress: Callable[[int], None] = lambda blocks: None) -> Comparison:
    """progress(blocks simulated since the last call); `runs()` times the n_blocks of the driven run in all."""
    grid = frames.grid_of(recording)
    driven = drive.from_recording(recording, a)
    measured = frames.read(recording, grid)
    left, right, again = (_twin(drive.from_recording(recording, device), grid, seed, progress) for device, seed in ((a, SEED), (b, SEED), (a, SEED + 1)))
    names = [n for n in measured.names if n in left.names and n in right.names and not (n == driven.temperature_from)]
    use = np.all([f.use[[f.names.index(n) for n in names]] for f in (measured, left, right, again)], axis=0)
    names = [name for name, row in zip(names, use) if row.sum() >= LEAST_FRAMES]
    if not names:
        raise BadInput("too few sound samples to compare", recording.path, "record longer, with the drive locked")
    return _compared(names, measured, (left, right, again), driven)


def runs() -> int:
    """How many twin runs a comparison takes."""
    return 3


def _compared(names: list[str], measured: frames.Frames, twins: tuple[frames.Frames, ...], driven: Driven) -> Comparison:
    pieces = _Pieces(measured.grid.count)
    found, kept = [], []
    for name in names:
        use = np.all([f.use[f.names.index(name)] for f in (measured, *twins)], axis=0)
        to_a, to_b = (np.where(use, measured[name] - twin[name], 0.0) for twin in twins[:2])
        noise = np.where(use, twins[2][name] - twins[0][name], 0.0)
        floor = float(np.sqrt(np.sum(noise**2) / use.sum()))
        if floor <= REST * float(np.max(np.abs(measured[name][use]))):
            continue
        squares = pieces.sums(np.stack([to_a**2, to_b**2, use.astype(float)]))
        found.append(Channel(name, frames.unit_of(name), *_rms(squares), floor, _ratio(pieces, squares)))
        kept.append(squares / np.array([floor**2, floor**2, 1.0])[:, None])
    if not found:
        raise BadInput("no channel has a noise floor to compare with", "compare", "record baseband or output")
    return _total(found, np.sum(kept, axis=0), pieces, measured, driven)


def _total(found: list[Channel], squares: np.ndarray, pieces: _Pieces, measured: frames.Frames, driven: Driven) -> Comparison:
    a, b = _rms(squares)
    ratio = _ratio(pieces, squares)
    closer = "b" if ratio.high < 1.0 else "a" if ratio.low > 1.0 else ""
    return Comparison(found, a, b, ratio, closer, _removed(pieces, squares, closer), measured.grid.count, measured.grid.frame_s,
                      driven.temperature_from, list(driven.notes))


def _rms(squares: np.ndarray) -> tuple[float, float]:
    totals = squares.sum(axis=1)
    return float(np.sqrt(totals[0] / totals[2])), float(np.sqrt(totals[1] / totals[2]))


def _ratio(pieces: _Pieces, squares: np.ndarray) -> Interval:
    totals, drawn = squares.sum(axis=1), pieces.drawn(squares)
    values = np.sqrt(drawn[1] / np.maximum(drawn[0], 1e-300))
    low, high = np.quantile(values, [0.025, 0.975])
    return Interval(float(np.sqrt(totals[1] / max(totals[0], 1e-300))), float(low), float(high))


def _removed(pieces: _Pieces, squares: np.ndarray, closer: str) -> Interval | None:
    """squares in multiples of the floor, so that the floor is one."""
    far, near = (0, 1) if closer == "b" else (1, 0)
    totals, drawn = squares.sum(axis=1), pieces.drawn(squares)
    if not closer or totals[far] / totals[2] <= 1.0 + 3.0 * np.sqrt(2.0 / totals[2]):
        return None

    def fraction(sums: np.ndarray) -> np.ndarray:
        above = np.maximum(sums[[far, near]] / sums[2] - 1.0, 0.0)
        return 1.0 - np.sqrt(above[1] / np.maximum(above[0], 1e-12))

    low, high = np.quantile(fraction(drawn), [0.025, 0.975])
    return Interval(float(fraction(totals)), float(low), float(high))


class _Pieces:
    """Contiguous pieces of the record, drawn again with replacement, the same draws for every channel."""

    def __init__(self, count: int):
        self._edges = np.linspace(0, count, PIECES + 1).astype(int)[:-1]
        self._drawn = np.random.default_rng(SEED).integers(0, PIECES, (DRAWS, PIECES))

    def sums(self, values: np.ndarray) -> np.ndarray:
        """(k, n) -> (k, PIECES)"""
        return np.add.reduceat(values, self._edges, axis=1)

    def drawn(self, sums: np.ndarray) -> np.ndarray:
        """(k, PIECES) -> totals (k, DRAWS)"""
        return sums[:, self._drawn].sum(axis=2)


def _twin(driven: Driven, grid: frames.Grid, seed: int, progress: Callable[[int], None]) -> frames.Frames:
    """The full twin's recording of the same day, read like the real one."""
    run = driven.run
    seeded = type(run)(run.scenario.model_copy(update={"seed": seed}), run.device, run.truth)
    with _scratch() as path:
        simulate(seeded, path, progress, calibration_block=driven.calibration_block)
        with Recording.open(path) as simulated:
            return frames.read(simulated, grid)


@contextmanager
def _scratch() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="wineglass-") as folder:
        yield Path(folder) / "twin.h5"

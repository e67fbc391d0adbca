"""What comes and goes: an effect that acts in stretches of time, found in what an explanation leaves.

No plain law is on and off, and no linear pass can try all moments. So the effect's doing is cut into cells, and stretches of cells are taken one after the other, the
one first that explains most; then the cells at their ends are cut finer, until they are frames. What is uncertain, and the explanation's unknowns, move along.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from wineglass import effects
from wineglass.diagnosis import explain, system
from wineglass.diagnosis.beside import LARGEST
from wineglass.diagnosis.closure import Closed, Closer, NoNumbersError
from wineglass.diagnosis.responses import REACH, Variant
from wineglass.diagnosis.unknowns import Unknown
from wineglass.effects import Setting

CELLS = 60  # of the whole recording, to begin with: what is shorter, or nearer to each other, may be missed
FINER, ABOUT = 6, 1.5  # parts of a cell beside the end of a stretch; cells on either side of it that are cut
LEAST_GAIN = 12.0  # nats that a stretch gains: its place is one of thousands
NOISE = 1.2  # energy per frame that is no more than noise
KEPT = 0.1  # of what is left beyond noise, that stretches may leave
SWEEPS = 3  # in which every stretch is looked for again beside the others
ROUNDS = 3  # in which what is left says how much channels count
LEAST_LEFT = 0.5  # energy per frame: less says nothing about how well a channel is met
MOMENT_S = 2.0  # prior of a moment about the frame that was found


@dataclass(frozen=True)
class Switched:
    """An effect that may come and go. strength: of what does; always: shapes with which it acts all the time; ends: names of the beginning and the duration of each
    stretch."""

    effect: str
    strength: str
    always: dict[str, float]
    ends: tuple[tuple[str, str], ...]


SWITCHED = (
    Switched("vibration", "rectified_rad_s", {}, tuple((f"begin_{i}_s", f"lasts_{i}_s") for i in range(1, 5))),
    Switched("damping_step", "damping", {"time_s": 0.0}, (("time_s", "lasts_s"),)),
)
Stretch = tuple[int, int]
"""Of cells: the first, and the one after the last"""


def beside(closer: Closer, closed: Closed) -> list[Closed]:
    """The explanation with an effect that comes and goes beside its others, each that leaves little: whatever comes and goes is a bit like four stretches."""
    found = list[Closed]()
    for switched in SWITCHED:
        if switched in able(closed) and switched.effect in closer.responses.variants:
            with suppress(NoNumbersError):
                others = closer.without(closed, switched.effect) if switched.effect in closed.support else closed
                grown = _with(closer, others, switched)
                if grown is not None and _excess(closer, grown) < KEPT * _excess(closer, closed):
                    found.append(grown)
    return found


def able(closed: Closed) -> list[Switched]:
    """Effects that could come and go beside an explanation, or in it, if they do not yet."""
    switching = {u.effect for u in closed.unknowns if any(u.name == lasts for one in SWITCHED for _, lasts in one.ends)}
    return [one for one in SWITCHED if one.effect not in switching and len({*closed.support, one.effect}) <= LARGEST]


def _excess(closer: Closer, closed: Closed) -> float:
    """Energy beyond noise that an explanation leaves, of all channels."""
    left = closed.products.left(explain.posterior_mean(closed.products.pooled(np.ones(len(closer.system.names))), closed.places)[0])
    return float(np.sum(np.maximum(0.0, left - NOISE * closer.system.n_rows)))


def _with(closer: Closer, closed: Closed, switched: Switched) -> Closed | None:
    """None: nothing comes and goes as this effect would."""
    record = next(p for p in effects.find(switched.effect).parameters if p.name == switched.strength)
    always = closer.bench.tried([*closed.settings, Setting(switched.effect, {switched.strength: record.typical, **switched.always})])[closer.pick] - closed.response
    edges, stretches, size = _Cells(closer, closed, always).found(len(switched.ends))
    if not stretches:
        return None
    frame_s, begin_s = closer.bench.grid.frame_s, closer.bench.grid.first * closer.bench.grid.frame_s
    unknowns = [Unknown(switched.effect, record.name, "strength", size * record.typical, 0.0, REACH * record.typical, record.low, record.high)]
    shapes = dict[str, float]()
    for (first, last), (begin, lasts) in zip(stretches, switched.ends, strict=False):
        shapes |= {begin: begin_s + edges[first] * frame_s, lasts: (edges[last] - edges[first]) * frame_s}
    by_name = {p.name: p for p in effects.find(switched.effect).parameters}
    unknowns += [Unknown(switched.effect, name, "shape", value, value, MOMENT_S, by_name[name].low, by_name[name].high) for name, value in shapes.items()]
    rows = np.zeros((len(unknowns), *always.shape))
    rows[0] = always / record.typical * _mask(edges, stretches, always.shape[-1])
    return closer.grown(closed, (Variant(switched.effect, (), shapes),), unknowns, rows)


def _mask(edges: np.ndarray, stretches: list[Stretch], count: int) -> np.ndarray:
    """(count,): 1 in frames of a stretch."""
    mask = np.zeros(count)
    for first, last in stretches:
        mask[edges[first] : edges[last]] = 1.0
    return mask


class _Cells:
    """always (channels, n): what the effect does all the time beside an explanation. Cells are given by their edges, in frames."""

    def __init__(self, closer: Closer, closed: Closed, always: np.ndarray):
        self._closer, self._closed, self._always = closer, closed, always
        built = closer.system
        self._own = built.whiten(closed.jacobian * np.array([u.spread for u in closed.unknowns])[:, None, None])
        self._about = np.array([(v - u.middle) / u.spread for u, v in zip(closed.unknowns, closed.values, strict=True)])
        self._data = built.data - built.whiten(closed.response)

    def found(self, most: int) -> tuple[np.ndarray, list[Stretch], float]:
        """Edges of cells (k + 1,), at most so many stretches, in their order, and how large the effect is in them, in multiples of always."""
        count = self._always.shape[-1]
        edges = np.unique(np.linspace(0, count, CELLS + 1).astype(int))
        found, cell = self._coarsely(edges, most), count / CELLS
        while found.stretches and cell > 1.0:
            ends = [int(edges[i]) for stretch in found.stretches for i in stretch]
            near = np.array([np.linspace(end - ABOUT * cell, end + ABOUT * cell, int(2 * ABOUT * FINER) + 1) for end in ends]).astype(int)
            finer = np.unique(np.clip(np.concatenate([edges, near.ravel(), ends]), 0, count))
            moved = [(int(np.searchsorted(finer, edges[a])), int(np.searchsorted(finer, edges[b]))) for a, b in found.stretches]
            edges, cell = finer, cell / FINER
            found = self._search(self._products(edges), found.softening, moved, most)
        whole = found.stretches == [(0, len(edges) - 1)]
        return edges, [] if whole else sorted(found.stretches), found.size

    def _coarsely(self, edges: np.ndarray, most: int) -> _Search:
        """Channels count as much as what is left in them allows, which the stretches change: begun with all as they are, and as they are without any stretch."""
        table, tried = self._products(edges), []
        for softening in (np.ones(len(table.generic)), self._softening(table)):
            for _ in range(ROUNDS):
                tried.append(self._search(table, softening, [], most))
                softening = tried[-1].softening
        return min(tried, key=lambda found: found.misfit)

    def _products(self, edges: np.ndarray) -> system.Products:
        """Of what is uncertain, the explanation's unknowns and, behind them, the cells."""
        closer, k = self._closer, len(edges) - 1
        cells = np.zeros((k, *self._always.shape))
        for i, (first, last) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
            cells[i, :, first:last] = self._always[:, first:last]
        more = np.concatenate([self._own, closer.system.whiten(cells)])
        return system.grown(closer.system, closer.table, closer.nuisance, more, np.concatenate([self._about, np.zeros(k)]), self._data)

    def _search(self, table: system.Products, softening: np.ndarray, stretches: list[Stretch], most: int) -> _Search:
        """All that is uncertain moves along; softening (channels,): energy per frame that counts as noise."""
        known, match, cells = self._parted(table, softening)
        found, size = _searched(cells, match, list(stretches), most)
        coefficients = np.concatenate([np.zeros(self._known), size * _mask(np.arange(len(match) + 1), found, len(match))])
        coefficients[: self._known] = known @ np.append(-coefficients[self._known :], 1.0)
        left = table.left(coefficients) / self._rows
        return _Search(found, size, left, float(np.sum(self._rows * np.log(np.maximum(left, LEAST_LEFT)))))

    def _softening(self, table: system.Products) -> np.ndarray:
        """(channels,): energy per frame that is left without any stretch, at least one."""
        known, _, cells = self._parted(table, np.ones(len(table.generic)))
        return np.maximum(1.0, table.left(np.concatenate([known[:, -1], np.zeros(len(cells))])) / self._rows)

    def _parted(self, table: system.Products, softening: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients of what moves along, for each cell and for what is left (known, k + 1); products of the cells with what is left (k,), and with each other."""
        gram, first = table.pooled(softening), self._known
        known = cho_solve(cho_factor(gram[:first, :first] + np.eye(first)), gram[:first, first:])
        reduced = gram[first:, first:] - gram[:first, first:].T @ known
        return known, reduced[:-1, -1], reduced[:-1, :-1]

    @property
    def _known(self) -> int:
        return len(self._closer.nuisance) + len(self._own)

    @property
    def _rows(self) -> np.ndarray:
        return np.maximum(self._closer.system.n_rows, 1)


@dataclass(frozen=True)
class _Search:
    """Stretches of cells, the effect's size in them, energy per frame that they leave (channels,), and how badly all channels are met, whatever their
    noise."""

    stretches: list[Stretch]
    size: float
    left: np.ndarray
    misfit: float

    @property
    def softening(self) -> np.ndarray:
        """(channels,): energy per frame that counts as noise."""
        return np.maximum(1.0, self.left)


def _searched(gram: np.ndarray, match: np.ndarray, stretches: list[Stretch], most: int) -> tuple[list[Stretch], float]:
    """Stretches of cells that explain most when all have one size, and that size: one more as long as that gains enough, and each again beside the others."""
    sums = _Sums(gram, match)
    while True:
        for _ in range(SWEEPS):
            before = list(stretches)
            for place in range(len(stretches)):
                others = stretches[:place] + stretches[place + 1 :]
                stretches[place : place + 1] = [sums.best(others)[0]]
            if stretches == before:
                break
        if len(stretches) == most:
            break
        more, gain = max((sums.added(stretches), sums.split(stretches)), key=lambda found: found[1])
        if gain - sums.gain(stretches) < LEAST_GAIN:
            break
        stretches = more
    return stretches, sums.size(stretches)


class _Sums:
    """Sums of products over stretches of cells, all of them at once."""

    def __init__(self, gram: np.ndarray, match: np.ndarray):
        self._gram, self._match = gram, match
        k = len(match)
        whole = np.zeros((k + 1, k + 1))
        whole[1:, 1:] = np.cumsum(np.cumsum(gram, axis=0), axis=1)
        own = np.diagonal(whole)
        self._own = own[:, None] + own[None, :] - whole - whole.T
        self._along = self._of(match)
        first, last = np.arange(k + 1)[:, None], np.arange(k + 1)[None, :]
        self._ordered = first < last

    @staticmethod
    def _of(row: np.ndarray) -> np.ndarray:
        """(k + 1, k + 1): sums of a row (k,) from one cell to before another one."""
        total = np.concatenate([[0.0], np.cumsum(row)])
        return total[None, :] - total[:, None]

    def _mask(self, stretches: list[Stretch]) -> np.ndarray:
        return _mask(np.arange(len(self._match) + 1), stretches, len(self._match))

    def gain(self, stretches: list[Stretch]) -> float:
        mask = self._mask(stretches)
        size = float(mask @ self._gram @ mask)
        return 0.5 * float(mask @ self._match) ** 2 / size if size > 0.0 else 0.0

    def size(self, stretches: list[Stretch]) -> float:
        mask = self._mask(stretches)
        energy = float(mask @ self._gram @ mask)
        return float(mask @ self._match) / energy if energy > 0.0 else 0.0

    def best(self, others: list[Stretch]) -> tuple[Stretch, float]:
        """The one that gains most beside others, which it does not touch, and what all of them gain."""
        mask = self._mask(others)
        touched = self._of(np.convolve(mask, np.ones(3), "same") > 0.0) > 0.0
        return self._most(mask, 1.0, ~touched)

    def added(self, stretches: list[Stretch]) -> tuple[list[Stretch], float]:
        """With the best one more beside them, and what all gain."""
        one, gain = self.best(stretches)
        return [*stretches, one], gain

    def split(self, stretches: list[Stretch]) -> tuple[list[Stretch], float]:
        """With the best gap within one of them, and what all gain."""
        mask = self._mask(stretches)
        inner = np.convolve(mask, np.ones(3), "same") > 2.0
        (first, last), gain = self._most(mask, -1.0, self._of(~inner) == 0.0)
        parts = [part for a, b in stretches for part in ([(a, first), (last, b)] if a < first and last < b else [(a, b)])]
        return parts, gain if len(parts) > len(stretches) else 0.0

    def _most(self, mask: np.ndarray, sign: float, able: np.ndarray) -> tuple[Stretch, float]:
        """The stretch that gains most when it is added to a mask, or taken out of it, of those that are able (k + 1, k + 1)."""
        energy = float(mask @ self._gram @ mask) + 2.0 * sign * self._of(self._gram @ mask) + self._own
        able = able & self._ordered & (energy > 1e-9 * float(np.max(self._own, initial=0.0)))
        match = float(mask @ self._match) + sign * self._along
        gains = np.where(able, 0.5 * match**2 / np.where(able, energy, 1.0), 0.0)
        first, last = np.unravel_index(int(np.argmax(gains)), gains.shape)
        return (int(first), int(last)), float(gains[first, last])

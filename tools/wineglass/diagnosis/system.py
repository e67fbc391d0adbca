"""Recorded minus twin as one linear system: whitened residuals of all channels, and whitened responses of everything that may explain them.

Rows are frames, channel by channel; a frame that is not sound has weight zero in data and responses alike. What is kept are inner products
per channel and fold, so that any set of effects, any weighting of the channels and any fold held out costs a small solve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from wineglass.diagnosis.channels import Frames, Grid
from wineglass.diagnosis.floors import SHORT_ORDER, Floor

FOLDS = 5
LEAST_NOISE, MOST_NOISE = 0.8, 2.2  # of the described floor: twice the noise is no gap of the means; more may be one that moves fast
MOST_SHAKEN, TAIL = 50.0, 0.9  # where single events shake the shell, or harmonics beat: one frame in ten says how much
ENOUGH, FEW = 20, 8  # changes that say how large noise is; where it surely is more than described
WILD, MOST_WILD = 6.0, 0.3  # of what changes usually, and of the frames: beyond that, it is what this recording is like
MOVING = 5e-4  # of the change from frame to frame of the secondary: so far the twins are believed to follow what moves fast
LOSSES = 1.5  # floors of the losses: so much of their flicker is faster than what wanders
JUMP = 1e-3  # of the change from frame to frame, where the rate steps: recorded means do not say how the step went
SETTLING = {"primary_in_phase": 1e-3, "drive_level": 2e-2, "drive_frequency": 1e-3}
"""of the change from frame to frame: what channels are not to be believed to while a loop settles"""
HELD = 20.0
"""floors of the amplitude while its loop holds it: what it shows then is how that loop came back from its limits, which no slope tells"""
REDUNDANT = ("rate_uncompensated", "rate", "quadrature")
"""what the firmware computes from the baseband: the same noise again"""
BALANCED, UNBALANCED = ("primary_quadrature",), 2.0
"""channels whose noise is taken back within milliseconds by a loop: where a part of it is lost the rest stands out, by so many floors more"""
SMOOTH_TERMS = 20


@dataclass(frozen=True)
class System:
    """floor: of `names`; weight (channels, n): 0 where a frame is not used; folds: row -> fold; basis: per channel (n, k), orthonormal, of
    generic discrepancies; data (channels, n): whitened recorded minus base."""

    grid: Grid
    names: tuple[str, ...]
    floor: Floor
    weight: np.ndarray
    fold: np.ndarray
    basis: tuple[np.ndarray, ...]
    data: np.ndarray

    def whiten(self, series: np.ndarray) -> np.ndarray:
        """(..., channels, n) in the channels' units -> whitened and weighted."""
        rows = series.reshape(-1, *series.shape[-2:])
        found = np.empty_like(rows)
        for i in range(len(self.names)):
            live = rows[:, i].any(axis=1)  # what is uncertain moves a few channels only
            found[~live, i] = 0.0
            found[live, i] = self.floor.whiten(i, np.where(self.weight[i] > 0, rows[live, i], 0.0)) * self.weight[i]
        return found.reshape(series.shape)

    def noise_left(self, left: np.ndarray) -> np.ndarray:
        """(channels,): size of the noise in a whitened residual (channels, n), in floors."""
        sizes = []
        for i, row in enumerate(left):
            change = _changes(row, self.weight[i] > 0.5)
            sizes.append(spread(change) if len(change) > ENOUGH else 1.0)
        return np.array(sizes)

    @property
    def n_rows(self) -> np.ndarray:
        """Used frames per channel."""
        return np.count_nonzero(self.weight, axis=1)


def chosen(names: tuple[str, ...], floor: Floor) -> list[int]:
    """Channels with noise, without those that repeat the baseband."""
    baseband = any(name.startswith(("secondary_", "rebalance_")) for name in names)
    return [i for i, name in enumerate(names) if floor.rms[i] > 0.0 and not (baseband and name in REDUNDANT)]


def build(recorded: Frames, base: Frames, floor: Floor, names: tuple[str, ...], edges_s: list[float], jumps: np.ndarray,
          regressors: np.ndarray | None, losses: float = 0.0, aside: np.ndarray | None = None) -> System:
    """names: the channels of floor. jumps (n,): frames in which the rate steps; regressors (m, n): inputs that an unknown effect may follow, None:
    nothing unknown is asked for; losses: relative floor of the resonator's, which open loop is one of the scale factor too; aside (n,): frames in the loop that was
    in use for the shorter time."""
    grid = recorded.grid
    difference = np.array([recorded[name] - base[name] for name in names])
    use = np.array([recorded.use[recorded.names.index(n)] & base.use[base.names.index(n)] for n in names])
    restless = recorded.shaken or recorded.beating
    floor = _unbalanced(floor, names) if restless else floor
    weight = use * _trust(base, names, floor, jumps, losses)
    for name in (n for n in names if n in BALANCED):
        place = names.index(name)
        weight[place] /= 1.0 + UNBALANCED * _after(~use[place] if recorded.bridged is None else ~use[place] | recorded.bridged)
    if recorded.shaken:
        weight = _without_shakes(floor, weight, difference)
    floor = _scaled(floor, weight, difference, restless, recorded.shaken, [name in recorded.freed for name in names])
    empty = System(grid, names, floor, weight, _folds(grid, edges_s, aside), (), difference)
    basis = tuple(np.zeros((grid.count, 0)) if regressors is None else _basis(empty, i, regressors) for i in range(len(names)))
    return replace(empty, basis=basis, data=empty.whiten(difference))


def _unbalanced(floor: Floor, names: tuple[str, ...]) -> Floor:
    """With white noise where it would be taken back: too much of it is missing between events for one frame to foretell the next."""
    white = np.array([name in BALANCED for name in names])
    return Floor(floor.rms, np.where(white, floor.rms, floor.innovation), np.where(white[:, None], 0.0, floor.coefficients))


def _without_shakes(floor: Floor, weight: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Weights without frames that change as hardly any others do: single events that were not seen shook them."""
    calm = weight.copy()
    for i, row in enumerate(difference):
        use = weight[i] > 0.5
        change = np.diff(floor.whiten(i, _bridged(row, weight[i] > 0)))
        both = use[1:] & use[:-1]
        if np.count_nonzero(both) <= ENOUGH:
            continue
        wild = both & (np.abs(change) > WILD * spread(change[both]))
        shaken = np.append(wild, False) | np.insert(wild, 0, False)
        if np.count_nonzero(shaken & use) <= MOST_WILD * np.count_nonzero(use):
            calm[i, shaken] = 0.0
    return calm


def _bridged(row: np.ndarray, use: np.ndarray) -> np.ndarray:
    """(n,): straight lines over what is not used, so that where it ends nothing jumps."""
    frames = np.arange(len(row))
    return np.interp(frames, frames[use], row[use]) if use.any() else np.zeros(len(row))


def _scaled(floor: Floor, weight: np.ndarray, difference: np.ndarray, restless: bool, shaken: bool, freed: list[bool]) -> Floor:
    """The floor as large as the recording's own fastest changes show it: how much noise there is, is another question than what moves. freed (channels):
    where too few frames are steady, because the loop was open for a short while only, what is left of the lines is noise."""
    factors = []
    for i, row in enumerate(difference):
        used, steady = weight[i] > 0, weight[i] > 0.5
        few = freed[i] and np.count_nonzero(steady) <= ENOUGH
        white = floor.whiten(i, _bridged(row, used) if shaken or few else np.where(used, row, 0.0))
        change = _changes(white, used if few else steady)
        most, part = (MOST_SHAKEN, TAIL) if restless or few else (MOST_NOISE, 0.5)
        factors.append(min(most, max(LEAST_NOISE, spread(change, part))) if len(change) > (FEW if few else ENOUGH) else 1.0)
    return Floor(floor.rms * factors, floor.innovation * factors, floor.coefficients)


def _changes(white: np.ndarray, use: np.ndarray) -> np.ndarray:
    """From frame to frame, of neighbours that are both used."""
    return np.diff(white)[use[1:] & use[:-1]]


def spread(change: np.ndarray, part: float = 0.5) -> float:
    """Standard deviation of white noise from its changes, whatever moves slowly; from the size that this part of them does not exceed."""
    return float(np.quantile(np.abs(change), part)) / (float(ndtri(0.5 + 0.5 * part)) * np.sqrt(2.0))


def _trust(base: Frames, names: tuple[str, ...], floor: Floor, jumps: np.ndarray, losses: float) -> np.ndarray:
    """Weights (channels, n): less where the noise grows with falling amplitude, and where loops settle."""
    weight = np.ones((len(names), base.grid.count))
    amplitude = base["primary_in_phase"] if "primary_in_phase" in base.names else np.ones(base.grid.count)
    usual = np.median(amplitude)
    for i, name in enumerate(names):
        noise = np.full(base.grid.count, floor.innovation[i])
        if name == "drive_frequency" and usual > 0:
            noise *= np.maximum(1.0, usual / np.maximum(amplitude, 0.05 * usual))
        if name == "primary_in_phase" and "drive_level" in base.names:
            noise = np.where(np.abs(base["drive_level"]) > 0.0, HELD * noise, noise)
        if name in SETTLING:
            change = np.abs(np.gradient(base[name]))
            moving = np.maximum.reduce([np.roll(change, k) for k in range(-3, 7)])
            noise = np.hypot(noise, SETTLING[name] * moving)
        if name.startswith(("secondary", "rebalance")):
            change = np.abs(np.gradient(base[name]))
            noise = np.hypot(noise, MOVING * np.maximum.reduce([np.roll(change, k) for k in range(-1, 3)]))
            axis = name.split("_")[0]
            both = np.maximum(*(np.abs(np.gradient(base[n])) if n in base.names else change for n in (f"{axis}_in_phase", f"{axis}_quadrature")))
            doubt = np.where(jumps, JUMP * np.maximum(both, np.roll(both, 1)), 0.0)
            noise = np.hypot(noise, np.maximum.reduce([np.roll(doubt, k) for k in range(SHORT_ORDER + 1)]))
        if name.startswith("secondary"):
            noise = np.hypot(noise, LOSSES * losses * np.abs(base[name]))
        weight[i] = floor.innovation[i] / noise
    return weight


def _after(gap: np.ndarray) -> np.ndarray:
    """(n,): 1 in frames with a gap in them or shortly before them."""
    return np.maximum.reduce([np.concatenate([np.zeros(k), gap[: len(gap) - k]]) for k in range(SHORT_ORDER + 1)])


def _folds(grid: Grid, edges_s: list[float], aside: np.ndarray | None) -> np.ndarray:
    """Contiguous stretches of about equal length that end at edges, where there are some near by; frames set aside in stretches of their own, because what
    is seen in that loop alone cannot be told from the other one."""
    start, end = grid.first * grid.frame_s, (grid.first + grid.count) * grid.frame_s
    step = (end - start) / FOLDS
    cuts = []
    for i in range(1, FOLDS):
        wanted = start + i * step
        near = [edge for edge in edges_s if abs(edge - wanted) < 0.3 * step]
        cuts.append(min(near, key=lambda edge: abs(edge - wanted)) if near else wanted)
    folds = np.searchsorted(np.array(cuts), grid.time_s)
    if aside is not None and np.count_nonzero(aside) >= FOLDS:
        folds[aside] = np.arange(np.count_nonzero(aside)) * FOLDS // np.count_nonzero(aside)
    return folds


def _basis(system: System, channel: int, regressors: np.ndarray) -> np.ndarray:
    n = system.grid.count
    waves = np.cos(np.pi * np.outer(np.arange(SMOOTH_TERMS), np.arange(n) + 0.5) / n)
    series = np.concatenate([waves, regressors])
    masked = np.where(system.weight[channel] > 0, series, 0.0)
    white = (system.floor.whiten(channel, masked) * system.weight[channel]).T
    white = white / np.maximum(np.linalg.norm(white, axis=0), 1e-300)
    left, sizes, _ = np.linalg.svd(white, full_matrices=False)
    return left[:, sizes > 1e-6 * sizes[0]] if sizes[0] > 0 else left[:, :0]


@dataclass(frozen=True)
class Products:
    """Inner products of columns (k of them) and data: gram (folds, channels, k + 1, k + 1), the data last; generic: per channel (m, k + 1),
    projections onto the basis of generic discrepancies. about (k,): coefficients at which the data were taken; those that are sought here are
    counted from there, and their standard normal priors lie at -about. Counted from zero, a frequency that is uncertain by 1e8 floors would leave
    nothing of the others' last digits."""

    gram: np.ndarray
    generic: tuple[np.ndarray, ...]
    about: np.ndarray

    @property
    def count(self) -> int:
        return self.gram.shape[-1] - 1

    def pooled(self, softening: np.ndarray, folds: list[int] | None = None) -> np.ndarray:
        """(k + 1, k + 1): channels weighted by 1/softening, summed over folds (None: all), with the priors' middles in the last row and column."""
        chosen = self._everywhere if folds is None else self.gram[folds].sum(axis=0)
        return self.with_priors(chosen, list(range(self.count)), softening)

    def everywhere(self, places: list[int]) -> np.ndarray:
        """(channels, p + 1, p + 1): products over all folds, of some columns and the data."""
        chosen = np.array([*places, self.count])
        return self._everywhere[:, chosen[:, None], chosen]

    def with_priors(self, block: np.ndarray, places: list[int], softening: np.ndarray) -> np.ndarray:
        """(p + 1, p + 1): `everywhere` with channels weighted by 1/softening, and the priors' middles in the last row and column."""
        whole, about = np.tensordot(1.0 / softening, block, 1), self.about[places]
        whole[-1, :-1] -= about
        whole[:-1, -1] -= about
        whole[-1, -1] += float(self.about @ self.about)
        return whole

    def left(self, coefficients: np.ndarray) -> np.ndarray:
        """(channels,): energy left by coefficients (k,) of all columns, counted from `about`."""
        combination = np.append(-coefficients, 1.0)
        return (self._everywhere @ combination) @ combination

    @cached_property
    def _everywhere(self) -> np.ndarray:
        """(channels, k + 1, k + 1): over all folds."""
        return self.gram.sum(axis=0)


def products(system: System, columns: np.ndarray, about: np.ndarray | None = None, data: np.ndarray | None = None) -> Products:
    """columns (k, channels, n) whitened and scaled so that their coefficients have standard normal priors; about: None for zero; data: None takes
    the system's."""
    data = system.data if data is None else data
    k = len(columns)
    gram = np.zeros((FOLDS, len(system.names), k + 1, k + 1))
    generic = []
    for c in range(len(system.names)):
        rows = np.concatenate([columns[:, c, :], data[None, c, :]])
        live = np.flatnonzero(rows.any(axis=1))
        for f in range(FOLDS):
            part = rows[np.ix_(live, np.flatnonzero(system.fold == f))]
            gram[f, c][np.ix_(live, live)] = part @ part.T
        generic.append(system.basis[c].T @ rows.T)
    return Products(gram, tuple(generic), np.zeros(k) if about is None else about)


def grown(system: System, table: Products, columns: np.ndarray, more: np.ndarray, about: np.ndarray, data: np.ndarray) -> Products:
    """Products of the first k columns of a table, which are `columns` (k, channels, n), with more (m, channels, n) about (m,) behind them, and of other data:
    what the first have among themselves is not computed again."""
    k, m = len(columns), len(more)
    gram = np.empty((FOLDS, len(system.names), k + m + 1, k + m + 1))
    gram[..., :k, :k] = table.gram[..., :k, :k]
    generic = []
    for c in range(len(system.names)):
        rows = np.concatenate([more[:, c, :], data[None, c, :]])
        live = np.flatnonzero(np.diagonal(table.gram[:, c], axis1=1, axis2=2)[:, :k].any(axis=0))
        for f in range(FOLDS):
            here = np.flatnonzero(system.fold == f)
            part = rows[:, here]
            across = np.zeros((k, m + 1))
            across[live] = columns[np.ix_(live, [c], here)][:, 0] @ part.T
            gram[f, c, :k, k:], gram[f, c, k:, :k], gram[f, c, k:, k:] = across, across.T, part @ part.T
        generic.append(np.concatenate([table.generic[c][:, :k], system.basis[c].T @ rows.T], axis=1))
    return Products(gram, tuple(generic), np.concatenate([table.about[:k], about]))

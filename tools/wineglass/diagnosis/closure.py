"""Closes an explanation on the envelope twin: effects are not linear in their parameters, and shapes (times, widths, axes) are fitted too.

Gauss-Newton with Broyden's updates: the responses of the linear pass are the first Jacobian, every further run of the twin gives a residual
and one more row of knowledge about it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from wineglass.diagnosis.beginnings import begin
from wineglass.diagnosis.explain import Explained, Support, explained, posterior_mean, prior_of
from wineglass.diagnosis.responses import Bench, Responses, Variant
from wineglass.diagnosis.system import Products, System, grown, products
from wineglass.diagnosis.unknowns import POLAR_ROLES, Unknown, differences, possible, respond, settings_of, within_bounds
from wineglass.effects import Setting
from wineglass.errors import BadInput

RUNS, FEW_RUNS, HOPELESS = 40, 10, 2.0  # HOPELESS: times the cost of the best explanation
SLOW = 0.4  # share of what the linear system promised that a good step keeps; after a worse one the Jacobian is computed anew
ENOUGH, PART = 0.3, 0.003  # nats promised, and of what is left beyond noise: then it is closed
NO_STEP = 1e-24  # of spreads, squared: of so little no slope can be learnt
NEGLIGIBLE = 1e-4  # of a prior's spread
NEIGHBOURS = 2  # moments of the linear pass, on either side, between which a step is looked for
BENT_PRIOR = float(np.log(0.1))  # of an effect whose law is bent
AT_ONCE = 50  # moments whose responses are held in memory together


@dataclass
class Closed:
    """values (k,) of unknowns; products: of nuisances and unknowns about these values; entry: evidence, filled by `weigh`."""

    support: Support
    variants: tuple[Variant, ...]
    unknowns: list[Unknown]
    values: np.ndarray
    jacobian: np.ndarray
    """(k, channels, n) in the channels' units"""
    response: np.ndarray
    """(channels, n): what the effects do to the bench's nominal run, in the channels' units"""
    products: Products
    runs: int
    entry: Explained = field(init=False)
    held: np.ndarray = field(init=False)
    """(folds, channels): energy left when fitted on the other folds"""
    earned: bool = True
    """every one of its effects earns its place on held-out data"""

    @property
    def settings(self) -> list[Setting]:
        return settings_of(self.unknowns, self.values)

    @property
    def possible(self) -> bool:
        return possible(self.unknowns, self.values)

    @property
    def places(self) -> list[int]:
        """Of nuisances and unknowns in the products: all of them."""
        return list(range(self.products.count))

    def weigh(self, softening: np.ndarray, nuisances: int, counts: dict[str, int], tolerances: int = 0) -> Closed:
        columns = list(range(nuisances, self.products.count))
        bent = len({u.effect for u in self.unknowns if u.role == "form"})
        self.entry = explained(self.products, softening, nuisances, columns, self.variants, prior_of(self.variants, counts) + BENT_PRIOR * bent, tolerances)
        return self


class NoNumbersError(ArithmeticError):
    """An explanation about which the envelope twin's responses are no numbers, or beyond them: it cannot be weighed."""


class Closer:
    """What all closures about one unit have in common. pick: the system's channels among those of the bench. columns (k, channels, n): the responses', whitened
    and scaled, nuisances first; table: their products."""

    def __init__(self, bench: Bench, system: System, responses: Responses, pick: list[int]):
        self.bench, self.system, self.responses, self.pick = bench, system, responses, pick
        scale = np.array([column.scale for column in responses.columns])
        self.columns = system.whiten(responses.values[:, pick, :]) * scale[:, None, None]
        self.centre = responses.centre
        self.table = products(system, self.columns, np.pad(self.centre, (0, len(scale) - len(self.centre))))
        self.nuisance = self.columns[: len(self.centre)]
        self._cheapest = np.inf
        live = [np.flatnonzero(self.nuisance[:, channel].any(axis=1)) for channel in range(len(system.names))]
        self._moving = [(places, self.nuisance[places, channel]) for channel, places in enumerate(live)]
        self._gram = self.table.everywhere(list(range(len(self.nuisance))))[:, :-1, :-1].sum(axis=0)
        self._factor = cho_factor(self._gram + np.eye(len(self.nuisance)))

    def close(self, start: Explained) -> Closed:
        found = []
        for begun in (self._timed(start), *self._sudden(start)):
            unknowns, jacobian = begin(self.bench, self.responses, self.pick, begun)
            found.append(self._search(begun.support, begun.variants, unknowns, np.array([u.start for u in unknowns]), jacobian))
        return min(found, key=self.cost_of)

    def _sudden(self, start: Explained) -> list[Explained]:
        """What creeps from a moment on, also as a step: between its moments a linear pass may take one for the other."""
        if len(start.variants) != 1 or not start.variants[0].shapes.get("creep_s") or "time_s" not in start.variants[0].shapes:
            return []
        creeping = start.variants[0]
        steps = [v for v in self.responses.variants[creeping.effect] if v.shapes.get("creep_s") == 0.0]
        after_s = creeping.shapes["time_s"] + 0.5 * creeping.shapes["creep_s"]
        nearest = min(steps, key=lambda v: abs(v.shapes["time_s"] - after_s), default=None)
        return [] if nearest is None else [self._timed(replace(start, variants=(nearest,)))]

    def _timed(self, start: Explained) -> Explained:
        """What happens at a moment, at the best one between its neighbours' in the linear pass: a response that begins later is the same, cut off."""
        able = [v for v in start.variants if "time_s" in v.shapes and not any(v.shapes[name] for name in v.shapes if name != "time_s")]
        if len(start.variants) != 1 or not able:
            return start
        rivals = sorted((v for v in self.responses.variants[able[0].effect] if set(v.shapes) == set(able[0].shapes)
                         and all(v.shapes[name] == 0.0 for name in v.shapes if name != "time_s")), key=lambda v: v.shapes["time_s"])
        here, time_s = rivals.index(able[0]), self.bench.grid.time_s - 0.5 * self.bench.grid.frame_s
        best = (0.0, able[0], able[0].shapes["time_s"], 0.0)
        for place in range(max(0, here - NEIGHBOURS), min(len(rivals), here + NEIGHBOURS)):
            until = rivals[place + 1].shapes["time_s"] if place + 1 < len(rivals) else time_s[-1]
            column = self.responses.values[rivals[place].columns[0]][self.pick]
            able_s = time_s[(time_s >= rivals[place].shapes["time_s"]) & (time_s < until)]
            for moments in (able_s[i : i + AT_ONCE] for i in range(0, len(able_s), AT_ONCE)):
                gains, sizes = self._gains(column * (time_s >= moments[:, None, None]))
                first = int(np.argmax(gains))
                best = max(best, (float(gains[first]), rivals[place], float(moments[first]), float(sizes[first])), key=lambda found: found[0])
        if best[0] == 0.0:
            return start
        scale = self.responses.columns[best[1].columns[0]].scale
        moved = replace(best[1], shapes={**best[1].shapes, "time_s": best[2]})
        coefficients = np.append(start.coefficients[: len(self.responses.nuisances)], best[3] / scale)
        return replace(start, variants=(moved,), coefficients=coefficients)

    def _gains(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nats (m,) that each of these columns (m, channels, n) alone gains, what is uncertain moving along, and its coefficient (m,)."""
        white = self.system.whiten(columns)
        along = self._across(white)
        behind = cho_solve(self._factor, along)
        size = np.einsum("mcn,mcn->m", white, white) - np.sum(along * behind, axis=0)
        match = np.tensordot(white, self.system.data, 2) - (self._across(self.system.data[None])[:, 0] - self.centre) @ behind
        able = size > 0.0
        return np.where(able, 0.5 * match**2 / np.where(able, size, 1.0), 0.0), np.where(able, match / np.where(able, size, 1.0), 0.0)

    def _across(self, rows: np.ndarray) -> np.ndarray:
        """(nuisances, m): products of what is uncertain with whitened rows (m, channels, n). Most of it moves a few channels only."""
        found = np.zeros((len(self.nuisance), len(rows)))
        for channel, (live, block) in enumerate(self._moving):
            found[live] += block @ rows[:, channel].T
        return found

    def resume(self, support: Support, variants: tuple[Variant, ...], unknowns: list[Unknown], values: np.ndarray, jacobian: np.ndarray) -> Closed:
        """Closed from these values, where the Jacobian is known."""
        return self._search(support, variants, unknowns, values, jacobian, fresh=True)

    def beside(self, closed: Closed, start: Explained) -> Closed:
        """An explanation with the effects of another one beside its own, which begin where a linear system has them."""
        unknowns, jacobian = begin(self.bench, self.responses, self.pick, start)
        return self.grown(closed, start.variants, unknowns, jacobian)

    def grown(self, closed: Closed, variants: tuple[Variant, ...], unknowns: list[Unknown], jacobian: np.ndarray) -> Closed:
        """An explanation with these variants beside its own, from where these unknowns start; jacobian (m, channels, n): of them, about."""
        values = np.concatenate([closed.values, [u.start for u in unknowns]])
        support = tuple(sorted({*closed.support, *(v.effect for v in variants)}))
        return self._search(support, closed.variants + variants, closed.unknowns + unknowns, values, np.concatenate([closed.jacobian, jacobian]))

    def nothing(self) -> Closed:
        """No effect at all."""
        return self._search((), (), [], np.zeros(0), np.zeros((0, *self.system.data.shape)), fresh=True)

    def without(self, closed: Closed, effect: str) -> Closed:
        """The same explanation without one of its effects, closed again from where it was."""
        keep = [i for i, unknown in enumerate(closed.unknowns) if unknown.effect != effect]
        unknowns = [closed.unknowns[i] for i in keep]
        variants = tuple(v for v in closed.variants if v.effect != effect)
        return self._search(tuple(e for e in closed.support if e != effect), variants, unknowns, closed.values[keep], closed.jacobian[keep])

    def cost_of(self, closed: Closed) -> float:
        """Half the energy left plus the priors'."""
        return self._solution(closed.products.pooled(np.ones(len(self.system.names))))[1]

    def _search(self, support: Support, variants: tuple[Variant, ...], unknowns: list[Unknown], values: np.ndarray, jacobian: np.ndarray,
                fresh: bool = False) -> Closed:
        """fresh: the Jacobian (k, channels, n) is the one at these values. What stays far behind the best explanation so far is not followed to its end."""
        spread, middle = np.array([u.spread for u in unknowns]), np.array([u.middle for u in unknowns])
        values, response = self._within_numbers(unknowns, values, middle)
        jacobian = np.where(np.isfinite(jacobian), jacobian, 0.0)
        cost = self._cost(response, (values - middle) / spread)
        runs, stride, noise = 1, 1.0, 0.5 * float(np.sum(self.system.n_rows))
        while runs < (RUNS if cost < HOPELESS * self._cheapest else FEW_RUNS):
            at = (values - middle) / spread
            change, promised_cost = self._step(self._whole(jacobian * spread[:, None, None], response, at), unknowns, values)
            promised = cost - promised_cost
            trial = within_bounds(unknowns, values + stride * change * spread)
            if promised < max(ENOUGH, PART * (cost - noise)) or stride < 0.02 or np.all(np.abs(trial - values) < NEGLIGIBLE * spread):
                if fresh or promised <= 0.0:
                    break
                gained = 0.0
            else:
                new = self._respond(unknowns, trial)
                runs += 1
                new_cost = np.inf if new is None else self._cost(new, (trial - middle) / spread)
                gained = cost - new_cost
                if new is not None:
                    jacobian = _broyden(jacobian, (trial - values) / spread, spread, new - response)
                    if gained > 0.0:
                        values, response, cost = trial, new, new_cost
            if gained >= SLOW * promised:
                stride, fresh = min(1.0, 2.0 * stride), False
            elif fresh:
                stride, fresh = 0.3 * stride, gained <= 0.0
            else:
                jacobian, fresh = differences(self.bench, self.pick, unknowns, values, response), True
                runs += len(unknowns)
        self._cheapest = min(self._cheapest, cost)
        found = self._linear(jacobian * spread[:, None, None], response, (values - middle) / spread)
        if not np.all(np.isfinite(found.gram)):
            raise NoNumbersError
        return Closed(support, variants, unknowns, values, jacobian, response, found, runs)

    def _within_numbers(self, unknowns: list[Unknown], values: np.ndarray, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The first values, or some nearer to the priors' middles, with which the twin has a response; nothing, where it has none anywhere: a unit may stand at
        a limit of physics."""
        for _ in range(12):
            response = self._respond(unknowns, values)
            if response is not None:
                return values, response
            values = 0.5 * (values + middle)
        return values, np.zeros_like(self.system.data)

    def _respond(self, unknowns: list[Unknown], values: np.ndarray) -> np.ndarray | None:
        """None: the twin refuses these values, or what it makes of them is beyond all numbers."""
        with suppress(BadInput):
            response = respond(self.bench, self.pick, unknowns, values)
            if np.all(np.isfinite(response)):
                return response
        return None

    def _linear(self, jacobian: np.ndarray, response: np.ndarray, at: np.ndarray) -> Products:
        """The system about the present values; unknowns in spreads of their priors, `at` from their middles."""
        data = self.system.data - self.system.whiten(response)
        return grown(self.system, self.table, self.nuisance, self.system.whiten(jacobian), at, data)

    def _whole(self, jacobian: np.ndarray, response: np.ndarray, at: np.ndarray) -> np.ndarray:
        """The products of `_linear` over all folds and channels, without their parts: (m + k + 1, m + k + 1)."""
        rows = np.concatenate([self.system.whiten(jacobian), (self.system.data - self.system.whiten(response))[None]])
        flat = rows.reshape(len(rows), -1)
        across, inner, about = self._across(rows), flat @ flat.T, self.centre
        across[:, -1] -= about
        inner[-1, :-1] -= at
        inner[:-1, -1] -= at
        inner[-1, -1] += float(about @ about + at @ at)
        return np.block([[self._gram, across], [across.T, inner]])

    def _step(self, gram: np.ndarray, unknowns: list[Unknown], values: np.ndarray) -> tuple[np.ndarray, float]:
        """The same as `_solution` where what stands at a bound, and would leave it, stays."""
        change, cost = self._solution(gram)
        low, high = (np.array([getattr(u, end) for u in unknowns]) for end in ("low", "high"))
        free = np.array([u.role not in POLAR_ROLES for u in unknowns], bool)
        held = free & (((values <= low) & (change < 0.0)) | ((values >= high) & (change > 0.0)))
        return self._solution(gram, held) if np.any(held) else (change, cost)

    def _solution(self, gram: np.ndarray, held: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        """How far off the linear system has its best point, in spreads, and the cost there. held (k,): of the unknowns, those that stay."""
        if not np.all(np.isfinite(gram)):
            raise NoNumbersError
        kept, first = np.ones(len(gram) - 1, bool), len(self.nuisance)
        if held is not None:
            kept[first:][held] = False
        places, coefficients = np.flatnonzero(kept), np.zeros(len(gram) - 1)
        coefficients[places] = posterior_mean(gram, list(places))[0]
        return coefficients[first:], 0.5 * float(gram[-1, -1] - gram[:-1, -1] @ coefficients)

    def _cost(self, response: np.ndarray, at: np.ndarray) -> float:
        """Half the energy left, nuisances at their best, plus the prior's."""
        left, about = self.system.data - self.system.whiten(response), self.centre
        if not np.all(np.isfinite(left)):
            return np.inf
        along = self._across(left[None])[:, 0] - about
        return 0.5 * float(np.sum(left**2) - along @ cho_solve(self._factor, along) + about @ about + at @ at)


def _broyden(jacobian: np.ndarray, step: np.ndarray, spread: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The least change of the Jacobian (k, channels, n) that predicts the last change of the response."""
    length = float(step @ step)
    if length < NO_STEP:
        return jacobian
    with np.errstate(over="ignore", invalid="ignore"):  # what is beyond all numbers is refused where it is weighed
        missing = change - np.einsum("kcn,k->cn", jacobian, step * spread)
        return jacobian + (step / length / spread)[:, None, None] * missing[None]

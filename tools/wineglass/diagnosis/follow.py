"""Explanations are followed on the full twin, together with the unit, until one leaves no gap or nothing better is in sight."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from wineglass.diagnosis import changes, explain, looks, responses, standing
from wineglass.diagnosis.beside import LARGEST
from wineglass.diagnosis.changes import Left
from wineglass.diagnosis.channels import Frames
from wineglass.diagnosis.closure import Closed, NoNumbersError
from wineglass.diagnosis.explain import Support
from wineglass.diagnosis.looks import ORDINARY, Law, Look, law_of
from wineglass.diagnosis.responses import Bench
from wineglass.diagnosis.standing import Standing
from wineglass.diagnosis.system import System
from wineglass.diagnosis.task import Task
from wineglass.diagnosis.unknowns import possible
from wineglass.errors import BadInput

FAR_OFF = 2.0  # standard deviations
FOLLOWED, NEARLY_ALL = 3, 3.0  # single effects, until one leaves so little energy per frame in every channel
QUIET_ENOUGH, STARTS = 1.5, 2  # energy per frame and channel that tolerances may leave; single effects to begin with
FAR_FROM_RIGHT = 300.0  # energy per frame that an explanation may leave and still be worth another run of the full twin
HINTED = 10.0  # nats that something smooth gains in channels that stay within their floors: healthy units have less than one
LOOKS = 4  # explanations that are followed one after the other
REFUTED = 2.0  # times the energy per frame of the last look: an explanation that leaves so much where it promised less is none


def last_look(there: Standing, base: Frames, nominal: Bench, task: Task) -> tuple[Look, Left]:
    """there: the unit that the recording asks for, base: the full twin's frames of it; nominal: the described one. Also what that unit leaves without any effect
    on held-out data."""
    built, left = _left(there, base, task)
    if _is_a_gap(built, left):
        return _explained(there, base, nominal, task), left
    quiet = looks.look(there.bench, base, task, largest=0)
    return (_explained(there, base, nominal, task) if quiet.hint >= HINTED else quiet), left


def _has_a_gap(there: Standing, frames: Frames, task: Task) -> bool:
    return _is_a_gap(*_left(there, frames, task))


def _is_a_gap(built: System, left: Left) -> bool:
    """Is any channel further from the full twin on held-out data than its floor? Where none is there is nothing (more) to explain."""
    return changes.changes(built, left, left.values)[1].fraction is not None


def _left(there: Standing, frames: Frames, task: Task) -> tuple[System, Left]:
    """Recorded minus full twin, what is uncertain fitted on the other stretches."""
    built = task.system(there.bench, frames)
    wandering = responses.wandering([name for name, _ in there.slopes])
    left = np.array([task.recorded[name] - frames[name] for name in built.names])
    table = standing.linear(there, task, built)
    return built, changes.held_out(built, table, np.ones(len(built.names)), there.columns(task.pick), left, wandering, there.limits)


def _explained(there: Standing, base: Frames, nominal: Bench, task: Task) -> Look:
    """After the best explanations were followed on the full twin."""
    look, followed = None, set[Law]()
    if float(np.max(standing.energy_left(there, task, base))) >= QUIET_ENOUGH:
        places = [lambda: (there.bench, base), lambda: (nominal, _frames_of(nominal, there, base))]
        look, followed = _from_singles(places, task)
    look = look or looks.look(there.bench, base, task)
    spent, best = 1 if followed else 0, None
    while not look.settled and spent < LOOKS and (best := look.promising(followed)) is not None:
        new = _followed(best, _from(look, best), task)
        look = _better(look, new, best, any(best.support == support for support, _ in followed))
        followed.add(law_of(best))
        spent += 1
    return _simpler(look, best.support, task) if look.settled and best is not None else look


def _simpler(look: Look, settled: Support, task: Task) -> Look:
    """The look after a part of what left no gap, while that is weighed the best: what has another effect beside it, and all of a large gap to itself, has not
    been run on the full twin yet. A part that leaves a gap there is none."""
    while look.closed and (part := look.closed[0]).possible and set(part.support) < set(settled):
        new = _followed(part, _from(look, part), task)
        if new is not None and new.settled:
            look, settled = new, part.support
        else:
            look = look.without(part)
    return look


def _from(look: Look, closed: Closed) -> Standing:
    return Standing(look.bench, closed.unknowns, closed.values, closed.jacobian)


def _better(look: Look, new: Look | None, followed: Closed, again: bool) -> Look:
    """The new look, unless the full twin refuses what was followed, or leaves far more than the last one: then that explanation is none, if it is not followed again."""
    if new is not None and (new.settled or new.least < REFUTED * look.least):
        return new
    return look if again else look.without(followed)


@dataclass(frozen=True)
class _Start:
    """An explanation, where it is to be followed from, and what the envelope twin says that it leaves (channels,)."""

    closed: Closed
    standing: Standing
    left: np.ndarray

    @property
    def possible(self) -> bool:
        return possible(self.standing.unknowns, self.standing.values)


def _frames_of(described: Bench, there: Standing, base: Frames) -> Frames:
    """The full twin's frames of the described unit: run again, where another one is too far from it for the envelope twin to say the difference."""
    far = float(np.max(np.abs(there.bench.unit.off), initial=0.0)) >= FAR_OFF
    return standing.run(Standing(described)) if far else standing.at_bench(there, base, described)


def _from_singles(places: list[Callable[[], tuple[Bench, Frames]]], task: Task) -> tuple[Look | None, set[Law]]:
    """The look that leaves least after a single effect was followed on the full twin, and which were. places: units with the full twin's frames there, so that
    what the envelope misses favours none: the unit that the recording asks for, and the described one, because a unit that has taken on a gap hides its cause."""
    starts: list[_Start] = []
    for start in chain.from_iterable(_starts(*place(), task) for place in places):
        starts.append(start)
        if start.possible and np.max(start.left) < QUIET_ENOUGH:
            break
    best, followed = None, set[Law]()
    for start in sorted(starts, key=lambda start: (not start.possible, float(np.sum(start.left)))):
        if len(followed) == FOLLOWED or (best is not None and (best.settled or best.least < NEARLY_ALL)):
            break
        if law_of(start.closed) in followed:
            continue
        followed.add(law_of(start.closed))
        look = _followed(start.closed, start.standing, task)
        if look is not None and (best is None or look.settled or look.least < best.least):
            best = look
    return best, followed


def _starts(bench: Bench, frames: Frames, task: Task) -> Iterator[_Start]:
    look = looks.look(bench, frames, task, largest=1, bend=False)
    ordinary = sorted(look.closed, key=lambda closed: explain.strain(closed.entry, len(look.found.nuisances)))[:ORDINARY]
    for entry in {closed.support: closed for closed in [*look.closed[:STARTS], *ordinary]}.values():
        start = Standing(bench, entry.unknowns, entry.values, entry.jacobian)
        with suppress(BadInput):  # closed where the twin refused a little more
            there, near = standing.roughly(start, task, standing.with_effects(start, frames))
            yield _Start(entry, there, standing.energy_left(there, task, near))


def _followed(closed: Closed, start: Standing, task: Task) -> Look | None:
    """All explanations, about where the full twin puts this one; where it leaves no gap no sets are asked for that hold more. None: the full twin refuses it."""
    try:
        found = standing.exactly(start, task, FAR_FROM_RIGHT)
        there, frames = found.standing, found.frames
        settled = not _has_a_gap(there, frames, task)
        base = standing.without_effects(there, frames)
        look = looks.look(there.bench, base, task, (closed, there), largest=1 if settled else LARGEST, settled=settled)
        return replace(look, ran=found.ran)
    except (BadInput, NoNumbersError):
        return None

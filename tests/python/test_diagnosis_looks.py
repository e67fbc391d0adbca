"""What a look at a recording follows on the full twin next, and how much what is left of a gap counts."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wineglass.diagnosis import explain, follow, looks
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.floors import ORDER, Floor
from wineglass.diagnosis.looks import Look, law_of
from wineglass.diagnosis.system import FOLDS, System, products

FRAMES = 1000
NONE = SimpleNamespace(log_evidence=-50000.0, log_generic=0.0)


def closed(*effects: str, nats: float, per_frame: float, bent: str = "", possible: bool = True) -> Any:
    """nats over no effect; per_frame: energy left, in one channel."""
    unknowns = [SimpleNamespace(effect=effect, name="a", role="strength") for effect in effects]
    forms = [SimpleNamespace(effect=bent, name="b", role="form")] if bent else []
    entry = SimpleNamespace(log_evidence=NONE.log_evidence + nats, log_generic=0.0, left=np.array([per_frame * FRAMES]))
    return SimpleNamespace(support=tuple(sorted(effects)), unknowns=[*unknowns, *forms], entry=entry, possible=possible)


def look(*explanations: Any, settled: bool = False) -> Look:
    built = SimpleNamespace(n_rows=np.array([FRAMES]))
    order = sorted(explanations, key=lambda c: -c.entry.log_evidence)
    return Look(None, None, None, built, None, NONE, order, np.ones(1), settled)  # type: ignore[arg-type]


A, B = closed("ageing", nats=900.0, per_frame=100.0), closed("pickoff_gain", nats=800.0, per_frame=90.0)
BOTH = closed("ageing", "pickoff_gain", nats=950.0, per_frame=2.0)


def test_first_the_single_effect_that_leaves_least():
    assert look(A, B, BOTH).promising(set()) is B
    assert look(A, closed("pickoff_gain", nats=990.0, per_frame=1.0, possible=False)).promising(set()) is A
    assert look(closed("ageing", nats=10.0, per_frame=1.0)).promising(set()) is None


def test_then_what_does_better():
    assert look(A, B, BOTH).promising({law_of(A)}) is BOTH
    assert look(A, B).promising({law_of(A)}) is None
    assert look(A, B, BOTH).promising({law_of(A), law_of(BOTH)}) is None


def test_a_law_that_has_bent_since_is_followed_again_before_anything_is_put_beside_it():
    bent = closed("ageing", nats=930.0, per_frame=5.0, bent="ageing")
    assert look(bent, BOTH).promising({law_of(A)}) is bent
    assert look(bent, BOTH).promising({law_of(A), law_of(bent)}) is BOTH
    assert look(closed("ageing", nats=930.0, per_frame=50.0, bent="ageing"), BOTH).promising({law_of(A)}) is BOTH


def test_what_leaves_far_less_is_followed_though_it_is_not_worth_more_yet():
    less = closed("ageing", "vibration", nats=890.0, per_frame=20.0)
    assert look(A, less).promising({law_of(A)}) is less
    assert look(A, closed("ageing", "vibration", nats=890.0, per_frame=60.0)).promising({law_of(A)}) is None


def test_what_the_full_twin_refutes_is_no_explanation():
    before = look(A, BOTH)
    worse, better = look(closed("ageing", "pickoff_gain", nats=950.0, per_frame=1354.0)), look(closed("ageing", "pickoff_gain", nats=950.0, per_frame=1.0))
    assert follow._better(before, better, BOTH, again=False) is better
    for refused in (worse, None):
        assert [c.support for c in follow._better(before, refused, BOTH, again=False).closed] == [A.support]
        assert follow._better(before, refused, A, again=True) is before
    settled = look(closed("ageing", nats=1.0, per_frame=1354.0), settled=True)
    assert follow._better(before, settled, A, again=True) is settled


@pytest.mark.parametrize("alone", [True, False])
def test_a_part_that_is_weighed_the_best_is_run_on_the_full_twin_itself(alone: bool, monkeypatch: pytest.MonkeyPatch):
    """alone: it leaves no gap there; else it is none, and the whole stands."""
    part, other = closed("ageing", nats=960.0, per_frame=1.0), closed("vibration", nats=990.0, per_frame=1.0)
    after, run = look(part, settled=alone), list[Any]()
    monkeypatch.setattr(follow, "_from", lambda look, closed: None)
    monkeypatch.setattr(follow, "_followed", lambda closed, start, task: run.append(closed) or after)
    before = look(part, BOTH, settled=True)
    found = follow._simpler(before, BOTH.support, None)  # type: ignore[arg-type]
    assert run == [part] and (found is after if alone else [c.support for c in found.closed] == [BOTH.support])
    for best in (BOTH, other, closed("ageing", nats=960.0, per_frame=1.0, possible=False)):
        stays = look(best, settled=True)
        assert follow._simpler(stays, BOTH.support, None) is stays  # type: ignore[arg-type]


@pytest.mark.parametrize(("before", "after", "low", "high"), [(100.0, 100.0, 0.0, 0.0), (100.0, 1.0, 20.0, 30.0), (1.1, 1.0, 0.0, 1.0), (1e4, 1.0, 40.0, 55.0)])
def test_what_is_left_counts_by_its_ratio_beyond_the_softening(before: float, after: float, low: float, high: float):
    """Five nats for every factor e, less what the softening grants, and none of it for less than a floor is known to."""
    alone, with_more = closed("ageing", nats=900.0, per_frame=before), closed("ageing", "vibration", nats=900.0, per_frame=after)
    softening = np.array([1.0 + (before - 1.0) * FRAMES / looks.FREEDOM])
    more = looks._more(with_more, alone, softening, np.array([float(FRAMES)]))
    assert low <= more <= high


@pytest.mark.parametrize(("channel", "heard"), [(0, True), (1, False)])
def test_only_what_lasts_hints_at_a_law(channel: int, heard: bool):
    """The same smooth gap in a channel that lasts and in one that speaks briefly."""
    smooth = np.sqrt(2.0 / FRAMES) * np.cos(np.pi * (np.arange(FRAMES) + 0.5) / FRAMES)[:, None]
    data = np.random.default_rng(5).standard_normal((2, FRAMES))
    data[channel] += 100.0 * smooth[:, 0]
    weight = np.ones((2, FRAMES))
    weight[1, 50:] = 0.0
    floor = Floor(np.ones(2), np.ones(2), np.zeros((2, ORDER)))
    built = System(Grid(1.0, 0, FRAMES), ("a", "b"), floor, weight, np.arange(FRAMES) * FOLDS // FRAMES, (smooth, smooth), data * weight)
    found = SimpleNamespace(nuisances=[], tolerances=0)
    seen = Look(None, None, found, built, products(built, np.zeros((0, 2, FRAMES))), NONE, [], np.ones(2), False)  # type: ignore[arg-type]
    everything = explain.explained(seen.table, np.ones(2), 0, [], (), 0.0).log_generic
    assert (seen.hint > follow.HINTED) == heard and everything > follow.HINTED


@pytest.mark.parametrize("hint", [0.0, 2.0 * follow.HINTED])
def test_within_the_floors_laws_are_tried_only_on_a_hint(hint: float, monkeypatch: pytest.MonkeyPatch):
    quiet, explained, left = SimpleNamespace(hint=hint), look(A), object()
    monkeypatch.setattr(follow, "_left", lambda there, base, task: (None, left))
    monkeypatch.setattr(follow, "_is_a_gap", lambda built, left: False)
    monkeypatch.setattr(looks, "look", lambda bench, base, task, largest: quiet)
    monkeypatch.setattr(follow, "_explained", lambda there, base, nominal, task: explained)
    found, alone = follow.last_look(SimpleNamespace(bench=None), {}, None, None)  # type: ignore[arg-type]
    assert found is (explained if hint else quiet) and alone is left

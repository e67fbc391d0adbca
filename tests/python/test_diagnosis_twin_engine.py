"""Which of two conclusions about a wander stands, on made-up ones."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from wineglass.diagnosis import twin_engine
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.diagnosis.twin_verdict import FORETOLD, Verdict


def noise(*named: str) -> NoiseEvidence:
    evidence = {frozenset[str](): 0.0, frozenset(named): 50.0 if named else 0.0}
    return NoiseEvidence(evidence, [], [], None, None, None, None, None, None, None)


def asked(seen: NoiseEvidence, chosen: object, removed: float | None) -> tuple[str, int]:
    """Which conclusion is taken, and how many were drawn. chosen: what is confirmed beside the wander; removed: by the best law, of the held-out gap."""
    drawn = []

    def concluded(evidence: NoiseEvidence) -> SimpleNamespace:
        as_noise = "flicker_noise" in evidence.named
        drawn.append("noise" if as_noise else "law")
        verdict = Verdict(None, SimpleNamespace(chosen=chosen), None, None if as_noise else removed)  # type: ignore[arg-type]
        return SimpleNamespace(verdict=verdict, name=drawn[-1])

    return twin_engine.wandering_or_lawful(seen, concluded).name, len(drawn)  # type: ignore[arg-type, attr-defined]


@pytest.mark.parametrize(("removed", "taken"), [(FORETOLD + 0.01, "law"), (FORETOLD - 0.01, "noise"), (None, "noise")])
def test_what_a_law_foretells_is_no_wander(removed: float | None, taken: str) -> None:
    assert asked(noise("flicker_noise"), None, removed) == (taken, 2)


def test_beside_an_effect_that_is_confirmed_a_wander_stands() -> None:
    assert asked(noise("flicker_noise"), object(), 0.99) == ("noise", 1)


def test_without_a_wander_nothing_is_asked_twice() -> None:
    assert asked(noise("excess_noise"), None, 0.99) == ("law", 1)

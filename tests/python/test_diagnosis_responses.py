"""What the search moves: every number of the catalogue that slow channels can show."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from wineglass import device, effects, paths
from wineglass.diagnosis import responses
from wineglass.diagnosis.channels import Grid
from wineglass.diagnosis.stretches import SWITCHED
from wineglass.diagnosis.thermometer_codes import Steps
from wineglass.diagnosis.unknowns import AXIS

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

SEEN_IN_NOISE = {("vibration", "frequency_hz"), ("vibration", "rate_rad_s")}
"""Numbers of a line"""


def bench() -> SimpleNamespace:
    metal = device.load("metal-fast")
    warming = SimpleNamespace(temperature=SimpleNamespace(at=lambda time_s: 0.1 * time_s))
    driven = SimpleNamespace(run=SimpleNamespace(device=metal, scenario=warming))
    return SimpleNamespace(grid=Grid(0.5, 0, 240), driven=driven, unit=SimpleNamespace(device=metal), stairs=Steps(0.5, 1.0, 20, 0.1))


@pytest.mark.parametrize("effect", [e for e in effects.catalogue() if e.id not in responses.NOISE_LIKE], ids=lambda effect: effect.id)
def test_every_number_of_an_effect_is_moved_by_some_search(effect: effects.Effect) -> None:
    moved = {AXIS} if effect.id in responses.POLAR else set[str]()
    for shapes, probes in responses._variants(bench(), effect):  # type: ignore[arg-type]
        moved |= {*shapes, *(name for name, _, _ in probes)}
    for switched in SWITCHED:
        if switched.effect == effect.id:
            moved |= {switched.strength, *(name for ends in switched.ends for name in ends)}
    moved |= {p.name for p in effect.parameters if p.form}
    assert {p.name for p in effect.parameters if (effect.id, p.name) not in SEEN_IN_NOISE} <= moved

"""Where a gap is booked, on small made-up analyses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from wineglass.diagnosis import places
from wineglass.diagnosis.changes import Change
from wineglass.diagnosis.channels import Grid

GRID = Grid(0.25, 0, 200)
NAMES = ("primary_quadrature", "drive_level", "secondary_quadrature")


def test_what_is_left_is_placed_where_held_out_data_show_it() -> None:
    """Not where a fit of everything at once happens to leave most."""
    rows = np.zeros((3, GRID.count))
    rows[2, 100:150] = 5.0
    changes = [Change("primary_quadrature", 0.9, 0.9, 1.0, None, None), Change("drive_level", 2.0, 2.0, 1.0, 0.0, (0.0, 0.0)),
               Change("secondary_quadrature", 20.0, 20.0, 1.0, 0.0, (0.0, 0.0))]
    use = np.ones((3, GRID.count), bool)
    use[1, 20:] = False
    made = SimpleNamespace(changes=changes, use=use, after=rows)
    found = places._unexplained(SimpleNamespace(names=NAMES, grid=GRID), made, 1.0)  # type: ignore[arg-type]
    assert [(w.stage, w.channel) for w in found] == [("coupling", "secondary_quadrature")]
    assert found[0].share == pytest.approx(399.0 * 200 / (399.0 * 200 + 3.0 * 20))
    assert found[0].region.start == pytest.approx(0.25 * 102, abs=0.6) and found[0].region.stop == pytest.approx(0.25 * 148, abs=0.6)
    assert found[0].ratio_over_floor == pytest.approx(20.0)


def test_a_named_effect_is_placed_in_the_channel_that_shows_most_of_it() -> None:
    """Not where a short swing has most energy once noise is white."""
    response = np.zeros((3, GRID.count))
    response[1], response[2, 190:] = 1.0, 100.0
    entry = SimpleNamespace(support=("actuator_gain",), response=response)
    found = SimpleNamespace(names=NAMES, grid=GRID, closed=[entry], system=SimpleNamespace(whiten=lambda series: series))
    changes = [Change("primary_quadrature", 0.9, 0.9, 1.0, None, None), Change("drive_level", 70.0, 0.5, 1.0, 1.0, (1.0, 1.0)),
               Change("secondary_quadrature", 10.0, 0.5, 1.0, 1.0, (1.0, 1.0))]
    made = SimpleNamespace(changes=changes, use=np.ones((3, GRID.count), bool))
    place = places._named_place(found, made, [SimpleNamespace(id="actuator_gain", stage="actuation")], ("actuation", "level"), 1.0)  # type: ignore[arg-type, list-item]
    assert (place.channel, place.ratio_over_floor, place.share) == ("drive_level", 70.0, 1.0)


@pytest.mark.parametrize(("foretold", "channel"), [((-4.0, 200.0, 3.0), "drive_level"), ((-4.0, -1.0, 0.0), "secondary_quadrature")])
def test_within_the_floors_an_effect_is_where_most_of_it_is_foretold(foretold: tuple[float, float, float], channel: str) -> None:
    """Or, if nothing is, where it moves most."""
    response = np.array([1.0, 1.0, 2.0])[:, None] * np.ones(GRID.count)
    entry = SimpleNamespace(support=("actuator_gain",), response=response)
    found = SimpleNamespace(names=NAMES, grid=GRID, closed=[entry], system=SimpleNamespace(whiten=lambda series: series))
    changes = [Change(name, 1.01, 1.0, 1.0, None, None, energy) for name, energy in zip(NAMES, foretold, strict=True)]
    made = SimpleNamespace(changes=changes, use=np.ones((3, GRID.count), bool))
    place = places._named_place(found, made, [SimpleNamespace(id="actuator_gain", stage="actuation")], ("actuation", "level"), 1.0)  # type: ignore[arg-type, list-item]
    assert (place.channel, place.ratio_over_floor, place.share) == (channel, 1.01, 1.0)


def test_an_effect_that_no_look_shows_is_in_the_channel_with_the_largest_gap() -> None:
    """A channel without a gap does not count, however far it is from its floor."""
    changes = [Change("primary_quadrature", 90.0, 90.0, 1.0, None, None), Change("drive_level", 2.0, 2.0, 1.0, 0.0, (0.0, 0.0)),
               Change("secondary_quadrature", 3.0, 3.0, 1.0, 0.0, (0.0, 0.0))]
    wander = [SimpleNamespace(id="flicker_noise", stage="pickoff")]
    found = SimpleNamespace(names=NAMES, grid=GRID)
    place, = places._traces(found, SimpleNamespace(changes=changes), wander, set(), None, 1.0)  # type: ignore[arg-type]
    assert (place.stage, place.channel, place.component, place.ratio_over_floor) == ("pickoff", "secondary_quadrature", "noise", 3.0)

"""The twin-level engine from recording to verdict: what was switched on in the full twin is named, sized, and removed on held-out data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wineglass import device, protocols, scenario
from wineglass.diagnosis import drive, twin_engine
from wineglass.diagnosis.twin_engine import Examined
from wineglass.diagnosis.unit import Unit
from wineglass.effects import Setting
from wineglass.recording import Recording
from wineglass.simulation import simulate

SEED = 41


def examined(folder: Path, effects: list[Setting], loop: str = "open") -> Examined:
    path = folder / "case.h5"
    simulate(scenario.prepare(protocols.scenario("full", device="metal-fast", loop=loop, seed=SEED)), path, effects=effects)
    found = twin_engine.examine(path)
    assert found is not None
    return found


def test_a_healthy_device_has_no_gap(tmp_path: Path) -> None:
    found = examined(tmp_path, [])
    assert found.verdict.diagnosis.verdict == "no_gap"
    assert found.hypotheses.none > 0.5


@pytest.mark.parametrize(("loop", "effect", "name", "truth"), [
    ("open", Setting("thermometer_lag", {"lag_s": 1.0}), "lag_s", 1.0),
    ("rebalance", Setting("thermal_gradient", {"bias_rad_s_per_degc_s": 1e-3}), "bias_rad_s_per_degc_s", 1e-3),
])
def test_one_effect_is_named_sized_and_removed(tmp_path: Path, loop: str, effect: Setting, name: str, truth: float) -> None:
    diagnosis = examined(tmp_path, [effect], loop).verdict.diagnosis
    assert diagnosis.verdict == "attributed"
    assert [e.id for e in diagnosis.effects] == [effect.id]
    number = next(p for p in diagnosis.effects[0].parameters if p.name == name)
    assert number.value == pytest.approx(truth, rel=0.01)
    assert diagnosis.shrink.all.fraction is not None and diagnosis.shrink.all.fraction > 0.95


def test_a_small_effect_beside_one_far_beyond_its_usual_size(tmp_path: Path) -> None:
    """A mismatch of 45 typical sizes, which the full twin has to follow to its end, and a gradient that is a three hundredth of the whole gap."""
    large, small = Setting("damping_mismatch", {"mismatch": 0.45, "axis_deg": 90.0}), Setting("thermal_gradient", {"bias_rad_s_per_degc_s": 1.5e-4})
    diagnosis = examined(tmp_path, [large, small], "rebalance").verdict.diagnosis
    assert diagnosis.verdict == "attributed"
    assert [e.id for e in diagnosis.effects] == [large.id, small.id]
    values = {p.name: p.value for e in diagnosis.effects for p in e.parameters}
    assert values["mismatch"] == pytest.approx(0.45, rel=0.01)
    assert values["bias_rad_s_per_degc_s"] == pytest.approx(1.5e-4, rel=0.02)


def test_the_twin_is_driven_by_what_was_recorded(tmp_path: Path) -> None:
    run = scenario.prepare(protocols.cut(protocols.scenario("full", device="metal-fast", seed=SEED), 80.0))
    simulate(run, tmp_path / "rec.h5")
    with Recording.open(tmp_path / "rec.h5") as recording:
        driven = drive.from_recording(recording)
        time_s = np.arange(1.0, 79.0, 0.1)
        assert driven.shell_known and driven.rate_known
        assert driven.calibration_block == recording.calibration_block
        assert [c.kind for c in driven.run.scenario.command] == [c.kind for c in run.scenario.command]
    away = np.abs(driven.run.scenario.rate.at(time_s) - run.scenario.rate.at(time_s))
    assert np.quantile(away, 0.9) < 1e-3 * np.ptp(run.scenario.rate.at(time_s))


def test_a_unit_moves_polynomials_and_numbers_by_standard_deviations() -> None:
    described = device.load("metal-fast")
    unit = Unit.of(described)
    names = [item.name for item in unit.uncertain]
    off = np.zeros(len(names))
    off[names.index("resonator.q")], off[names.index("resonator.cross_damping_rad_s[1]")] = 1.0, -2.0
    moved = unit.at(off).device
    assert moved.resonator.q == pytest.approx(described.resonator.q * 1.1)
    assert moved.resonator.cross_damping_rad_s[1] == pytest.approx(described.resonator.cross_damping_rad_s[1] - 1e-6)
    assert unit.at(np.zeros(len(names))).device == described

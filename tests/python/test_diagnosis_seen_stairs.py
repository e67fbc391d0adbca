"""A coarse thermometer's stairs in recordings of the full twin: the zero of the unit that was recorded is found, where slopes show nothing of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wineglass import protocols, scenario
from wineglass.diagnosis import channels, drive, thermometer_codes
from wineglass.diagnosis.responses import Bench
from wineglass.diagnosis.seen_stairs import ZERO, with_known_zero
from wineglass.effects import Setting
from wineglass.recording import Recording
from wineglass.simulation import simulate

SEED = 47
STEP_DEGC = 0.85


@pytest.mark.parametrize(("zero_degc", "dead_band"), [(0.0, 0.0), (-0.18, 0.0), (0.23, 0.25)])
def test_the_zero_is_where_the_stairs_fall(tmp_path: Path, zero_degc: float, dead_band: float) -> None:
    """Codes are multiples of the step from 0 degC, less the unit's zero."""
    run = protocols.scenario("operating", device="metal-fast", seed=SEED).changed({"plant": {"override": {ZERO: zero_degc}}})
    stairs = Setting("thermometer_quantisation", {"step_degc": STEP_DEGC, "origin_degc": -25.0, "dead_band": dead_band})
    simulate(scenario.prepare(run), tmp_path / "rec.h5", effects=[stairs])
    with Recording.open(tmp_path / "rec.h5") as recording:
        driven = drive.from_recording(recording)
        found = thermometer_codes.find(recording, driven.run.device)
        assert found is not None and found.coarse
        grid = channels.grid_of(recording)
        recorded = channels.read(recording, grid)
    assert found.step_degc == pytest.approx(STEP_DEGC, abs=2e-4)
    assert (found.offset_degc + zero_degc + 0.5 * STEP_DEGC) % STEP_DEGC == pytest.approx(0.5 * STEP_DEGC, abs=0.01)
    known = with_known_zero(driven, Bench(driven, grid, recorded.names), recorded, found).run.device
    assert known.electronics.thermometer.zero_degc == pytest.approx(zero_degc, abs=0.02 * STEP_DEGC)
    assert known.tolerance[ZERO].absolute < driven.run.device.tolerance[ZERO].absolute
    assert known.resonator == driven.run.device.resonator
    certain = replace(driven, run=replace(driven.run, device=driven.run.device.model_copy(update={"tolerance": {}})))
    assert with_known_zero(certain, Bench(certain, grid, recorded.names), recorded, found) is certain
    late = replace(recorded, values=np.roll(recorded.values, 20, axis=1))
    assert with_known_zero(driven, Bench(driven, grid, recorded.names), late, found) is driven, "readings that are late by seconds say nothing of the zero"

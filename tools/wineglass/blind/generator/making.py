"""A case into a recording, and what its oracle says."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from wineglass import device as devices
from wineglass.blind.generator import bench, unit
from wineglass.blind.generator.case import Case, Made
from wineglass.blind.generator.effects import apply
from wineglass.blind.generator.oracle import Grade, Measured, grade, measured_of
from wineglass.blind.generator.plant import Plant
from wineglass.blind.generator.world import World
from wineglass.device import Device


def make(case: Case, path: str | Path, calibration: bytes, progress: Callable[[int], None] | None = None) -> Made:
    """Writes the recording of a case. calibration: the block in the device's store, as bytes; progress(blocks done since the last call)."""
    described = describe(case)
    fields = drawn_fields(case, described)
    world = world_of(case, described, fields)
    with _plant(world, calibration) as plant:
        elapsed = bench.record(world, plant, Path(path), calibration, unit.noisier(described, case.noise_factor), case.lost_fraction, progress)
        return Made(str(path), plant.clipped, elapsed, fields)


def looked_at(case: Case, calibration: bytes) -> Measured:
    """What the oracle looks at of a case, without a file in between."""
    described = describe(case)
    world = world_of(case, described, drawn_fields(case, described))
    with _plant(world, calibration) as plant:
        return measured_of(bench.remember(world, plant), described)


def _plant(world: World, calibration: bytes) -> Plant:
    for patch in world.calibration_patches:
        calibration = patch(calibration)
    return Plant(world, calibration)


def describe(case: Case) -> Device:
    """The device as its description says."""
    return devices.load(case.scenario.device).override(case.scenario.override, f"scenario {case.scenario.name}")


def drawn_fields(case: Case, described: Device) -> dict[str, object]:
    """What differs from the description although nothing is wrong."""
    drawn = unit.drawn(described, World.random_for(case.draw, "unit")) if case.another_unit else {}
    return {**drawn, **case.fields}


def world_of(case: Case, described: Device, fields: dict[str, object]) -> World:
    """The day with all effects of the case in it."""
    world = World(described, unit.another(described, fields), case.scenario, case.draw, case.noise_factor, case.noise_draw, case.paced)
    apply(world, case.effects)
    return world


def scaled_to(case: Case, calibration: bytes, snr: float, *, rounds: int = 3, within: float = 1.25, folder: str | Path | None = None) -> tuple[Case, Grade]:
    """The case with all its effects scaled by one factor so that the oracle's SNR is about `snr` (within a factor, or after `rounds` recordings), and
    its grade. What acts by threshold or by count may stay off; the grade says so."""
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        plain, changed = Path(scratch) / "without.h5", Path(scratch) / "with.h5"
        make(case.without_effects(), plain, calibration)
        found = grade_of(case, calibration, plain, changed)
        for _ in range(rounds - 1):
            factor = min(max(snr / max(found.snr, 1e-3 * snr), 1e-4), 1e3)
            if 1.0 / within < factor < within:
                break
            case = replace(case, effects=tuple(one.scaled(factor) for one in case.effects))
            found = grade_of(case, calibration, plain, changed)
        return case, found


def grade_of(case: Case, calibration: bytes, plain: Path, scratch: Path) -> Grade:
    """Against a recording of the same seed without effects; `scratch` is overwritten."""
    make(case, scratch, calibration)
    return grade(scratch, plain)


def oracle(case: Case, calibration: bytes, folder: str | Path | None = None, recording: str | Path | None = None) -> Grade:
    """How much of a gap the effects make: the same seed with and without them. recording: the case's own, if it is there already."""
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        plain = Path(scratch) / "without.h5"
        make(case.without_effects(), plain, calibration)
        if recording is None:
            recording = Path(scratch) / "with.h5"
            make(case, recording, calibration)
        return grade(Path(recording), plain)

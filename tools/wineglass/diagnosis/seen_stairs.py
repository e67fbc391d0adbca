"""A thermometer whose readings show coarse steps: where its zero is. Slopes do not say so, because a reading does not move until the next step; so zeros within the
tolerance are tried, and the unit stands where the stairs fall when they were recorded."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from wineglass.device import Device, Tolerance
from wineglass.diagnosis.channels import Frames
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.responses import MEASURED, STAIRS, Bench, stairs_as_seen
from wineglass.diagnosis.thermometer_codes import Steps
from wineglass.diagnosis.unit import FARTHEST
from wineglass.effects import Setting

ZERO = "electronics.thermometer.zero_degc"
PART = 0.06  # of a step: zeros are tried so far apart
FINER = 6  # times, about the best one
MET = 0.15  # of a step, rms: readings that stay further off than that are late, or off in another way, and say nothing of the zero


def with_known_zero(driven: Driven, bench: Bench, recorded: Frames, stairs: Steps) -> Driven:
    """The device described with the thermometer's zero that the stairs show, known to the distance of the last ones tried; as it is, where a unit's zero is not
    uncertain, or no zero meets the readings."""
    described = driven.run.device
    tolerance = described.tolerance.get(ZERO)
    if tolerance is None or not isinstance(tolerance.absolute, float) or MEASURED not in bench.names:
        return driven
    nominal, apart = described.electronics.thermometer.zero_degc, PART * stairs.step_degc
    reach = FARTHEST * tolerance.absolute
    count = max(1, int(np.ceil(reach / apart)))
    rough, _ = _best(bench, recorded, stairs, nominal + np.linspace(-reach, reach, 2 * count + 1))
    zero, missed = _best(bench, recorded, stairs, rough + apart * np.arange(-FINER + 1, FINER) / FINER)
    if missed > MET * stairs.step_degc:
        return driven
    return replace(driven, run=replace(driven.run, device=_known(described, zero, min(tolerance.absolute, apart / FINER))))


def _best(bench: Bench, recorded: Frames, stairs: Steps, zeros: Iterable[float]) -> tuple[float, float]:
    """The zero with which readings, held on to or not, are nearest to the recorded ones, and how far off these are, rms; degC."""
    place, measured = bench.names.index(MEASURED), recorded[MEASURED]
    use = recorded.use[recorded.names.index(MEASURED)]
    found = (np.inf, 0.0)
    for zero in zeros:
        truth = bench.unit.device.override({ZERO: float(zero)})
        for shape in stairs_as_seen(stairs, truth):
            readings = bench.run([Setting(STAIRS, {"step_degc": stairs.step_degc, **shape})], truth=truth)[place]
            found = min(found, (float(np.mean((measured - readings)[use] ** 2)), float(zero)))
    return found[1], float(np.sqrt(found[0]))


def _known(described: Device, zero_degc: float, within_degc: float) -> Device:
    device = described.override({ZERO: zero_degc})
    return device.model_copy(update={"tolerance": {**device.tolerance, ZERO: Tolerance(absolute=within_degc, why="where the readings' stairs fall")}})

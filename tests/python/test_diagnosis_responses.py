"""What the search moves: every number of the catalogue that slow channels can show."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
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


def lost(knee: float, part: float, amplitude: float) -> float:
    """Of the fundamental of a sine that loses a part of what exceeds a knee, by quadrature over a turn."""
    sine = np.sin(2.0 * np.pi * (np.arange(4096) + 0.5) / 4096)
    x = amplitude * sine
    return float(2.0 * np.mean(sine * part * np.sign(x) * np.maximum(np.abs(x) - knee, 0.0)))


@pytest.mark.parametrize("part", np.geomspace(0.002, 0.2, 7))
def test_a_compression_begins_with_a_knee_below_the_amplitude(part: float) -> None:
    """What a linear pass makes of an amplifier that loses so much of what exceeds 0.7 FS. A knee beyond the amplitude has no slope to come back by."""
    amplitude, below = device.load("metal-fast").firmware.amplitude_fs, []
    for shape, ((name, setting, scale),) in responses._variants(bench(), effects.find("adc_saturation")):  # type: ignore[arg-type]
        if 0.0 < shape.get("positive_part", 1.0) < 1.0:
            unit = setting.values[name]
            coefficient = lost(0.7, part, amplitude) / lost(1.0 - unit, shape["positive_part"], amplitude)
            assert scale == 1.0
            below.append(1.0 - unit * min(max(coefficient, 0.2), 5.0) < amplitude)  # as the closing begins
    assert any(below)

"""The generator's forms and the catalogue's parameters: every form is either translated or said not to be."""

import math

import blind_sets as sets
import pytest

from wineglass import effects
from wineglass.blind import generator
from wineglass.blind.equivalents import SAME, WITHOUT, Day, covered
from wineglass.blind.sheet import Effect


def test_every_form_is_on_one_of_the_lists():
    forms = {(one.id, one.name) for one in generator.variants() if one.in_catalogue}
    assert set(SAME) | set(WITHOUT) == forms and not set(SAME) & set(WITHOUT)


def test_every_parameter_is_one_of_the_catalogue():
    known = {(effect.id, parameter.name) for effect in effects.catalogue() for parameter in effect.parameters}
    assert {(id, one.parameter) for (id, _), same in SAME.items() for one in same} <= known


@pytest.mark.parametrize("id, variant, strength, parameter, truth", [
    ("rate_reference", "scale", 0.25, "scale", -0.2),  # the table's channel reads 1.25 of the rate: the rate is 0.8 of it
    ("rate_reference", "offset", 30.0, "offset_rad_s", -math.radians(30.0) / 3600.0),
    ("drive_phase", "delay", 3.0, "delay_s", 3e-3 / (2.0 * math.pi * 5000.0)),
    ("adc_saturation", "hard", 0.1, "loss_fs", 0.19),  # clips at 0.9 of 0.9 FS
    ("adc_saturation", "one_sided", 0.1, "loss_fs", 0.19),
    ("adc_saturation", "soft", 0.05, "loss_fs", 0.3),  # above 0.7 FS
    ("adc_nonlinearity", "zero_step", 2e-4, "sign_step_fs", 2e-4),
    ("drive_feedthrough", "capacitive", 200.0, "edge", 2e-4),
    ("thermal_gradient", "mount", 20.0, "settles_s", 0.6),  # a fifth of 3 s
    ("thermal_hysteresis", "play", 20.0, "half_width_degc", 8.0),
    ("ageing", "linear", 36.0, "linear_rad_s_per_h", math.radians(36.0) / 3600.0 * 6.0),  # within 600 s
    ("excess_noise", "white", 2.0, "secondary_fs", 2.0 * 10.0**-4.5 / math.sqrt(2.0)),  # 90 dB
])
def test_values_by_hand(id, variant, strength, parameter, truth):
    day = Day(sets.sheet("case_0001", "single", (id, variant)))
    for factor, inside in ((1.0, True), (1.2, False)):
        ends = sorted((truth * factor * 0.99, truth * factor * 1.01))
        found = [{"id": id, "parameters": [{"name": parameter, "interval": ends}]}]
        assert list(covered(Effect(id=id, variant=variant, strength=strength), found, day)) == [(f"{id}.{parameter}", inside)]

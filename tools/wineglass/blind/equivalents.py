"""Parameters that the generator's forms and the diagnosis' catalogue both have, and how one becomes the other: what intervals are checked with."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from wineglass.blind.sheet import Effect

DEG_H = math.pi / 180.0 / 3600.0

# (effect, variant of the generator) -> (parameter of the diagnosis, factor from the generator's strength)
SAME: dict[tuple[str, str], tuple[str, float]] = {
    ("frequency_temperature", "slope"): ("slope_ppm_per_degc", 1.0),
    ("frequency_temperature", "curvature"): ("curvature_ppm_per_degc2", 1.0),
    ("damping_temperature", "slope"): ("slope_per_degc", 1.0),
    ("damping_temperature", "curvature"): ("curvature_per_degc2", 1.0),
    ("cross_damping", "constant"): ("c0_rad_s", DEG_H),
    ("cross_damping", "slope"): ("c1_rad_s_per_degc", DEG_H),
    ("coriolis_gain", "constant"): ("gain", 1.0),
    ("coriolis_gain", "slope"): ("slope_per_degc", 1.0),
    ("coriolis_gain", "cubic"): ("cubic_s2_rad2", 1.0),
    ("thermal_gradient", "derivative"): ("bias_rad_s_per_degc_s", DEG_H),
    ("drive_misalignment", "constant"): ("angle_rad", 1e-3),
    ("drive_misalignment", "thermal"): ("slope_rad_per_degc", 1e-3),
    ("actuator_gain", "slope"): ("slope_per_degc", 1.0),
    ("actuator_gain", "curvature"): ("curvature_per_degc2", 1.0),
    ("pickoff_gain", "constant"): ("gain", 1.0),
    ("pickoff_gain", "slope"): ("slope_per_degc", 1.0),
    ("thermometer_error", "offset"): ("offset_degc", 1.0),
    ("thermometer_error", "gain"): ("gain", 1.0),
    ("thermometer_lag", "one_pole"): ("lag_s", 1.0),
    ("thermometer_quantisation", "steps"): ("step_degc", 1.0),
    ("rate_reference", "scale"): ("scale", 1.0),
    ("rate_reference", "offset"): ("offset_rad_s", DEG_H),
}


def covered(effect: Effect, found: list[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    """(effect and parameter, does the interval hold the truth?) where the diagnosis named the effect with that parameter."""
    name, factor = SAME.get((effect.id, effect.variant), ("", 0.0))
    for one in found:
        for parameter in one["parameters"]:
            if one["id"] == effect.id and parameter["name"] == name:
                low, high = parameter["interval"]
                yield f"{effect.id}.{name}", low <= effect.strength * factor <= high

"""Units that files may carry, and their conversion to SI. One table; a unit that is not in it is refused by the callers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Values = TypeVar("Values", float, np.ndarray)


@dataclass(frozen=True)
class Unit:
    """value in the dimension's base unit = value in this unit * factor + offset"""

    name: str
    dimension: str
    factor: float = 1.0
    offset: float = 0.0


_DEG = math.pi / 180.0

_TABLE = [
    Unit("rad/s", "rate"),
    Unit("mrad/s", "rate", 1e-3),
    Unit("urad/s", "rate", 1e-6),
    Unit("deg/s", "rate", _DEG),
    Unit("mdeg/s", "rate", 1e-3 * _DEG),
    Unit("deg/h", "rate", _DEG / 3600.0),
    Unit("rad", "angle"),
    Unit("deg", "angle", _DEG),
    Unit("degC", "temperature"),
    Unit("K", "temperature", 1.0, -273.15),
    Unit("s", "time"),
    Unit("ms", "time", 1e-3),
    Unit("us", "time", 1e-6),
    Unit("min", "time", 60.0),
    Unit("h", "time", 3600.0),
    Unit("Hz", "frequency"),
    Unit("kHz", "frequency", 1e3),
    Unit("FS", "full scale"),
    Unit("bits", "bits"),
    Unit("LSB", "codes"),
]
_ALIASES = {"°/s": "deg/s", "dps": "deg/s", "°/h": "deg/h", "dph": "deg/h", "°C": "degC", "µs": "us", "μs": "us"}

_BY_NAME = {unit.name: unit for unit in _TABLE}
_BY_NAME.update({alias: _BY_NAME[name] for alias, name in _ALIASES.items()})

BASE_UNIT = {unit.dimension: unit.name for unit in reversed(_TABLE) if unit.factor == 1.0 and unit.offset == 0.0}


def find(name: str) -> Unit | None:
    """The unit of that name, or None."""
    return _BY_NAME.get(name.strip())


def names(dimension: str | None = None) -> list[str]:
    """Names of the known units, of one dimension or all."""
    return [unit.name for unit in _TABLE if dimension in (None, unit.dimension)]


def to_base(values: Values, unit: Unit) -> Values:
    """Values in `unit` -> values in the base unit of its dimension (rad/s, degC, s, Hz, FS, bits)."""
    if unit.factor == 1.0 and unit.offset == 0.0:
        return values
    return values * unit.factor + unit.offset


RAD_S_IN_DEG_H = 3600.0 / _DEG

"""The catalogue of effects: ways in which a real gyro differs from the nominal twin, for both twins. The records are in sim/effects/.

    find("frequency_split").parameters
    Twin(run, effects=[Setting("frequency_split", {"split_hz": 0.05})])
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from wineglass.errors import BadInput
from wineglass.native import ffi, library

STAGES = ("primary", "secondary", "coupling", "actuation", "pickoff", "clock", "temperature", "environment", "firmware")


@dataclass(frozen=True)
class Parameter:
    """strength: the effect is absent when all of its strengths and forms are zero; form: bends the law that the equation states; otherwise a shape, whose
    usual value holds when it is not given. typical: size in real devices; source: where it comes from"""

    name: str
    unit: str
    strength: bool
    form: bool
    usual: float
    low: float
    high: float
    typical: float
    source: str


@dataclass(frozen=True)
class Effect:
    """One record of the catalogue."""

    index: int
    id: str
    stage: str
    equation: str
    appearance: str
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True)
class Setting:
    """An effect switched on; parameters that are not named have their usual value."""

    id: str
    values: dict[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        """As `parse` reads it: ID:param=value,param=value"""
        values = ",".join(f"{name}={value:g}" for name, value in self.values.items())
        return f"{self.id}:{values}" if values else self.id


@cache
def catalogue() -> tuple[Effect, ...]:
    """All effects, in alphabetical order."""
    return tuple(_record(index) for index in range(library().effect_count()))


def find(effect_id: str) -> Effect:
    for effect in catalogue():
        if effect.id == effect_id:
            return effect
    raise BadInput(f"there is no effect '{effect_id}'", "effects", f"choose one of {', '.join(effect.id for effect in catalogue())}")


def typical(effect_id: str, factor: float = 1.0) -> Setting:
    """Every strength at `factor` times its typical size."""
    effect = find(effect_id)
    return Setting(effect_id, {p.name: factor * p.typical for p in effect.parameters if p.strength})


def parse(text: str) -> Setting:
    """ID:param=value,param=value; ID alone: at its typical size; ID:xN: N times that."""
    effect_id, _, rest = text.partition(":")
    if not rest:
        return typical(effect_id)
    if "=" not in rest:
        return typical(effect_id, _number(rest.removeprefix("x"), text))
    pairs = [part.partition("=") for part in rest.split(",")]
    setting = Setting(effect_id, {name.strip(): _number(value, text) for name, _, value in pairs})
    _values(find(effect_id), setting)
    return setting


def _number(value: str, text: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise BadInput(f"'{value}' is not a number", f"effect {text}", "write ID:param=value,param=value, ID:xFACTOR, or ID alone") from None


def settings(chosen: Sequence[Setting]) -> Any:
    """struct effect_setting[]; BadInput names what is unknown or out of bounds."""
    array = ffi.new("struct effect_setting[]", max(1, len(chosen)))
    for place, setting in enumerate(chosen):
        effect = find(setting.id)
        array[place].effect = effect.index
        for number, value in enumerate(_values(effect, setting)):
            array[place].value[number] = value
    return array


def _values(effect: Effect, setting: Setting) -> list[float]:
    names = [parameter.name for parameter in effect.parameters]
    unknown = [name for name in setting.values if name not in names]
    if unknown:
        raise BadInput(f"it has no parameter '{unknown[0]}'", f"effect {effect.id}", f"its parameters are {', '.join(names)}")
    return [_bounded(effect, parameter, float(setting.values.get(parameter.name, parameter.usual))) for parameter in effect.parameters]


def _bounded(effect: Effect, parameter: Parameter, value: float) -> float:
    if not parameter.low <= value <= parameter.high:
        raise BadInput(f"{parameter.name} = {value:g} {parameter.unit} is not possible", f"effect {effect.id}",
                       f"stay within {parameter.low:g} to {parameter.high:g} {parameter.unit}")
    return value


def _text(pointer: Any) -> str:
    return ffi.string(pointer).decode() if pointer != ffi.NULL else ""


def _record(index: int) -> Effect:
    native = library()
    parameters = tuple(_parameter(native.effect_parameter(index, i)) for i in range(native.effect_parameter_count(index)))
    return Effect(index, _text(native.effect_text(index, 0)), STAGES[native.effect_stage(index)], _text(native.effect_text(index, 1)),
                  _text(native.effect_text(index, 2)), parameters)


def _parameter(record: Any) -> Parameter:
    return Parameter(_text(record.name), _text(record.unit), record.kind == 1, record.kind == 2, record.usual, record.low, record.high, record.typical,
                     _text(record.source))

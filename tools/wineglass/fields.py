"""Fields with units for the readable files (devices, scenarios): declaration, listing, and refusals in one line."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from wineglass.errors import BadInput


class Section(BaseModel):
    """A table of a file: unknown keys are refused, values are finite and do not change after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


def quantity(default: Any, unit: str, meaning: str, **limits: Any) -> Any:
    """A field with its unit; `default` may be ... for a field that must be given. Limits as pydantic's (gt, ge, lt, le)."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit}, **limits)


@dataclass(frozen=True)
class FieldRow:
    """One line of a field listing."""

    path: str
    value: Any
    default: Any
    unit: str
    meaning: str


def unit_of(model: type[BaseModel], name: str) -> str:
    extra = model.model_fields[name].json_schema_extra
    return str(extra["unit"]) if isinstance(extra, dict) else ""


def rows(section: BaseModel, prefix: str = "") -> list[FieldRow]:
    """Every field of a section and of the sections in it, depth first."""
    found: list[FieldRow] = []
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        path = f"{prefix}{name}"
        if isinstance(value, BaseModel):
            found += rows(value, f"{path}.")
        else:
            default = "required" if info.is_required() else info.get_default(call_default_factory=True)
            found.append(FieldRow(path, value, default, unit_of(type(section), name), info.description or ""))
    return found


def validate(model: type[BaseModel], data: dict[str, Any], source: str) -> Any:
    """The model made of `data`, or one clear line: which field of which file, what is wrong, what to do."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise refusal(model, error, data, source) from None


def refusal(model: type[BaseModel], error: ValidationError, data: Any, source: str) -> BadInput:
    first = error.errors()[0]
    path = _keys_of_file(first["loc"], data)
    where = f"{source}, {_dotted(path)}" if path else source
    holder = _section_at(model, path[:-1])
    name = str(path[-1]) if path else ""
    if first["type"] == "extra_forbidden":
        return BadInput(f"unknown key '{name}'", where, _nearest(holder, name))
    if first["type"] == "missing":
        return BadInput(f"'{name}' is missing", where, f"add it{_unit_hint(holder, name)}")
    message = str(first["msg"]).removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    if first["type"] not in ("value_error", "assertion_error"):
        message += f", found {first['input']!r}"
    return BadInput(message, where, f"give another value{_unit_hint(holder, name)}")


def _keys_of_file(location: tuple[Any, ...], data: Any) -> list[Any]:
    """Pydantic puts the chosen member of a union into the location; only keys and indices of the file are kept, and the last part."""
    path = []
    for number, part in enumerate(location):
        inside = (isinstance(data, dict) and part in data) or (isinstance(data, list) and isinstance(part, int))
        if inside:
            data = data[part]
        if inside or number == len(location) - 1:
            path.append(part)
    return path


def _dotted(path: list[Any]) -> str:
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f"{'.' if text else ''}{part}"
    return text


def _section_at(model: type[BaseModel], path: list[Any]) -> type[BaseModel] | None:
    for part in path:
        info = model.model_fields.get(str(part))
        annotation = info.annotation if info is not None else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return None
        model = annotation
    return model


def _nearest(model: type[BaseModel] | None, name: str) -> str:
    known = list(model.model_fields) if model is not None else []
    stem = name.split("_")[0]
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.6) or [key for key in known if key.split("_")[0] == stem]
    if model is None or not near:
        return f"remove it; known keys: {', '.join(known)}" if known else "remove it"
    return f"did you mean '{near[0]}'{_unit_hint(model, near[0])}?"


def _unit_hint(model: type[BaseModel] | None, name: str) -> str:
    if model is None or name not in model.model_fields or not unit_of(model, name):
        return ""
    return f" (unit {unit_of(model, name)})"

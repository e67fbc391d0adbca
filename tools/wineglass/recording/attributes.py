"""Attributes and texts of HDF5 files as other programs write them: bytes or text, scalars or arrays of one element."""

from __future__ import annotations

import h5py
import numpy as np

from wineglass.errors import BadInput


def _scalar(attrs: h5py.AttributeManager, name: str, where: str, default: object) -> object:
    if name not in attrs:
        if default is None:
            raise BadInput(f"the attribute {name} is missing", where, "docs/recording.md describes the layout")
        return default
    value = attrs[name]
    if isinstance(value, np.ndarray):
        if value.size != 1:
            raise BadInput(f"the attribute {name} has {value.size} elements", where, "one is needed")
        value = value.ravel()[0]
    return value


def text(attrs: h5py.AttributeManager, name: str, where: str, default: str | None = None) -> str:
    value = _scalar(attrs, name, where, default)
    if isinstance(value, h5py.Empty):
        return ""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace").rstrip("\0")
    if not isinstance(value, str):
        raise BadInput(f"the attribute {name} is not a text", where, "docs/recording.md describes the layout")
    return str(value)


def number(attrs: h5py.AttributeManager, name: str, where: str, default: float | None = None) -> float:
    value = _scalar(attrs, name, where, default)
    if not isinstance(value, (int, float, np.number)) or isinstance(value, (bool, np.bool_, complex)) or not np.isfinite(value):
        raise BadInput(f"the attribute {name} is not a finite number", where, "docs/recording.md describes the layout")
    return float(value)


def integer(attrs: h5py.AttributeManager, name: str, where: str) -> int:
    value = _scalar(attrs, name, where, None)
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        return int(value)
    value = number(attrs, name, where)
    if value != int(value):
        raise BadInput(f"the attribute {name} is not a whole number", where, "docs/recording.md describes the layout")
    return int(value)


def whole_text(group: h5py.Group, name: str, where: str) -> str:
    """A text dataset, or "" where there is none."""
    if name not in group:
        return ""
    value = np.asarray(group[name][()]).ravel()
    if value.size == 0:
        return ""
    if value.size != 1 or not isinstance(value[0], (bytes, str)):
        raise BadInput(f"{name} is not a text", where, "docs/recording.md describes the layout")
    return value[0].decode("utf-8", "replace") if isinstance(value[0], bytes) else str(value[0])

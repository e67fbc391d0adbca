"""Reading and writing the TOML that the tools use: tables of numbers, texts, switches and lists."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from wineglass.errors import BadInput


def read(path: Path) -> dict[str, Any]:
    try:
        return loads(path.read_text(encoding="utf-8"), str(path))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a UTF-8 text"
        raise BadInput(f"cannot be read: {reason}", str(path), "give the path of a TOML file") from None


def loads(text: str, source: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"not valid TOML: {error}", source, "correct that line") from None


def dumps(data: dict[str, Any]) -> str:
    """Text that reads back as `data` (None is left out)."""
    lines = [f"{_key(key)} = {value(item)}" for key, item in data.items() if item is not None and not isinstance(item, dict)]
    for key, table in data.items():
        if isinstance(table, dict):
            lines += ["", f"[{_key(key)}]"]
            lines += [f"{_key(name)} = {value(item)}" for name, item in table.items() if item is not None]
    return "\n".join(lines).lstrip("\n") + "\n"


def _key(key: str) -> str:
    return key if key.replace("_", "").replace("-", "").isalnum() else json.dumps(key)


def value(thing: Any) -> str:
    """As it stands behind the equals sign, on one line."""
    if isinstance(thing, dict):
        return "{ " + ", ".join(f"{_key(key)} = {value(item)}" for key, item in thing.items() if item is not None) + " }"
    if isinstance(thing, (list, tuple)):
        return "[" + ", ".join(value(item) for item in thing) + "]"
    return json.dumps(thing, ensure_ascii=False)


def merge(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `over` on top, table by table."""
    merged = dict(base)
    for key, value in over.items():
        both_tables = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = merge(merged[key], value) if both_tables else value
    return merged


def nested(dotted: dict[str, Any]) -> dict[str, Any]:
    """{"a.b": 1} -> {"a": {"b": 1}}"""
    tree: dict[str, Any] = {}
    for path, value in dotted.items():
        *tables, name = path.split(".")
        branch: dict[str, Any] = {name: value}
        for table in reversed(tables):
            branch = {table: branch}
        tree = merge(tree, branch)
    return tree


def assignment(text: str) -> tuple[str, Any]:
    """'key.path=value' as given on the command line; a value that is not TOML counts as a text."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise BadInput(f"'{text}' is not KEY=VALUE", "--set", "write for example --set resonator.split_hz=0.005")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()

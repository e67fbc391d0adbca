"""Packages that only the blind check needs."""

from __future__ import annotations

import importlib
from types import ModuleType

from wineglass.errors import BadInput


def need(module: str) -> ModuleType:
    """The module, or one line that says what to install."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise BadInput(f"the Python package {module.partition('.')[0]} is not installed", "blind", "install the extra: pip install 'wineglass[blind]'") from None

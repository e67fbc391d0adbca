"""Where things are in the working tree. Standard library only."""

from __future__ import annotations

import os
from pathlib import Path

from wineglass.errors import BadInput

LIBRARY_VARIABLE = "WINEGLASS_TWIN_LIBRARY"


def repository_root() -> Path:
    """The folder with the launcher, CMakeLists.txt and the rooms."""
    return Path(__file__).resolve().parents[2]


def build_folder(preset: str = "release") -> Path:
    return repository_root() / "build" / preset


def twin_library() -> Path:
    """The shared library with firmware, host port and simulator; WINEGLASS_TWIN_LIBRARY chooses another one."""
    override = os.environ.get(LIBRARY_VARIABLE)
    if override:
        path, todo = Path(override), f"set {LIBRARY_VARIABLE} to an existing library or unset it"
    else:
        path = build_folder() / "lib" / "libwineglass_twin.so"
        todo = "run the tools through ./wineglass, which builds it"
    if not path.is_file():
        raise BadInput("the twin library is not there", path, todo)
    return path

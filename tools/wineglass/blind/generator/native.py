"""The examiner's plant (exam/, C) through cffi. What it declares is read from the headers themselves."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from cffi import FFI

from wineglass import paths
from wineglass.errors import BadInput

LIBRARY_VARIABLE = "WINEGLASS_EXAM_LIBRARY"
HEADERS = ("hal/host/wineglass_device.h", "exam/exam.h")
BEGIN, END = "/* cdef begin */", "/* cdef end */"


def _declarations() -> str:
    """The regions between the marks, without the export macro."""
    regions = [(paths.repository_root() / header).read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0] for header in HEADERS]
    return "\n".join(regions).replace("WG_EXPORT ", "")


ffi = FFI()
ffi.cdef(_declarations())


def _names(kind: str, *prefixes: str) -> dict[str, int]:
    """Name without its prefixes -> number, in the order of the numbers."""
    found = {}
    for number, name in sorted(ffi.typeof(f"enum {kind}").elements.items()):
        for prefix in prefixes:
            name = name.removeprefix(prefix)
        found[name.lower()] = number
    return found


QUANTITIES = {name: number for name, number in _names("exam_quantity", "EXAM_").items() if name != "quantities"}
PLACES = _names("exam_place", "EXAM_", "AT_")
TROUBLES = _names("exam_trouble", "EXAM_")


def library_path() -> Path:
    """Of the release build, or what WINEGLASS_EXAM_LIBRARY names."""
    given = os.environ.get(LIBRARY_VARIABLE)
    path = Path(given) if given else paths.build_folder() / "lib" / "libwineglass_exam.so"
    if not path.is_file():
        todo = f"set {LIBRARY_VARIABLE} to an existing library or unset it" if given else "run the tools through ./wineglass, which builds it"
        raise BadInput("the examiner's library is not there", path, todo)
    return path


@cache
def library() -> Any:
    """The loaded library. BadInput when it has not been built."""
    path = library_path()
    try:
        loaded = ffi.dlopen(str(path))
        layout = loaded.exam_layout()
    except (OSError, AttributeError) as error:
        raise BadInput(f"the examiner's library cannot be loaded ({str(error).splitlines()[0]})", path, "build it again") from None
    if layout != len(QUANTITIES) << 32 | ffi.sizeof("struct exam_cfg"):
        raise BadInput("the examiner's library was built from other sources than these", path, "build it again")
    return loaded


def pointer(array: np.ndarray, ctype: str) -> Any:
    """C pointer to a contiguous array, e.g. pointer(rates, "double"). The array must outlive the call."""
    if not array.flags.c_contiguous or array.itemsize != ffi.sizeof(ctype):
        raise ValueError(f"a contiguous array of {ctype} is needed")
    return ffi.cast(f"{ctype} *", ffi.from_buffer(array, require_writable=False))

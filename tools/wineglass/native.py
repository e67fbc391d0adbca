"""The C library (firmware, host port, simulator) through cffi. What it declares is read from the headers themselves.

    from wineglass.native import ffi, library
    library().wg_crc32(b"123456789", 9)
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from cffi import FFI

from wineglass import paths
from wineglass.errors import BadInput

HEADERS = ("hal/host/wineglass_device.h", "sim/resonator.h", "sim/thermal.h", "sim/electronics.h",
           "sim/effects/effect.h", "sim/twin.h", "sim/effect_set.h", "sim/envelope.h")
BEGIN, END = "/* cdef begin */", "/* cdef end */"


def _declarations() -> str:
    """The regions between the marks, without the export macro."""
    root = paths.repository_root()
    regions = []
    for header in HEADERS:
        _, _, rest = (root / header).read_text(encoding="utf-8").partition(BEGIN)
        regions.append(rest.partition(END)[0])
    return "\n".join(regions).replace("WG_EXPORT ", "")


ffi = FFI()
ffi.cdef(_declarations())


@cache
def library() -> Any:
    """The loaded library. BadInput when it has not been built."""
    path = paths.twin_library()
    try:
        return ffi.dlopen(str(path))
    except OSError as error:
        raise BadInput(f"the twin library cannot be loaded ({str(error).splitlines()[0]})", path, "build it again") from None


def pointer(array: np.ndarray | None, ctype: str) -> Any:
    """C pointer to a contiguous array, e.g. pointer(rates, "double"); None gives NULL. The array must outlive the call."""
    if array is None:
        return ffi.NULL
    if not array.flags.c_contiguous or array.itemsize != ffi.sizeof(ctype):
        raise ValueError(f"a contiguous array of {ctype} is needed")
    return ffi.cast(f"{ctype} *", ffi.from_buffer(array, require_writable=False))

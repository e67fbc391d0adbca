"""The arrows of the architecture: who may include whom."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Those of C11 without float.h and iso646.h; stdatomic.h comes with the compiler, too, and C23 counts it among them.
FREESTANDING = {"limits.h", "stdalign.h", "stdarg.h", "stdatomic.h", "stdbool.h", "stddef.h", "stdint.h", "stdnoreturn.h"}

# Room -> prefixes of the headers that it may include with quotes. The longest matching room counts; a port (a folder
# in hal/) may also include its own headers, but not those of another port.
ALLOWED = {
    "firmware/core": ("core/",),
    "firmware/application": ("core/", "application/", "hal/hal.h"),
    "hal": ("core/", "application/", "hal/hal.h", "hal/simulated/", "hal/stream/", "hal/cortex_m/"),  # what several ports share
    "sim": ("core/", "application/", "hal/hal.h", "hal/host/", "sim/"),
    "exam": ("hal/host/wineglass_device.h", "exam/"),  # the second plant knows the firmware by its C interface
}
INTEGER_ROOMS = ("firmware/core", "firmware/application")

INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*([<"])([^>"]+)[>"]', re.MULTILINE)


def room_of(path: str) -> str:
    return max((room for room in ALLOWED if path.startswith(room + "/")), key=len, default="")


def violations(path: str, text: str) -> list[str]:
    """What is wrong with the includes of one file (path relative to the root)."""
    room = room_of(path)
    if not room:
        return [f"{path}: stands in no room"]
    allowed = ALLOWED[room]
    if room == "hal" and path.count("/") > 1:
        allowed += (path.rsplit("/", 1)[0] + "/",)
    found = []
    for bracket, header in INCLUDE.findall(text):
        if bracket == '"' and not header.startswith(allowed):
            found.append(f'{path}: "{header}" is not for {room}')
        if bracket == "<" and room in INTEGER_ROOMS and header not in FREESTANDING:
            found.append(f"{path}: <{header}> is not a freestanding header")
    return found


def sources() -> list[Path]:
    return sorted(path for room in ("firmware", "hal", "sim", "exam") for path in (ROOT / room).rglob("*.[ch]"))


def test_rooms_have_sources():
    assert sources()


@pytest.mark.parametrize("path", sources(), ids=lambda path: str(path.relative_to(ROOT)))
def test_includes_follow_the_arrows(path):
    assert violations(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("path, text", [
    ("firmware/core/a.c", '#include "application/x.h"'),
    ("firmware/core/a.c", '#include "hal/hal.h"'),
    ("firmware/core/a.c", "#include <math.h>"),
    ("firmware/core/a.c", "  #  include <stdlib.h>"),
    ("firmware/application/a.c", '#include "hal/host/wineglass_device.h"'),
    ("firmware/application/a.c", '#include "sim/twin.h"'),
    ("hal/hal.h", '#include "hal/host/wineglass_device.h"'),
    ("hal/host/a.c", '#include "sim/twin.h"'),
    ("hal/mps2/a.c", '#include "hal/host/wineglass_device.h"'),
    ("sim/a.c", '#include "support/x.h"'),
    ("sim/a.c", '#include "exam/exam.h"'),
    ("exam/a.c", '#include "sim/twin.h"'),
    ("exam/a.c", '#include "core/gyro.h"'),
    ("sim/a.c", '#include "../tests/x.h"'),
])
def test_wrong_directions_are_found(path, text):
    assert violations(path, text)


@pytest.mark.parametrize("path, text", [
    ("firmware/core/a.c", '#include "core/b.h"\n#include <stdint.h>'),
    ("firmware/application/a.c", '#include "hal/hal.h"'),
    ("hal/host/a.c", '#include <stdlib.h>\n#include "application/application.h"'),
    ("hal/mps2/a.c", '#include "hal/mps2/semihosting.h"\n#include "hal/stream/stream.h"'),
    ("sim/effects/a.c", '#include <math.h>\n#include "sim/plant.h"'),
])
def test_right_directions_are_accepted(path, text):
    assert violations(path, text) == []

"""Writing the image into a board: which tool, which command line, and what must be true of the image before."""

from __future__ import annotations

import shutil
import subprocess
import zlib
from pathlib import Path

from wineglass.errors import BadInput, WineglassError

FLASH_START = 0x08000000
PROGRAM_BYTES = 48 * 1024
"""Sectors 0 to 2. Behind them stands the calibration, which a new program must not touch."""
BAUD = 115_200
TOOLS = ("openocd", "stm32flash")


def check(image: Path) -> int:
    """Length of a .bin image that is sealed and fits; anything else is refused before a board is touched."""
    try:
        content = image.read_bytes()
    except FileNotFoundError:
        raise BadInput("the image is not there", image, "leave out --no-build, or give its .bin file") from None
    if not 8 < len(content) <= PROGRAM_BYTES:
        raise BadInput(f"{len(content)} bytes are no image; it has at most {PROGRAM_BYTES}", image, "give the .bin file of the build")
    if zlib.crc32(content[:-4]).to_bytes(4, "little") != content[-4:]:
        raise BadInput("the image has no valid seal (CRC-32 at its end)", image, "build it again, and give the .bin file")
    return len(content)


def choose(wanted: str | None, port: str | None) -> str:
    """The tool: the wanted one, else stm32flash when a serial port is named, else openocd."""
    tool = wanted or ("stm32flash" if port else "openocd")
    if tool == "stm32flash" and not port:
        raise BadInput("stm32flash needs the serial port of the board", "--port", "give --port /dev/ttyUSB0, and start the board with BOOT0 high")
    if tool == "openocd" and port:
        raise BadInput("openocd uses an ST-Link, not a serial port", "--port", "leave it out, or choose --tool stm32flash")
    return tool


def require(tool: str) -> None:
    if not shutil.which(tool):
        raise WineglassError(f"{tool} is not installed; apt-get install {tool}, or choose the other one of {' and '.join(TOOLS)} with --tool")


def command(tool: str, image: Path, length: int, port: str | None) -> list[str]:
    """Erase the sectors of the program only, write, read back, start."""
    if tool == "openocd":
        return ["openocd", "-f", "interface/stlink.cfg", "-f", "target/stm32f4x.cfg",
                "-c", f"program {{{image}}} verify reset exit {FLASH_START:#010x}"]
    return ["stm32flash", "-b", str(BAUD), "-S", f"{FLASH_START:#010x}:{length}", "-w", str(image), "-v", "-g", "0x0", str(port)]


def run(words: list[str]) -> None:
    done = subprocess.run(words, check=False)
    if done.returncode != 0:
        raise WineglassError(f"{words[0]} ended with status {done.returncode}; the board may hold half a program, flash it again")

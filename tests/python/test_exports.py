"""The shared library shows what the headers declare with WG_EXPORT, and nothing else."""

import re
import subprocess
from pathlib import Path

from wineglass.paths import twin_library

ROOT = Path(__file__).resolve().parents[2]

DECLARATION = re.compile(r"^WG_EXPORT\s[^;{]*?(\w+)\s*\(", re.MULTILINE)


def declared() -> set[str]:
    headers = [path for room in ("hal", "sim") for path in (ROOT / room).rglob("*.h") if path.name != "wg_export.h"]
    return {name for header in headers for name in DECLARATION.findall(header.read_text(encoding="utf-8"))}


def test_exported_functions_are_exactly_the_declared_ones():
    symbols = subprocess.run(["nm", "--dynamic", "--defined-only", str(twin_library())], text=True,
                             capture_output=True, check=True).stdout
    exported = {line.split()[2] for line in symbols.splitlines()} - {"_init", "_fini"}
    assert "wg_device_create" in exported
    assert exported == declared()

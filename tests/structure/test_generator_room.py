"""The examiner's generator shares nothing with the twin and nothing with the diagnosis: neither C nor Python."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROOM = "wineglass.blind.generator"
FOLDER = ROOT / "tools/wineglass/blind/generator"

# Descriptions and scenarios as data, the recording, the wire, the calibration block's bytes.
ALLOWED = {"wineglass", "wineglass.device", "wineglass.scenario", "wineglass.schedule", "wineglass.calibration_block", "wineglass.commands_wire",
           "wineglass.recording", "wineglass.recording.memory", "wineglass.telemetry", "wineglass.telemetry_recording", "wineglass.wire", "wineglass.errors", "wineglass.paths"}
FORBIDDEN_WORDS = re.compile(r"\bsim/|twin_|resonator_cfg|wineglass\.(twin|envelope|effects|diagnosis|nominal|native|simulation)\b")


def imported(tree: ast.AST) -> set[str]:
    """Modules of the product that a file imports, `from wineglass import x` as wineglass.x."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module == "wineglass":
            found |= {f"wineglass.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            found.add(node.module or "")
    return {name for name in found if name.split(".")[0] == "wineglass"}


def violations(text: str) -> list[str]:
    found = [name for name in imported(ast.parse(text)) if name not in ALLOWED and not (name + ".").startswith(ROOM + ".")]
    return sorted(found) + FORBIDDEN_WORDS.findall(text)


def sources() -> list[Path]:
    return sorted(FOLDER.rglob("*.py"))


def test_the_room_has_sources():
    assert len(sources()) > 10 and len(list((ROOT / "exam").glob("*.c"))) > 3


@pytest.mark.parametrize("path", sources(), ids=lambda path: str(path.relative_to(ROOT)))
def test_python_imports_nothing_of_twin_or_diagnosis(path):
    assert violations(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("text", [
    "from wineglass import twin", "import wineglass.envelope", "from wineglass.effects import Setting", "from wineglass.diagnosis.gap import x",
    "from wineglass import nominal", "from wineglass.native import ffi", "import wineglass.simulation", "ffi.cdef(open('sim/twin.h').read())",
])
def test_wrong_imports_are_found(text):
    assert violations(text)


@pytest.mark.parametrize("path", sorted((ROOT / "exam").glob("*.[ch]")), ids=lambda path: path.name)
def test_c_names_nothing_of_the_twin(path):
    text = path.read_text(encoding="utf-8")
    headers = re.findall(r'#\s*include\s*"([^"]+)"', text)
    assert all(header.startswith("exam/") or header == "hal/host/wineglass_device.h" for header in headers)
    assert not re.search(r"sim/|\btwin_\w+|\bresonator_\w+\(", text)


def test_its_library_is_linked_without_the_twin():
    text = (ROOT / "exam/CMakeLists.txt").read_text(encoding="utf-8")
    linked = re.findall(r"wineglass_(\w+)", text)
    assert "sim" not in linked and "twin" not in linked and "foreach(room core application host)" in text

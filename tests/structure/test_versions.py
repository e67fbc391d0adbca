"""One version number, said in four places."""

import re
import tomllib
from pathlib import Path

import wineglass

ROOT = Path(__file__).resolve().parents[2]


def test_cmake_python_and_package_agree():
    cmake = re.search(r"project\(wineglass VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    header = (ROOT / "firmware/application/version.h").read_text(encoding="utf-8")
    firmware = ".".join(re.findall(r"#define FIRMWARE_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", header))
    assert cmake.group(1) == project["version"] == wineglass.__version__ == firmware


def test_the_changelog_knows_the_version():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## \[Unreleased\]", text, re.MULTILINE) or f"## [{wineglass.__version__}]" in text

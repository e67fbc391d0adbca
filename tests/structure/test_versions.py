"""One version number, said in three places."""

import re
import tomllib
from pathlib import Path

import wineglass

ROOT = Path(__file__).resolve().parents[2]


def test_cmake_python_and_package_agree():
    cmake = re.search(r"project\(wineglass VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert cmake.group(1) == project["version"] == wineglass.__version__


def test_the_changelog_knows_the_version():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## \[Unreleased\]", text, re.MULTILINE) or f"## [{wineglass.__version__}]" in text

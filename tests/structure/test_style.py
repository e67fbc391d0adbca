"""What the linters do not say."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Runs before the environment exists, under whatever python3 the machine has.
EARLY = [ROOT / "wineglass", ROOT / "tools/wineglass/__init__.py", ROOT / "tools/wineglass/cli.py",
         ROOT / "tools/wineglass/errors.py", *sorted((ROOT / "tools/wineglass/launch").glob("*.py"))]
EARLY_MODULES = {"__future__", "argparse", "ast", "collections", "contextlib", "difflib", "fcntl", "hashlib",
                 "importlib", "os", "pathlib", "re", "shutil", "signal", "subprocess", "sys", "threading", "time", "typing", "wineglass"}


@pytest.mark.parametrize("path", EARLY, ids=lambda path: str(path.relative_to(ROOT)))
def test_set_up_code_is_python_3_9_and_standard_library(path):
    tree = ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 9))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    assert {name.split(".")[0] for name in names} <= EARLY_MODULES
    assert not any(isinstance(node, ast.Match) for node in ast.walk(tree))


def test_annotations_are_not_evaluated_early():
    for path in EARLY[2:]:
        text = path.read_text(encoding="utf-8")
        assert "from __future__ import annotations" in text or "def " not in text, path

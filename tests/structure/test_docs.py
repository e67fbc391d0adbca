"""Documents that lead somewhere: every link resolves, every command is told about."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
COMMANDS = sorted(path.stem.rstrip("_").replace("_", "-") for path in (ROOT / "tools/wineglass/commands").glob("[a-z]*.py"))


def anchors(text: str) -> set[str]:
    """As a forge makes them of headings."""
    return {re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE)}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_resolve(path: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        if re.match(r"https?:|mailto:", link):
            continue
        name, _, anchor = link.partition("#")
        target = path.parent / name if name else path
        assert target.exists(), link
        assert not anchor or target.suffix != ".md" or anchor in anchors(target.read_text(encoding="utf-8")), link


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_documents_named_in_the_text_exist(path: Path) -> None:
    for name in re.findall(r"(?<![\w/.])(?:[\w-]+/)*[\w-]+\.md\b", path.read_text(encoding="utf-8")):
        assert any((folder / name).is_file() for folder in (ROOT, ROOT / "docs", path.parent)), name


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_told_about(command: str) -> None:
    assert any(f"wineglass {command}" in path.read_text(encoding="utf-8") for path in DOCUMENTS)


def test_there_is_something_to_check() -> None:
    assert len(DOCUMENTS) > 10 and {"diagnose", "import", "design-loop"} <= set(COMMANDS)

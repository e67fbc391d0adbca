"""requirements.lock: hashes for everything, no addresses, all that pyproject.toml asks for."""

import re
import tomllib
from pathlib import Path

from wineglass.launch.environment import locked_entry

ROOT = Path(__file__).resolve().parents[2]
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def entries() -> dict[str, str]:
    """Package name -> its whole entry."""
    joined = re.sub(r"\\\n *", "", "\n".join(line for line in LOCK.splitlines() if not line.startswith("#")))
    return {line.split("==")[0]: line for line in joined.splitlines() if line.strip()}


def test_every_entry_is_pinned_and_hashed():
    assert len(entries()) > 20
    for name, entry in entries().items():
        assert re.match(r"[a-z0-9-]+==[0-9][^ ]* ", entry), name
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), name


def test_no_index_or_host_is_named():
    assert not re.search(r"https?:|index-url|find-links|trusted-host|\bpypi\b|files\.", LOCK, re.IGNORECASE)


def test_everything_asked_for_is_locked():
    asked = [*PROJECT["dependencies"], *(name for group in PROJECT["optional-dependencies"].values() for name in group)]
    missing = {re.split(r"[<>=!~\[; ]", name)[0] for name in asked} - set(entries())
    assert not missing, f"run tools/lock: {missing}"


def test_the_bootstrap_entry_is_complete():
    entry = locked_entry(LOCK, "uv")
    assert entry.startswith("uv==") and not entry.rstrip().endswith("\\")
    assert entry.count("--hash=") == LOCK.split("\nuv==")[1].split("==")[0].count("--hash=")

"""Where the parts of a blind set stand.

    DIR/recordings/case_0001.h5 ... manifest.json     what whoever diagnoses gets
    DIR/sealed/plan.json, case_0001.json ..., labels.json   what nobody opens before scoring; may be carried elsewhere
    DIR/sealed/allowances/KIND/     what tolerances may do to recordings of a kind; only for making
    DIR/results/ENGINE/case_0001.json ...             answers
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from wineglass.errors import BadInput


@dataclass(frozen=True)
class Folders:
    root: Path
    labels: Path | None = None
    """of the sealed part, where it is not in `root`"""
    kept: Path | None = None
    """allowances of other sets, to be shared"""

    @property
    def recordings(self) -> Path:
        return self.root / "recordings"

    @property
    def sealed(self) -> Path:
        return self.root / "sealed" if self.labels is None else self.labels

    @property
    def allowances(self) -> Path:
        return self.sealed / "allowances" if self.kept is None else self.kept

    def results(self, engine: str) -> Path:
        return self.root / "results" / engine

    @property
    def engines(self) -> list[str]:
        """Those that have answered."""
        folder = self.root / "results"
        return sorted(path.name for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []

    def recording(self, name: str) -> Path:
        return self.recordings / f"{name}.h5"

    def need_root(self) -> None:
        if not self.recordings.is_dir():
            raise BadInput("holds no blind set", self.root, "make one with `wineglass blind make`")

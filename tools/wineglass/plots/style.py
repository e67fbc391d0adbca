"""One look for every figure: sizes, colours by meaning, units on every axis, written atomically."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from wineglass.atomic import atomic_path

COLOURS = {
    "truth": "#9a9a9a",
    "none": "#d1495b",
    "static": "#edae49",
    "g2": "#00798c",
    "temperature": "#6d597a",
    "rate": "#00798c",
    "force": "#d1495b",
}
LABELS = {"none": "uncompensated", "static": "static: polynomial after demodulation", "g2": "G2: before demodulation"}
DEG_H_PER_RAD_S = 206264.80624709636  # (180 / pi) 3600


@contextmanager
def figure(path: Path, rows: int, height: float, ratios: list[float] | None = None) -> Iterator[tuple[Any, Any]]:
    """`rows` axes over one time axis; saved as PNG at `path` when the block ends well."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context({"font.size": 11, "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False,
                         "legend.frameon": False}):
        drawing, axes = plt.subplots(rows, 1, sharex=True, figsize=(10, height), constrained_layout=True,
                                     gridspec_kw={"height_ratios": ratios} if ratios else None)
        try:
            yield drawing, axes
            with atomic_path(path) as temporary:
                drawing.savefig(temporary, dpi=130, format="png")
        finally:
            plt.close(drawing)

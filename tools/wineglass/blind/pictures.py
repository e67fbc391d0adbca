"""Plots of the scoreboard as inline SVG."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import Any

from wineglass.blind.scores import bin_start

COLOURS = ("#00798c", "#d1495b", "#edae49", "#6d597a", "#66a182", "#9a9a9a", "#2e4057", "#b08968")
STYLE = {"font.size": 10, "font.family": "sans-serif", "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False,
         "legend.frameon": False, "svg.fonttype": "none", "svg.hashsalt": "wineglass"}


def reliability(engines: dict[str, dict[str, Any]]) -> str:
    """Share of right answers over confidence; the diagonal is honesty."""

    def plot(figure: Any) -> None:
        axis = figure.subplots()
        axis.plot([0, 1], [0, 1], color="#9a9a9a", lw=1)
        for colour, (name, scores) in zip(COLOURS, engines.items()):
            bins = scores["reliability"]
            x, y = [one["confidence"] for one in bins], [one["right"]["value"] for one in bins]
            low = [max(0.0, v - one["right"]["interval"][0]) for v, one in zip(y, bins)]
            high = [max(0.0, one["right"]["interval"][1] - v) for v, one in zip(y, bins)]
            axis.errorbar(x, y, yerr=[low, high], fmt="o-", ms=4, lw=1, capsize=2, color=colour, label=name)
        axis.set(xlabel="confidence", ylabel="share right, 95 %", xlim=(0, 1.02), ylim=(0, 1.02))
        axis.legend(fontsize=8)

    return svg(plot, 5.0, 4.0, "confidence and truth")


def risk(engines: dict[str, dict[str, Any]]) -> str:
    """Share of wrong ones among the surest answers."""

    def plot(figure: Any) -> None:
        axis = figure.subplots()
        for colour, (name, scores) in zip(COLOURS, engines.items()):
            axis.plot(scores["risk_over_coverage"]["coverage"], scores["risk_over_coverage"]["risk"], "o-", ms=3, lw=1.2, color=colour, label=name)
        axis.set(xlabel="coverage: share of cases answered, surest first", ylabel="risk: share of these wrong", xlim=(0, 1.02), ylim=(-0.02, 1.02))
        axis.legend(fontsize=8)

    return svg(plot, 5.0, 4.0, "risk against coverage")


def detection(scores: dict[str, Any]) -> str:
    """One small plot per effect: share seen and share named over strength."""
    curves = scores["detection"]
    if not curves:
        return ""
    columns = min(6, len(curves))
    rows = -(-len(curves) // columns)

    def plot(figure: Any) -> None:
        axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
        for axis, (name, curve) in zip(axes, curves.items()):
            x = [one["factor"] for one in curve["points"]]
            axis.semilogx(x, [one["seen"]["value"] for one in curve["points"]], "o-", ms=3, lw=1, color=COLOURS[0], label="seen")
            axis.semilogx(x, [one["named"]["value"] for one in curve["points"]], "s--", ms=3, lw=1, color=COLOURS[1], label="named")
            if curve["half_seen_factor"] is not None:
                axis.axvline(curve["half_seen_factor"], color="#9a9a9a", lw=1)
            axis.set_title(name.replace("_", " "), fontsize=7.5)
            axis.set(xlim=(0.08, 4.0), ylim=(-0.08, 1.08))
        for axis in axes[len(curves):]:
            axis.set_axis_off()
        figure.supxlabel("strength over the typical one", fontsize=9)
        axes[0].legend(fontsize=7)

    return svg(plot, 10.0, 0.6 + 1.35 * rows, "detection limits")


def confusion(scores: dict[str, Any]) -> str:
    """True effect against what was answered, of singles."""
    table = scores["confusion"]
    if not table:
        return ""
    answers = _columns(table)

    def plot(figure: Any) -> None:
        axis = figure.subplots()
        values = [[row.get(answer, 0) / sum(row.values()) for answer in answers] for row in table.values()]
        axis.imshow(values, cmap="Blues", vmin=0, vmax=1.3, aspect="auto")
        for y, row in enumerate(table.values()):
            for x, answer in enumerate(answers):
                if row.get(answer):
                    axis.text(x, y, row[answer], ha="center", va="center", fontsize=7)
        axis.set_xticks(range(len(answers)), [name.replace("_", " ") for name in answers], rotation=60, ha="right", fontsize=7)
        axis.set_yticks(range(len(table)), [name.replace("_", " ") for name in table], fontsize=7)
        axis.grid(False)
        axis.set(xlabel="answer", ylabel="truth")

    return svg(plot, 10.0, 1.8 + 0.2 * len(table), "confusion")


def by_snr(engines: dict[str, dict[str, Any]]) -> str:
    """Truth in set and unique and wrong over SNR."""

    def plot(figure: Any) -> None:
        for axis, score in zip(figure.subplots(1, 2, sharey=True), ("truth_in_set", "unique_and_wrong")):
            for colour, (name, scores) in zip(COLOURS, engines.items()):
                bins = sorted((key for key in scores["by_snr"] if scores["by_snr"][key][score]["n"]), key=bin_start)
                axis.plot(bins, [scores["by_snr"][key][score]["value"] for key in bins], "o-", ms=4, lw=1.2, color=colour, label=name)
            axis.set(title=score.replace("_", " "), xlabel="SNR of the gap", ylim=(-0.03, 1.03))
            axis.tick_params(axis="x", labelrotation=30, labelsize=8)
            axis.legend(fontsize=7)

    return svg(plot, 10.0, 3.6, "scores over SNR")


def _columns(table: dict[str, dict[str, int]]) -> list[str]:
    """Effects in the rows' order first, then the other answers."""
    said = {answer for row in table.values() for answer in row}
    return [name for name in table if name in said] + sorted(said - set(table))


def svg(plot: Callable[[Any], None], width: float, height: float, label: str) -> str:
    """An svg element with ids of its own, scaling with the page."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(STYLE):
        figure = plt.figure(figsize=(width, height), constrained_layout=True)
        try:
            plot(figure)
            file = io.StringIO()
            figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
        finally:
            plt.close(figure)
    text = file.getvalue()
    body = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg"):], flags=re.DOTALL)
    name = re.sub(r"\W+", "_", label)
    body = re.sub(r'\bid="([^"]+)"', rf'id="{name}_\1"', body)
    body = re.sub(r'(xlink:href="#|url\(#)([^")]+)', rf"\g<1>{name}_\2", body)
    return re.sub(r'<svg (.*?)width="[^"]*" height="[^"]*"', rf'<svg role="img" aria-label="{label}" \1', body, count=1)

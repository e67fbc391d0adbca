"""Figures of the report as inline SVG, drawn by matplotlib, text kept as text."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np

from wineglass.diagnosis.blocks import Blocks
from wineglass.diagnosis.contract import Diagnosis
from wineglass.diagnosis.rate_level import Analysis

BEFORE, AFTER, FLOOR, HELD = "#d1495b", "#00798c", "#9a9a9a", "#f3efe4"
STYLE = {"font.size": 10, "font.family": "sans-serif", "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False,
         "legend.frameon": False, "svg.fonttype": "none", "svg.hashsalt": "wineglass"}


def _svg(draw, width: float, height: float, label: str) -> str:  # noqa: ANN001 - a function of one figure
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(STYLE):
        figure = plt.figure(figsize=(width, height), constrained_layout=True)
        try:
            draw(figure)
            file = io.StringIO()
            figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
        finally:
            plt.close(figure)
    return _inline(file.getvalue(), label)


def _inline(text: str, label: str) -> str:
    """The svg element alone, with ids of its own (several stand in one page), scaling with the page."""
    body = text[text.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r' xmlns:(?!xlink)\w+="[^"]*"', "", body)
    name = re.sub(r"\W+", "_", label)[:24]
    body = re.sub(r'\bid="([^"]+)"', rf'id="{name}_\1"', body)
    body = re.sub(r'(xlink:href="#|url\(#)([^")]+)', rf"\g<1>{name}_\2", body)
    return re.sub(r'<svg (.*?)width="[^"]*" height="[^"]*"', rf'<svg role="img" aria-label="{label}" \1', body, count=1)


def over_time(found: Analysis) -> str:
    """Residual before and after over time, the held-out part shaded, the temperature below."""
    blocks, held = found.blocks, found.split.held
    minutes, factor, unit = blocks.time_s / 60.0, *_unit(found.before)

    def draw(figure: Any) -> None:
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
        for start, stop in _stretches(held):
            top.axvspan(minutes[start], minutes[stop], color=HELD, label="held out" if start == _stretches(held)[0][0] else None)
        top.axhspan(-2 * found.floor.rms * factor, 2 * found.floor.rms * factor, color=FLOOR, alpha=0.35, label="noise floor, ±2 rms", lw=0)
        top.plot(minutes, found.before * factor, color=BEFORE, lw=1.2, label="before: nominal twin")
        if found.best:
            top.plot(minutes, found.after * factor, color=AFTER, lw=1.2, label="after: with " + ", ".join(found.best))
        top.set_ylabel(f"recorded − twin [{unit}]")
        top.legend(loc="upper center", bbox_to_anchor=(0.5, 1.22), ncols=2, fontsize=9)
        bottom.plot(minutes, blocks.temperature_degc, color="#6d597a", lw=1.2)
        bottom.set(ylabel="T [°C]", xlabel="time [min]")

    return _svg(draw, 8.6, 4.6, "gap over time")


def over_temperature_and_slope(found: Analysis) -> str:
    """Residuals over measured temperature and its speed, before and after."""
    blocks = found.blocks
    slope = np.gradient(blocks.temperature_degc, blocks.time_s) * 60.0
    factor, unit = _unit(found.before)
    limit = float(np.quantile(np.abs(found.before), 0.98)) * factor or 1.0

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2, sharey=True)
        for axis, values, title in zip(axes, (found.before, found.after), ("before", "after")):
            dots = axis.scatter(blocks.temperature_degc, slope, c=values * factor, cmap="RdBu_r", vmin=-limit, vmax=limit, s=14)
            axis.set(title=title, xlabel="temperature [°C]")
        axes[0].set_ylabel("dT/dt [°C/min]")
        figure.colorbar(dots, ax=axes, label=f"recorded − twin [{unit}]")

    return _svg(draw, 8.6, 3.2, "gap over temperature and its speed")


def ambiguity(diagnosis: Diagnosis, found: Analysis) -> str:
    """How alike the named effects look in this recording: correlation of their signals beyond the nominal curve."""
    from wineglass.diagnosis import bayes, parameters

    names = [effect.id for effect in diagnosis.effects if effect.id in found.design.effects]
    if len(names) < 2:
        return ""
    nominal = found.design.matrix[:, list(found.design.statics[0])]
    signals = []
    for name in names:
        holder = next(tuple(ids) for ids in [*diagnosis.alternatives, *(h.ids for h in diagnosis.hypotheses)] if name in ids)
        mixture = bayes.fits(found.design, found.scores, found.blocks.white_rad_s, holder, np.arange(len(found.blocks)), 0.05)
        signal = parameters.contribution(found.design, mixture, name)
        if nominal.shape[1]:
            signal = signal - nominal @ np.linalg.lstsq(nominal, signal, rcond=None)[0]
        signals.append(signal)
    matrix = np.nan_to_num(np.corrcoef(signals))

    def draw(figure: Any) -> None:
        axis = figure.subplots()
        axis.imshow(np.abs(matrix), cmap="Oranges", vmin=0, vmax=1)
        axis.set_xticks(range(len(names)), names, rotation=20, ha="right")
        axis.set_yticks(range(len(names)), names)
        axis.grid(False)
        for i in range(len(names)):
            for j in range(len(names)):
                axis.text(j, i, f"{matrix[i, j]:+.2f}", ha="center", va="center", color="white" if abs(matrix[i, j]) > 0.6 else "black")

    return _svg(draw, 4.2 + 0.5 * len(names), 1.4 + 0.6 * len(names), "ambiguity matrix")


def spectrum(found: Analysis) -> str:
    """Amplitude spectral density of the residuals, before and after."""
    from scipy.signal import welch

    blocks = found.blocks
    rate_hz = (len(blocks) - 1) / float(blocks.time_s[-1] - blocks.time_s[0])

    def draw(figure: Any) -> None:
        axis = figure.subplots()
        for values, colour, name in ((found.before, BEFORE, "before"), (found.after, AFTER, "after")):
            frequency, density = welch(values, rate_hz, nperseg=min(128, len(values)), detrend="constant")
            axis.loglog(frequency[1:], np.sqrt(density[1:]), color=colour, label=name)
        white = found.blocks.white_rad_s * np.sqrt(2.0 / rate_hz)
        axis.axhline(white, color=FLOOR, ls="--", label="white noise")
        axis.set(xlabel="frequency [Hz]", ylabel="density [rad/s/√Hz]")
        axis.legend()

    return _svg(draw, 8.6, 2.8, "spectrum of the gap")


def _unit(values: np.ndarray) -> tuple[float, str]:
    size = float(np.max(np.abs(values)))
    return (1e3, "mrad/s") if size > 2e-4 else (1e6, "µrad/s")


def _stretches(mask: np.ndarray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(int), [0]))))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2])]


def branches(blocks: Blocks) -> str:
    return "; ".join(f"{b.kind} {blocks.time_s[b.start] / 60:.3g} to {blocks.time_s[b.stop - 1] / 60:.3g} min" for b in blocks.branches)

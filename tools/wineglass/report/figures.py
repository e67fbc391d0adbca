"""Figures of the report as inline SVG, drawn by matplotlib, text kept as text."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np

from wineglass.report.view import Channel, View

BEFORE, AFTER, FLOOR, HELD = "#d1495b", "#00798c", "#9a9a9a", "#f3efe4"
STYLE = {"font.size": 10, "font.family": "sans-serif", "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False,
         "legend.frameon": False, "svg.fonttype": "none", "svg.hashsalt": "wineglass"}
MOST_CHANNELS = 5
MOST_POINTS = 700
MOST_DOTS = 350
PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"))
PREFIXED = ("rad/s", "Hz")


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


def over_time(view: View) -> str:
    """Residuals of the channels with a gap, before and after, over time; temperature and rate below."""
    minutes, shown = view.time_s / 60.0, view.worst[:MOST_CHANNELS]
    inputs = [("T [°C]", view.temperature_degc)] + ([("rate [°/s]", view.rate_deg_s)] if view.rate_deg_s is not None else [])

    def draw(figure: Any) -> None:
        ratios = [3.0] * len(shown) + [1.2] * len(inputs)
        axes = np.atleast_1d(figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios))
        for axis, channel in zip(axes, shown):
            _residuals(axis, view, channel, minutes)
        for axis, (label, values) in zip(axes[len(shown):], inputs):
            axis.plot(*_thin(minutes, values), color="#6d597a", lw=1.2)
            axis.set_ylabel(label)
        axes[-1].set_xlabel("time [min]")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=9)

    return _svg(draw, 8.6, 0.7 + 2.1 * len(shown) + 1.0 * len(inputs), "gap over time")


def _residuals(axis: Any, view: View, channel: Channel, minutes: np.ndarray) -> None:
    factor, unit = _unit(channel)
    for number, (start, stop) in enumerate(_stretches(view.held) if view.held is not None else []):
        axis.axvspan(minutes[start], minutes[stop], color=HELD, label="held out" if number == 0 else None)
    axis.axhspan(-2 * channel.floor * factor, 2 * channel.floor * factor, color=FLOOR, alpha=0.35, label="noise floor, ±2 rms", lw=0)
    axis.plot(*_thin(minutes, channel.before * factor), color=BEFORE, lw=1.1, label="before: nominal twin")
    if view.best:
        axis.plot(*_thin(minutes, channel.after * factor), color=AFTER, lw=1.1, label="after: with " + ", ".join(view.best))
    axis.set_ylabel(f"{_spoken(channel.name)}\n[{unit}]", fontsize=9)
    axis.margins(x=0.01)


def over_temperature_and_slope(view: View) -> str:
    """Residuals of the worst channel over temperature and its speed, before and after; over rate and amplitude where these change."""
    channel = view.worst[0]
    slope = np.gradient(view.temperature_degc, view.time_s) * 60.0
    factor, unit = _unit(channel)
    finite = np.abs(channel.before[np.isfinite(channel.before)])
    limit = float(np.quantile(finite, 0.98)) * factor if len(finite) else 1.0
    beside = [(name, values) for name, values in (("rate [°/s]", view.rate_deg_s), ("amplitude [FS]", view.amplitude_fs)) if values is not None]

    def draw(figure: Any) -> None:
        upper, lower = (figure, None) if not beside else figure.subfigures(2, 1, height_ratios=[1.15, 1])
        axes = upper.subplots(1, 2, sharey=True)
        for axis, values, title in zip(axes, (channel.before, channel.after), ("before", "after")):
            x, y, colour = _thin(view.temperature_degc, slope, values * factor, most=MOST_DOTS)
            dots = axis.scatter(x, y, c=colour, cmap="RdBu_r", vmin=-(limit or 1.0), vmax=limit or 1.0, s=11, rasterized=False, linewidths=0)
            axis.set(title=title, xlabel="temperature [°C]")
        axes[0].set_ylabel("dT/dt [°C/min]")
        upper.colorbar(dots, ax=axes, label=f"{_spoken(channel.name)} [{unit}]")
        for axis, (name, values) in zip(np.atleast_1d(lower.subplots(1, len(beside), sharey=True)) if lower is not None else [], beside):
            for residual, colour in ((channel.before, BEFORE), (channel.after, AFTER)):
                axis.plot(*_thin(values, residual * factor, most=MOST_DOTS), ".", ms=3, color=colour, alpha=0.6)
            axis.set(xlabel=name, ylabel=f"[{unit}]")

    return _svg(draw, 8.6, 3.2 if not beside else 5.8, "gap over temperature and its speed")


def ambiguity(view: View) -> str:
    """How alike the named explanations look in this recording."""
    if view.alike is None:
        return ""
    names, matrix = view.alike.names, view.alike.matrix

    def draw(figure: Any) -> None:
        axis = figure.subplots()
        axis.imshow(np.abs(matrix), cmap="Oranges", vmin=0, vmax=1)
        axis.set_xticks(range(len(names)), names, rotation=20, ha="right")
        axis.set_yticks(range(len(names)), names)
        axis.grid(False)
        for i in range(len(names)):
            for j in range(len(names)):
                axis.text(j, i, f"{matrix[i, j]:+.2f}", ha="center", va="center", color="white" if abs(matrix[i, j]) > 0.6 else "black")

    return _svg(draw, 4.2 + 0.5 * len(names), 1.6 + 0.6 * len(names), "ambiguity matrix")


def spectrum(view: View) -> str:
    """Amplitude spectral density of the residuals of up to two channels, before and after."""
    from scipy.signal import welch

    rate_hz = (len(view.time_s) - 1) / float(view.time_s[-1] - view.time_s[0])
    shown = view.worst[:2]

    def draw(figure: Any) -> None:
        for axis, channel in zip(np.atleast_1d(figure.subplots(1, len(shown))), shown):
            for values, colour, name in ((channel.before, BEFORE, "before"), (channel.after, AFTER, "after")):
                filled = np.nan_to_num(values)
                frequency, density = welch(filled, rate_hz, nperseg=min(512, max(16, len(filled) // 4)), detrend="constant")
                axis.loglog(frequency[1:], np.sqrt(np.maximum(density[1:], 1e-300)), color=colour, label=name)
            axis.axhline(channel.floor * np.sqrt(2.0 / rate_hz), color=FLOOR, ls="--", label="floor, if white")
            axis.set(xlabel="frequency [Hz]", ylabel=f"density [{channel.unit}/√Hz]", title=_spoken(channel.name))
            axis.legend(fontsize=9)

    return _svg(draw, 8.6, 3.0, "spectrum of the gap")


def _unit(channel: Channel) -> tuple[float, str]:
    """A factor that brings the numbers near one, and the unit with its prefix."""
    size = float(np.nanmax(np.abs(channel.before), initial=0.0))
    factor, prefix = next(((f, p) for f, p in PREFIXES if size * f >= 0.2), PREFIXES[-1])
    if channel.unit in PREFIXED:
        return factor, prefix + channel.unit
    if channel.unit == "FS" and prefix:
        return factor, f"1/{factor:.0e} FS".replace("1/1e+03", "10⁻³").replace("1/1e+06", "10⁻⁶").replace("1/1e+09", "10⁻⁹")
    return 1.0, channel.unit


def _spoken(name: str) -> str:
    return name.replace("_", " ")


def _thin(*columns: np.ndarray, most: int = MOST_POINTS) -> list[np.ndarray]:
    """Every k-th point, so that the page stays small."""
    step = max(1, len(columns[0]) // most)
    return [column[::step] for column in columns]


def _stretches(mask: np.ndarray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(int), [0]))))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2])]

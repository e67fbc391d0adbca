"""Picture of the chamber sweep: rate and residual of each axis against temperature and time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from wineglass.atomic import atomic_path
from wineglass.calibration.branches import Branch, find_branches
from wineglass.chamber import AxisResult, Sweep, float64_bias

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")


def plot(sweep: Sweep, results: list[AxisResult], reference_degc: float, target: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    branches = find_branches(sweep.temperature_degc)
    figure, axes = plt.subplots(len(results), 3, figsize=(15, 4.2 * len(results)), layout="constrained", squeeze=False)
    for row, result in zip(axes, results):
        _rate_over_temperature(row[0], sweep, result, branches, reference_degc)
        _residual_over_temperature(row[1], sweep, result, branches)
        _residual_over_time(row[2], sweep, result, branches)
    axes[0][0].legend(fontsize=9)
    figure.suptitle("Gyro at rest in a climate chamber: static cubic subtracted by the firmware's fixed-point polynomial")
    with atomic_path(target) as part:
        figure.savefig(part, dpi=110, format="png")
    plt.close(figure)


def _label(branch: Branch, sweep: Sweep) -> str:
    start, stop = sweep.temperature_degc[branch.start], sweep.temperature_degc[branch.stop - 1]
    return f"{branch.kind} {start:.0f} to {stop:.0f} °C"


def _scatter(axes: Any, x: np.ndarray, y: np.ndarray, branches: list[Branch], labels: list[str] | None = None) -> None:
    for i, branch in enumerate(branches):
        axes.plot(x[branch.where], y[branch.where], ".", markersize=2, color=_COLOURS[i % len(_COLOURS)],
                  label=labels[i] if labels else None)
    axes.grid(alpha=0.3)


def _rate_over_temperature(axes: Any, sweep: Sweep, result: AxisResult, branches: list[Branch], reference_degc: float) -> None:
    rate = 1e3 * sweep.rate_rad_s[result.axis]
    _scatter(axes, sweep.temperature_degc, rate, branches, [_label(branch, sweep) for branch in branches])
    grid = np.linspace(sweep.temperature_degc.min(), sweep.temperature_degc.max(), 300)
    axes.plot(grid, 1e3 * float64_bias(result.coefficients, grid - reference_degc), "k-", linewidth=1.5, label="cubic")
    axes.set(title=f"{result.axis}: rate", xlabel="temperature [°C]", ylabel="rate [mrad/s]")


def _residual_over_temperature(axes: Any, sweep: Sweep, result: AxisResult, branches: list[Branch]) -> None:
    _scatter(axes, sweep.temperature_degc, 1e3 * result.residual_rad_s, branches)
    axes.set(title=f"{result.axis}: residual, {_split_text(result, 'in sample')}", xlabel="temperature [°C]", ylabel="residual [mrad/s]")


def _residual_over_time(axes: Any, sweep: Sweep, result: AxisResult, branches: list[Branch]) -> None:
    _scatter(axes, sweep.time_s / 60.0, 1e3 * result.residual_rad_s, branches)
    axes.axvline(sweep.time_s[int(np.argmax(sweep.temperature_degc))] / 60.0, color="k", linestyle="--", linewidth=1)
    held_out = _split_text(result, "after the maximum held out", False)
    axes.set(title=f"{result.axis}: residual\n(held out from the dashed line on: {held_out})", xlabel="time [min]",
             ylabel="residual [mrad/s]")


def _split_text(result: AxisResult, name: str, with_word: bool = True) -> str:
    value = next(split.firmware_rad_s for split in result.splits if split.name == name)
    return f"{1e3 * value:.2f} mrad/s rms" + (f" {name}" if with_word else "")

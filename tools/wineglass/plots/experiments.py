"""The paper's figures 2 and 5, drawn from runs with the firmware in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wineglass.plots.style import COLOURS, DEG_H_PER_RAD_S, LABELS, figure

if TYPE_CHECKING:
    from wineglass.experiments import Figure2, Figure5


LEAST_SHOWN_RAD_S = 1e-7


def draw_figure5(run: Figure5, path: Path) -> None:
    """Temperature, rate and residual of the fast swing; the residual on a logarithmic scale, as it spans four decades."""
    shown = run.evaluated
    time_s = run.time_s[shown]
    with figure(path, rows=3, height=9, ratios=[1, 1.4, 1.6]) as (drawing, (top, middle, bottom)):
        drawing.suptitle(f"Fast temperature swing under rate, device {run.device}, firmware in the loop")
        top.plot(time_s, run.shell_degc[shown], color=COLOURS["temperature"])
        top.set_ylabel("shell [°C]")
        middle.plot(time_s, run.true_rate_rad_s[shown], color=COLOURS["truth"], linestyle="--", label="input rate")
        for name, rate in run.rate_rad_s.items():
            middle.plot(time_s, rate[shown], color=COLOURS[name], linewidth=1.2, label=LABELS[name])
            residual = np.abs(rate[shown] - run.reference_rad_s[shown])
            bottom.semilogy(time_s, np.maximum(residual, LEAST_SHOWN_RAD_S), color=COLOURS[name], linewidth=0.8,
                            label=f"{name}: {run.residual[name].ac_rad_s:.2e} rad/s rms without mean")
        middle.set_ylabel("rate [rad/s]")
        middle.legend(loc="lower left", fontsize=9)
        bottom.set_ylabel("|residual| [rad/s]")
        bottom.set_ylim(bottom=LEAST_SHOWN_RAD_S)
        bottom.set_xlabel("time [s]")
        bottom.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, fontsize=9)


def draw_figure2(run: Figure2, path: Path) -> None:
    """Chamber profile and output at zero rate, with and without compensation."""
    shown = run.evaluated
    minutes = run.time_s[shown] / 60
    with figure(path, rows=2, height=7, ratios=[1, 1.8]) as (drawing, (top, bottom)):
        drawing.suptitle(f"Slow chamber profile at zero rate, device {run.device}, firmware in the loop")
        top.plot(minutes, run.chamber_degc[shown], color=COLOURS["truth"], linestyle="--", label="chamber")
        top.plot(minutes, run.shell_degc[shown], color=COLOURS["temperature"], label="shell")
        top.set_ylabel("temperature [°C]")
        top.legend(fontsize=9)
        bottom.plot(minutes, run.uncompensated_rad_s[shown] * DEG_H_PER_RAD_S, color=COLOURS["none"], linewidth=0.9, label="uncompensated")
        bottom.plot(minutes, run.compensated_rad_s[shown] * DEG_H_PER_RAD_S, color=COLOURS["g2"], linewidth=0.9, label="compensated (G2)")
        bottom.set_ylabel("output [°/h]")
        bottom.set_xlabel("time [min]")
        bottom.legend(fontsize=9)

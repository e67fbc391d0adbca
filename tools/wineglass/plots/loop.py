"""Bode plot of the rebalance loop, designed and measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wineglass.plots.style import COLOURS, figure

if TYPE_CHECKING:
    from wineglass.loop_design.rebalance import Rebalance
    from wineglass.loop_design.report import Designed, Measured

LOWEST_HZ = 0.5


def draw_loop(rebalance: Rebalance, designed: Designed, measured: Measured | None, path: Path) -> None:
    """Rate output and answer to the test force (closed loop) above, open loop below; magnitude and phase of each."""
    frequency = np.geomspace(LOWEST_HZ, rebalance.highest_hz, 600)
    with figure(path, rows=4, height=12, ratios=[1.2, 1, 1.2, 1]) as (drawing, axes):
        drawing.suptitle(f"Rebalance loop, device {rebalance.device.name}: lines designed, points measured on the twin")
        pairs = [("rate", "rate output over true rate", rebalance.rate_response(frequency), measured and (measured.rate.frequency_hz, measured.rate.gain)),
                 ("force", "loop's force over test force, sign changed", -rebalance.test_response(frequency),
                  measured and (measured.force.frequency_hz, -measured.force.gain))]
        for name, label, exact, points in pairs:
            _response(axes[:2], frequency, exact, points, COLOURS[name], label)
        _response(axes[2:], frequency, rebalance.loop.open_loop(frequency),
                  measured and (measured.force.frequency_hz, measured.open_loop), COLOURS["temperature"], "open loop, from the test force")
        _annotate(axes, designed)
        axes[0].set_xscale("log")
        axes[-1].set_xlabel("frequency [Hz]")


def _response(axes: Any, frequency: np.ndarray, exact: np.ndarray, points: Any, colour: str, label: str) -> None:
    axes[0].plot(frequency, _db(exact), color=colour, label=label)
    axes[1].plot(frequency, np.degrees(np.unwrap(np.angle(exact))), color=colour)
    if points is not None:
        axes[0].plot(points[0], _db(points[1]), "o", color=colour, markersize=5, fillstyle="none")
        axes[1].plot(points[0], np.degrees(np.unwrap(np.angle(points[1]))), "o", color=colour, markersize=5, fillstyle="none")


def _db(values: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(np.abs(values))


def _annotate(axes: Any, designed: Designed) -> None:
    margins = designed.margins
    for axis, label in zip(axes, ["closed loop [dB]", "closed loop [°]", "open loop [dB]", "open loop [°]"], strict=True):
        axis.set_ylabel(label)
    axes[0].set_ylim(-25, 5)
    axes[0].axhline(-3.01, color=COLOURS["truth"], linewidth=0.8)
    axes[0].axvline(designed.bandwidth_hz, color=COLOURS["truth"], linestyle="--", linewidth=0.8,
                    label=f"bandwidth {designed.bandwidth_hz:.0f} Hz, step overshoot {100 * designed.step.overshoot:.0f} %")
    axes[1].set_ylim(-270, 20)
    axes[2].axhline(0.0, color=COLOURS["truth"], linewidth=0.8)
    axes[3].axhline(-180.0, color=COLOURS["truth"], linewidth=0.8)
    for axis in axes[2:]:
        axis.axvline(margins.crossover_hz, color=COLOURS["truth"], linestyle="--", linewidth=0.8,
                     label=f"crossover {margins.crossover_hz:.0f} Hz: phase margin {margins.phase_margin_deg:.0f}°, gain margin {margins.gain_margin_db:.0f} dB")
    axes[0].legend(loc="lower left", fontsize=9)
    axes[2].legend(loc="lower left", fontsize=9)

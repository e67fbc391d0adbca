"""A designed loop in numbers, and the measured ones beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wineglass.loop_design.margins import Margins, Response as ResponseOf, Step, bandwidth_hz, margins, noise_bandwidth_hz, step
from wineglass.loop_design.measure import Response, StepResponse
from wineglass.loop_design.model import Gains, Loop, lag_samples
from wineglass.loop_design.rebalance import Rebalance
from wineglass.units import RAD_S_IN_DEG_H


@dataclass(frozen=True)
class Designed:
    """bandwidth_hz: 3 dB down; of the rate output for rebalance, of the closed loop for the others. From latency_s on: rebalance only,
    else nan. quadrature_part: of its limit that the force at rest takes"""

    gains: Gains
    loop_rate_hz: float
    delay_s: float
    margins: Margins
    bandwidth_hz: float
    noise_bandwidth_hz: float
    step: Step
    latency_s: float
    noise_rad_s: float
    range_rad_s: float
    quadrature_part: float


@dataclass(frozen=True)
class Measured:
    """rate and force: gains at frequencies; nan where nothing was found within the measured frequencies"""

    rate: Response
    force: Response
    open_loop: np.ndarray
    """at force.frequency_hz, complex (n,)"""
    bandwidth_hz: float
    crossover_hz: float
    phase_margin_deg: float
    overshoot: float
    noise_rad_s: float


def of_rebalance(rebalance: Rebalance, in_phase_limit_fs: float, quadrature_limit_fs: float) -> Designed:
    reach = rebalance.scale_rad_s * in_phase_limit_fs / rebalance.device.firmware.amplitude_fs
    return _designed(rebalance.loop, rebalance.rate_response, rebalance.highest_hz, rebalance.latency_s(), rebalance.noise_rad_s(), reach,
                     abs(rebalance.quadrature_at_rest_fs) / quadrature_limit_fs)


def of_drive(loop: Loop) -> Designed:
    return _designed(loop, loop.complementary, 0.5 * loop.schedule.loop_rate_hz)


def _designed(loop: Loop, response: ResponseOf, highest_hz: float, latency_s: float = math.nan, noise_rad_s: float = math.nan,
              range_rad_s: float = math.nan, quadrature_part: float = math.nan) -> Designed:
    delay_s = lag_samples(loop.schedule) / loop.schedule.sample_rate_hz
    return Designed(loop.gains, loop.schedule.loop_rate_hz, delay_s, margins(loop), bandwidth_hz(response, highest_hz),
                    noise_bandwidth_hz(response, highest_hz), step(loop), latency_s, noise_rad_s, range_rad_s, quadrature_part)


def of_measurement(rebalance: Rebalance, rate: Response, force: Response, stepped: StepResponse) -> Measured:
    """The open loop follows from the test force alone: force read out = -L/(1 + L), seen through the mean over a slow period."""
    closed = -force.gain / rebalance.mean(force.frequency_hz)
    open_loop = closed / (1.0 - closed)
    crossover = _falls_to(force.frequency_hz, np.abs(open_loop), 1.0)
    margin = 180.0 + math.degrees(np.interp(crossover, force.frequency_hz, np.unwrap(np.angle(open_loop)))) if crossover > 0 else math.nan
    return Measured(rate, force, open_loop, _bandwidth(rebalance, rate), crossover, margin, stepped.overshoot, stepped.noise_rad_s)


def _bandwidth(rebalance: Rebalance, rate: Response) -> float:
    """-3 dB of the measured rate; between the measured frequencies only its ratio to the designed response is interpolated."""
    ratio = np.abs(rate.gain / rebalance.rate_response(rate.frequency_hz))
    fine = np.linspace(rate.frequency_hz[0], rate.frequency_hz[-1], 2000)
    return _falls_to(fine, np.abs(rebalance.rate_response(fine)) * np.interp(fine, rate.frequency_hz, ratio), math.sqrt(0.5))


def _falls_to(frequency_hz: np.ndarray, size: np.ndarray, level: float) -> float:
    """Where |response| falls through a level; straight in logarithms between two frequencies."""
    below = np.flatnonzero(size < level)
    if len(below) == 0 or below[0] == 0:
        return math.nan
    pair = slice(below[0] - 1, below[0] + 1)
    return float(np.exp(np.interp(-math.log(level), -np.log(size[pair]), np.log(frequency_hz[pair]))))


def rows(designed: Designed, measured: Measured | None) -> list[tuple[str, str, str]]:
    """(what, designed, measured), with units."""
    m = designed.margins
    found = [
        ("proportional gain", f"{designed.gains.proportional:.6g}", ""),
        ("integral gain [1/s]", f"{designed.gains.integral_per_s:.6g}", ""),
        ("delay in the loop [us]", f"{1e6 * designed.delay_s:.0f}", ""),
        ("crossover [Hz]", f"{m.crossover_hz:.2f}", _text(measured and measured.crossover_hz, ".2f")),
        ("phase margin [deg]", f"{m.phase_margin_deg:.1f}", _text(measured and measured.phase_margin_deg, ".1f")),
        ("gain margin [dB]", f"{m.gain_margin_db:.1f}", ""),
        ("largest sensitivity", f"{m.sensitivity_peak:.2f}", ""),
        ("bandwidth, -3 dB [Hz]", f"{designed.bandwidth_hz:.1f}", _text(measured and measured.bandwidth_hz, ".1f")),
        ("noise bandwidth [Hz]", f"{designed.noise_bandwidth_hz:.1f}", ""),
        ("step overshoot [%]", f"{100 * designed.step.overshoot:.1f}", _text(measured and 100 * measured.overshoot, ".1f")),
        ("settling to 1 % [ms]", f"{1e3 * designed.step.settling_s:.1f}", ""),
    ]
    if not math.isnan(designed.noise_rad_s):
        deg_s = RAD_S_IN_DEG_H / 3600.0
        found += [
            ("latency of the rate [ms]", f"{1e3 * designed.latency_s:.2f}", ""),
            ("converter noise, no filter [deg/s rms]", f"{designed.noise_rad_s * deg_s:.3f}",
             _text(measured and measured.noise_rad_s * deg_s, ".3f")),
            ("range [deg/s]", f"{designed.range_rad_s * deg_s:.3g}", ""),
            ("quadrature force at rest, of its limit [%]", f"{100 * designed.quadrature_part:.0f}", ""),
        ]
    return found


def _text(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def bode_rows(rebalance: Rebalance, measured: Measured) -> list[tuple[str, ...]]:
    """Designed and measured gain and phase at every measured frequency, rate first, then test force."""
    columns = []
    for response, model in ((measured.rate, rebalance.rate_response), (measured.force, rebalance.test_response)):
        exact = model(response.frequency_hz)
        columns += [np.abs(exact), np.abs(response.gain), np.degrees(np.angle(exact)), np.degrees(np.angle(response.gain))]
    table = zip(measured.rate.frequency_hz, *columns, strict=True)
    return [(f"{row[0]:g}", *(f"{value:.4f}" if i % 4 < 2 else f"{value:.2f}" for i, value in enumerate(row[1:]))) for row in table]

"""What calibrate prints, and its machine-readable form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.polynomial import Polynomial

from wineglass.calibration.base import Base
from wineglass.calibration.identify import Identified
from wineglass.calibration.order import HeldOut, OrderChoice
from wineglass.console import Console
from wineglass.units import RAD_S_IN_DEG_H


def print_report(found: Identified, base: Base, loop: str, added: bool, console: Console) -> None:
    console.print(f"channel {found.channel}, {found.samples} samples, {found.temperature_min_degc:.4g} to "
                  f"{found.temperature_max_degc:.4g} degC, {loop} loop, base: {base.source}")
    for choice, title in ((found.scale_choice, "scale factor"), (found.choice, "bias")):
        if choice is not None:
            _print_choice(choice, f"Held-out thermal branches, {title}", found, console)
    _print_coefficients(found, console)
    _print_values(found, console)
    console.print(f"residual {_both(found.residual_rms, found)} rms in sample; intervals from {found.blocks} block means, "
                  f"{_noise_words(found)}")
    if found.delay_s is not None:
        console.print(f"the channel follows the temperature {1e3 * found.delay_s:.3g} ± {1e3 * found.delay_half_width_s:.2g} ms later than "
                      "its known lag; this was fitted beside the polynomial")
    if found.after_maximum is not None:
        console.print(f"everything from the temperature maximum on held out: {_both(found.after_maximum.rms_by_order[0], found)} rms")
    if added:
        console.print("the recording was compensated: the polynomial is added to the base's own")


def _both(value: float, found: Identified) -> str:
    if found.channel == "ratio":
        return f"{value:.4g} of the ratio"
    return f"{value:.4g} rad/s ({value * RAD_S_IN_DEG_H:.4g} deg/h)"


def _noise_words(found: Identified) -> str:
    if found.noise.white_weight[0] > 0.5:
        return "whose noise is white"
    return f"whose noise is correlated over about {found.noise.correlation_time_s[0]:.3g} s"


def _print_choice(choice: OrderChoice, title: str, found: Identified, console: Console) -> None:
    unit = "ratio" if found.channel == "ratio" else "rad/s"
    names = [f"{i + 1}: {_branch_words(branch)}" for i, branch in enumerate(choice.branches)]
    rows = [
        [order, f"{choice.in_sample_rms_by_order[order]:.4g}", f"{choice.rms_by_order[order]:.4g}",
         *(f"{branch.rms_by_order[order]:.4g}" for branch in choice.branches), _mark(order, choice)]
        for order in range(len(choice.rms_by_order))
    ]
    columns = ["order", "in sample", "held out", *(f"branch {i + 1}" for i in range(len(names))), ""]
    console.table(f"{title} (rms, {unit})", columns, rows)
    for name in names:
        console.print(f"  branch {name}")
    console.print("  chosen: the smallest order whose held-out mean square is within one standard error of the best one's "
                  "(paired differences, 16 stretches per branch)")


def _mark(order: int, choice: OrderChoice) -> str:
    marks = [word for word, at in (("chosen", choice.order), ("best", choice.best)) if at == order]
    return ", ".join(marks)


def _branch_words(branch: HeldOut) -> str:
    return (f"{branch.kind}, {branch.start_s:.6g} to {branch.stop_s:.6g} s, {branch.from_degc:.4g} to {branch.to_degc:.4g} degC, "
            f"{100 * branch.inside:.0f} % of it inside the others' temperatures")


def _print_coefficients(found: Identified, console: Console) -> None:
    rows = [
        [f"alpha{i}", f"rad/s/degC^{i}" if i else "rad/s", f"{value:.6g}", f"±{half:.2g}",
         f"{value * RAD_S_IN_DEG_H:.6g}", f"±{half * RAD_S_IN_DEG_H:.2g}"]
        for i, (value, half) in enumerate(zip(found.bias_rad_s, found.bias_half_width_rad_s))
    ]
    console.table(f"Bias polynomial in T - {found.reference_temperature_degc:g} degC, 95 % intervals",
                  ["", "unit", "value", "95 %", "deg/h/degC^i", "95 % "], rows)
    if found.scale is None:
        return
    unit = "rad/s" if found.scale_is_ratio else "1"
    name = "Scale factor, rate per ratio" if found.scale_is_ratio else "Correction of the scale factor"
    rows = [[f"s{i}", f"{unit}/degC^{i}" if i else unit, f"{value:.6g}", f"±{half:.2g}"]
            for i, (value, half) in enumerate(zip(found.scale, found.scale_half_width))]
    console.table(f"{name}, polynomial in T - {found.reference_temperature_degc:g} degC, 95 % intervals",
                  ["", "unit", "value", "95 %"], rows)


def _print_values(found: Identified, console: Console) -> None:
    law = Polynomial(found.bias_rad_s)
    at = sorted({found.temperature_min_degc, found.reference_temperature_degc, found.temperature_max_degc})
    at = [t for t in at if found.temperature_min_degc <= t <= found.temperature_max_degc]
    values = [float(law(t - found.reference_temperature_degc)) for t in at]
    console.table("Bias", ["temperature [degC]", "rad/s", "deg/h"],
                  [[f"{t:.4g}", f"{v:.6g}", f"{v * RAD_S_IN_DEG_H:.6g}"] for t, v in zip(at, values)])


def as_json(found: Identified, base: Base, loop: str, added: bool, output: Path | None) -> dict:
    return {
        "output": output,
        "base": base.source,
        "loop": loop,
        "added_to_base": added,
        "channel": found.channel,
        "reference_temperature_degc": found.reference_temperature_degc,
        "temperature_min_degc": found.temperature_min_degc,
        "temperature_max_degc": found.temperature_max_degc,
        "order": found.order,
        "bias": _terms(found.bias_rad_s, found.bias_half_width_rad_s, "rad/s"),
        "scale": None if found.scale is None else {
            "kind": "rate per ratio" if found.scale_is_ratio else "correction",
            "terms": _terms(found.scale, found.scale_half_width, "rad/s" if found.scale_is_ratio else "1"),
        },
        "delay": None if found.delay_s is None else {
            "unit": "s", "value": found.delay_s,
            "interval_95": [found.delay_s - found.delay_half_width_s, found.delay_s + found.delay_half_width_s],
        },
        "residual_rms": found.residual_rms,
        "residual_unit": "1" if found.channel == "ratio" else "rad/s",
        "samples": found.samples,
        "blocks": found.blocks,
        "noise": {"white_weight": found.noise.white_weight[0], "correlation_time_s": found.noise.correlation_time_s[0],
                  "degrees_of_freedom": found.noise.degrees_of_freedom},
        "order_choice": _choice(found.choice),
        "scale_order_choice": _choice(found.scale_choice),
        "after_temperature_maximum": None if found.after_maximum is None else
            {"held_out_rms": found.after_maximum.rms_by_order[0], "start_s": found.after_maximum.start_s},
    }


def _terms(values: np.ndarray, half_widths: np.ndarray, unit: str) -> list[dict]:
    return [
        {"power": i, "unit": f"{unit}/degC^{i}" if i else unit, "value": float(v), "interval_95": [float(v - h), float(v + h)]}
        for i, (v, h) in enumerate(zip(values, half_widths))
    ]


def _choice(choice: OrderChoice | None) -> dict | None:
    if choice is None:
        return None
    branches = [
        {"kind": b.kind, "start_s": b.start_s, "stop_s": b.stop_s, "from_degc": b.from_degc, "to_degc": b.to_degc,
         "inside_others_temperatures": b.inside, "held_out_rms_by_order": b.rms_by_order}
        for b in choice.branches
    ]
    return {
        "rule": "smallest order whose held-out mean square is within one standard error (paired) of the best",
        "chosen": choice.order, "best": choice.best,
        "held_out_rms_by_order": choice.rms_by_order, "in_sample_rms_by_order": choice.in_sample_rms_by_order,
        "excess_mean_square_by_order": choice.excess_by_order, "standard_error_by_order": choice.standard_error_by_order,
        "held_out_branches": branches,
    }

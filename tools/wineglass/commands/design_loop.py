"""wineglass design-loop DEVICE --bandwidth HZ [-o CAL.json]"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from wineglass.console import Console
from wineglass.errors import BadInput

if TYPE_CHECKING:
    from wineglass.calibration_block import Calibration
    from wineglass.device import Device
    from wineglass.loop_design.model import Gains
    from wineglass.loop_design.rebalance import Rebalance
    from wineglass.loop_design.report import Designed, Measured
    from wineglass.scenario import Run

HELP = "gains of a control loop for a bandwidth, its margins, and its Bode plot measured on the twin"

MODES = ("rebalance", "pll", "agc")
FIELDS = {"rebalance": "rebalance_bandwidth_hz", "pll": "pll_bandwidth_hz", "agc": "agc_bandwidth_hz"}

GOOD_PHASE_MARGIN_DEG, GOOD_OVERSHOOT, GOOD_QUADRATURE_PART = 60.0, 0.15, 0.75


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("device", metavar="DEVICE", help="shipped device or description (.toml)")
    parser.add_argument("--mode", choices=MODES, default="rebalance", help="which loop; pll and agc are designed, not measured")
    parser.add_argument("--bandwidth", type=float, metavar="HZ",
                        help="rebalance: where the rate output is 3 dB down; pll, agc: the description's field (default: as described)")
    parser.add_argument("--integral", type=float, metavar="PER_S", help="rebalance: zero of the controller (default: on the mode's pole)")
    parser.add_argument("--gains", type=float, nargs=2, metavar=("KP", "KI_PER_S"), help="rebalance: examine these gains instead")
    parser.add_argument("--no-measure", action="store_true", help="do not measure on the twin")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="Bode plot (default: out/design-loop/DEVICE.png; rebalance only)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of all noise in the measurement")
    parser.add_argument("-o", "--output", type=Path, metavar="CAL.json",
                        help="nominal calibration with these gains (.json: values with units, .bin: block for the firmware)")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass import device as devices

    _check_arguments(args)
    described = devices.load(args.device)
    if args.mode == "rebalance":
        _rebalance(described, args, console)
    else:
        _drive(described, args, console)
    return 0


def _check_arguments(args: argparse.Namespace) -> None:
    for name in ("bandwidth", "integral"):
        value = getattr(args, name)
        if value is not None and not 0.0 < value < float("inf"):
            raise BadInput(f"{value:g} is not possible", f"--{name}", "give a positive number")
    if args.mode != "rebalance" and (args.integral is not None or args.gains is not None):
        raise BadInput(f"mode {args.mode} has neither", "--integral, --gains", "leave them out")
    if args.gains is not None and (args.bandwidth is not None or args.integral is not None):
        raise BadInput("gains are designed or given, not both", "--gains", "leave out --bandwidth and --integral")
    if args.output is not None and args.output.suffix not in (".json", ".bin"):
        raise BadInput("unknown kind of file", args.output, "end the name in .json (values with units) or .bin (block for the firmware)")
    if args.plot is not None and args.plot.suffix != ".png":
        raise BadInput("unknown kind of picture", args.plot, "end the name in .png")
    for name in ("output", "plot"):
        path = getattr(args, name)
        if path is not None and not path.parent.is_dir():
            raise BadInput("the folder does not exist", path.parent, "create it or choose another path")


def _rebalance(device: Device, args: argparse.Namespace, console: Console) -> None:
    from wineglass.loop_design import rebalance, report
    from wineglass.plots.loop import draw_loop

    with console.progress("designing") as bar:
        gains = _gains(device, args)
        model = rebalance.model(device, gains)
        bar.advance()
    bench, calibration = _calibration(device, loop="rebalance", rebalance_kp=gains.proportional, rebalance_ki_per_s=gains.integral_per_s)
    designed = report.of_rebalance(model, calibration.rebalance_in_phase_limit_fs, calibration.rebalance_quadrature_limit_fs)
    for warning in _doubts(designed):
        console.warn(warning)
    measured = None if args.no_measure else _measure(bench, calibration, model, args.seed, console)
    console.table(f"Rebalance loop of device {device.name}, {designed.loop_rate_hz:g} ticks a second",
                  ["", "designed", "measured"], report.rows(designed, measured))
    if measured is not None:
        console.table("Bode: rate output over true rate, and the loop's force over the test force",
                      ["Hz", "rate", "measured", "deg", "measured", "force", "measured", "deg", "measured"], report.bode_rows(model, measured))
    plot = args.plot or Path("out/design-loop") / f"{device.name}.png"
    plot.parent.mkdir(parents=True, exist_ok=True)
    draw_loop(model, designed, measured, plot)
    console.print(f"plot: {plot}")
    _finish(calibration, args, console, {"device": device.name, "mode": args.mode, "designed": designed, "measured": _json(measured), "plot": plot})


def _doubts(designed: Designed) -> list[str]:
    """What is allowed, but not what a gyro should be delivered with."""
    found = []
    if designed.margins.phase_margin_deg < GOOD_PHASE_MARGIN_DEG:
        found.append(f"the phase margin is below {GOOD_PHASE_MARGIN_DEG:g} deg")
    if designed.step.overshoot > GOOD_OVERSHOOT:
        found.append(f"a step overshoots by more than {100 * GOOD_OVERSHOOT:g} %")
    if designed.quadrature_part > GOOD_QUADRATURE_PART:
        found.append(f"quadrature takes {100 * designed.quadrature_part:.0f} % of its force at rest: the device needs more rebalance force "
                     "(electronics.dac.rebalance_reach) or a smaller split")
    return found


def _gains(device: Device, args: argparse.Namespace) -> Gains:
    from wineglass.loop_design import model, rebalance

    if args.gains is not None:
        gains = model.Gains(*args.gains)
    elif args.bandwidth is not None:
        return rebalance.design(device, args.bandwidth, args.integral)
    else:
        speed = 2.0 * math.pi * device.firmware.rebalance_bandwidth_hz
        gains = rebalance.gains_of_speed(device, speed, args.integral)
    rebalance.check(device, gains)
    return gains


def _drive(device: Device, args: argparse.Namespace, console: Console) -> None:
    from wineglass.loop_design import drive, report

    if args.bandwidth is not None:
        device = device.override({f"firmware.{FIELDS[args.mode]}": args.bandwidth}, "--bandwidth")
    loop = drive.pll(device) if args.mode == "pll" else drive.agc(device)
    drive.check(loop, f"device {device.name}, {args.mode} of {getattr(device.firmware, FIELDS[args.mode]):g} Hz")
    designed = report.of_drive(loop)
    console.table(f"{args.mode.upper()} of device {device.name}, {designed.loop_rate_hz:g} ticks a second", ["", "designed"],
                  [row[:2] for row in report.rows(designed, None)])
    _, calibration = _calibration(device)
    _finish(calibration, args, console, {"device": device.name, "mode": args.mode, "designed": designed})


def _calibration(device: Device, **changes: object) -> tuple[Run, Calibration]:
    """Nominal, unfiltered so that the rate output has the loop's own bandwidth."""
    from wineglass import nominal, scenario

    silent = {"baseband_hz": 0.0, "output_hz": 0.0, "reference_hz": 0.0}
    mode = {"compensation": "static", "output_filter_hz": 0.0}
    temperature = {"value_degc": device.resonator.reference_temperature_degc}
    data = {"name": "loop design", "recording": silent, "mode": mode, "temperature": temperature}
    bench = scenario.prepare(scenario.parse(data, "loop design"), device)
    return bench, nominal.calibration(bench).with_changes(**changes)


def _measure(bench: Run, calibration: Calibration, model: Rebalance, seed: int, console: Console) -> Measured:
    from wineglass.loop_design import measure, report

    highest = 0.4 * bench.device.slow_rate_hz
    frequencies = tuple(f for f in measure.FREQUENCIES_HZ if f < highest)
    with console.progress("measuring on the twin") as bar:
        rate = measure.rate_response(bench, calibration, frequencies, bar.advance, seed)
        force = measure.test_force_response(bench, calibration, frequencies, bar.advance, seed)
        stepped = measure.step_response(bench, calibration, bar.advance, seed)
    return report.of_measurement(model, rate, force, stepped)


def _json(measured: Measured | None) -> object:
    """Complex gains as magnitude and phase."""
    import numpy as np

    if measured is None:
        return None
    values = {name: getattr(measured, name) for name in ("bandwidth_hz", "crossover_hz", "phase_margin_deg", "overshoot", "noise_rad_s")}
    for name in ("rate", "force"):
        response = getattr(measured, name)
        values[name] = {"frequency_hz": response.frequency_hz, "gain": np.abs(response.gain), "phase_deg": np.degrees(np.angle(response.gain)),
                        "noise": response.noise}
    return values


def _finish(calibration: Calibration, args: argparse.Namespace, console: Console, result: dict[str, object]) -> None:
    from wineglass.calibration.base import write

    if args.output is not None:
        write(calibration, args.output)
        console.print(f"written: {args.output}")
    console.json(result | {"calibration": args.output})

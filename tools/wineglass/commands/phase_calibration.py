"""`wineglass phase-calibration DEVICE --temperatures=-40,25,85 -o out.json`"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from wineglass.console import Console

HELP = "let the firmware find its drive and demodulation phases at several temperatures and put them into the calibration"
SETTLE_REBALANCED_S, SETTLE_TAUS = 1.0, 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("device", metavar="DEVICE", help="a shipped device, or the path of a .toml file")
    parser.add_argument("--temperatures", default="25", metavar="DEGC,...", help="shell temperatures; write --temperatures=-40,25,85")
    parser.add_argument("--calibration", default="nominal", metavar="FILE", help="calibration to correct (.json, .bin); default: the nominal one")
    parser.add_argument("--order", type=int, default=1, metavar="N", help="of the polynomials, 0 to 5; never more than the temperatures allow")
    parser.add_argument("--drive-only", action="store_true", help="leave the demodulation phase alone, which counts open loop only")
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="KEY=VALUE",
                        help="how the simulated device differs from its description, e.g. electronics.dac.latency_samples=2")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of all noise")
    parser.add_argument("-o", "--output", type=Path, metavar="CAL.json", help="corrected calibration to write (.json or .bin)")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass import atomic, phases
    from wineglass.calibration_block import to_binary, to_json
    from wineglass.errors import BadInput

    if not 0 <= args.order <= 5:
        raise BadInput(f"there is no polynomial of order {args.order}", "--order", "give 0 to 5")
    if args.output is not None and args.output.suffix not in (".json", ".bin"):
        raise BadInput("unknown kind of calibration file", args.output, "end the name in .json or .bin")
    temperatures = _temperatures(args.temperatures)
    found = []
    with console.progress("calibrating phases", total=len(temperatures)) as bar:
        for degc in temperatures:
            calibration, result = _measure(args, degc)
            found.append(result)
            bar.advance(1)
    _show(console, temperatures, found)
    corrected = phases.with_phases(calibration, found, args.order)
    if args.output is not None:
        data = to_binary(corrected) if args.output.suffix == ".bin" else to_json(corrected).encode()
        atomic.write_bytes(args.output, data)
        console.print(f"{args.output}: sequence {corrected.sequence}")
    console.json({"temperatures_degc": temperatures, "results": found, "drive_phase_rad": corrected.drive_phase_rad,
                  "demodulation_phase_rad": corrected.demodulation_phase_rad, "output": args.output})
    return 0


def _temperatures(text: str) -> list[float]:
    from wineglass.errors import BadInput

    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise BadInput(f"{text!r} is no list of temperatures", "--temperatures", "write numbers in degC with commas between") from None


def _measure(args: argparse.Namespace, degc: float) -> tuple[Any, Any]:
    """The calibration that is corrected, and what the firmware finds at one temperature."""
    from wineglass import device as devices
    from wineglass import phases, scenario, toml_text
    from wineglass.calibration_block import from_binary
    from wineglass.phases_order import duration_s, order_for
    from wineglass.twin import Twin

    device = devices.load(args.device)
    settings = dict(toml_text.assignment(text) for text in args.settings)
    order = order_for(device)
    order = order_for(device, demodulation=order.demodulation and not args.drive_only)
    run = scenario.prepare(scenario.parse({
        "name": "phase-calibration", "device": args.device, "duration_s": duration_s(order) + 600.0, "seed": args.seed,
        "temperature": {"acts_on": "shell", "value_degc": degc}, "mode": {"loop": "rebalance"}, "calibration": args.calibration,
        "plant": {"override": settings},
    }, "phase calibration"), device)
    with Twin(run) as twin:
        twin.step(round(run.device.slow_rate_hz * _warm_up_s(run)))
        return from_binary(twin.calibration_block), phases.calibrate(twin, order)


def _warm_up_s(run: Any) -> float:
    """From cold to the set-point: full force has drive_reach times what the amplitude needs; then the loops settle."""
    import math

    device = run.device
    tau_s = 1.0 / float(device.resonator.decay_rate_at(run.initial_degc))
    reach = device.electronics.dac.drive_reach
    return tau_s * math.log(reach / (reach - 1.0)) * 1.3 + 6.0 / device.firmware.agc_bandwidth_hz + SETTLE_REBALANCED_S


def _show(console: Console, temperatures: list[float], found: list[Any]) -> None:
    console.table("Phases, mrad", ["temperature [degC]", "outcome", "drive", "+-", "correction", "demodulation", "+-", "correction"], [
        [f"{degc:g}", result.outcome.name.lower(), *(f"{1e3 * value:.4f}" for part in (result.drive, result.demodulation)
                                                    for value in (part.phase_rad, part.uncertainty_rad, part.correction_rad))]
        for degc, result in zip(temperatures, found, strict=True)])

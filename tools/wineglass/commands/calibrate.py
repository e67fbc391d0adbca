"""wineglass calibrate REC.h5 -o CAL.json"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from wineglass.console import Console
from wineglass.errors import BadInput

if TYPE_CHECKING:
    from wineglass.calibration.base import Base
    from wineglass.calibration.identify import Identified, Settings
    from wineglass.recording import Recording

HELP = "identify bias and scale factor over temperature, and write the calibration"
NEEDS_BUILD = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="REC.h5")
    parser.add_argument("-o", "--output", type=Path, metavar="CAL.json",
                        help="calibration to write (.json: values with units, .bin: block for the firmware)")
    parser.add_argument("--order", default="auto", metavar="auto|N",
                        help="order of the bias polynomial; auto chooses it by held-out thermal branches")
    parser.add_argument("--scale-order", default="auto", metavar="auto|N", help="the same for the scale factor, where a true rate moves")
    parser.add_argument("--max-order", type=int, default=5, metavar="N", help="highest order to try")
    parser.add_argument("--channel", choices=["rate_uncompensated", "rate", "ratio"],
                        help="what to fit; ratio: secondary over primary in phase, from the baseband (default: by what is recorded)")
    parser.add_argument("--loop", choices=["open", "closed"], help="open: the rate lags by the decay time (default: as the recording shows)")
    parser.add_argument("--min-span", type=float, default=10.0, metavar="DEGC", help="refuse smaller temperature spans")
    parser.add_argument("--reference-temperature", type=float, metavar="DEGC", help="temperature the polynomials count from")
    parser.add_argument("--device", metavar="DEVICE", help="shipped device or description (.toml) the recording belongs to")
    parser.add_argument("--base", type=Path, metavar="CAL.json", help="calibration from which all other fields are taken")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.calibration.base import calibrated, find_base, write
    from wineglass.calibration.report import as_json, print_report
    from wineglass.recording import Recording

    if args.output is not None and args.output.suffix not in (".json", ".bin"):
        raise BadInput("unknown kind of file", args.output, "end the name in .json (values with units) or .bin (block for the firmware)")
    with Recording.open(args.recording) as recording:
        base = find_base(recording, args.base, args.device)
        found, loop = _identify(recording, base, args, console)
        add = found.channel == "rate" and base.described and base.calibration.compensation != "none"
    calibration = calibrated(base, found, add)
    if args.output is not None:
        write(calibration, args.output)
    console.json(as_json(found, base, loop, add, args.output))
    print_report(found, base, loop, add, console)
    console.print(f"written: {args.output}" if args.output else "nothing written: give -o CAL.json to write the calibration")
    if not base.described:
        console.warn(f"no device is described; fields other than the polynomials are those of {base.source}")
    return 0


def _identify(recording: Recording, base: Base, args: argparse.Namespace, console: Console) -> tuple[Identified, str]:
    from wineglass.calibration.identify import identify
    from wineglass.calibration.observations import observe

    loop = args.loop or _loop_of(recording, base)
    settings = _settings(args, base, loop)
    data = observe(recording, args.channel)
    with console.progress("identifying") as bar:
        return identify(data, settings, bar.advance), loop


def _settings(args: argparse.Namespace, base: Base, loop: str) -> Settings:
    from wineglass.calibration.identify import Settings

    reference = args.reference_temperature
    lagging = loop == "open"
    return Settings(
        reference_temperature_degc=base.reference_temperature_degc if reference is None else reference,
        order=_order(args.order, "--order"),
        scale_order=_order(args.scale_order, "--scale-order"),
        max_order=args.max_order,
        min_span_degc=args.min_span,
        tau_s=base.tau_s if lagging else None,
        gain=base.gain if lagging else None,
        delay_s=base.delay_s if base.described else 0.0,
    )


def _order(text: str, flag: str) -> int | None:
    if text == "auto":
        return None
    if not text.isdecimal():
        raise BadInput(f"{text!r} is no order", flag, "give auto or a number from 0 to 5")
    return int(text)


def _loop_of(recording: Recording, base: Base) -> str:
    """Open when a device is described and its rebalance force is at rest."""
    if not base.described:
        return "closed"
    if "baseband" in recording and "rebalance_in_phase" in recording.tap("baseband"):
        import numpy as np

        force = recording.tap("baseband")["rebalance_in_phase"]
        return "closed" if np.nanmax(np.abs(force), initial=0.0) > 0 else "open"
    return "open"

"""wineglass chamber FILE.csv"""

from __future__ import annotations

import argparse
from pathlib import Path

from wineglass.console import Console
from wineglass.errors import BadInput

HELP = "compensate a measured chamber sweep through the firmware's polynomial and print what is left"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="table with the columns t_s, temperature_degC, gyro_a, gyro_b")
    parser.add_argument("--rate-unit", default="rad/s", metavar="UNIT", help="unit of the gyro columns, which the file does not say")
    parser.add_argument("--reference-temperature", type=float, default=25.0, metavar="DEGC", help="temperature the polynomial counts from")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="picture to draw")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.chamber import analyse, read_sweep
    from wineglass.units import RAD_S_IN_DEG_H

    if args.plot is not None and args.plot.suffix != ".png":
        raise BadInput("unknown kind of picture", args.plot, "end the name in .png")
    sweep = read_sweep(args.file, args.rate_unit)
    results = analyse(sweep, args.reference_temperature)
    if args.plot is not None:
        from wineglass.chamber_plot import plot

        plot(sweep, results, args.reference_temperature, args.plot)
    console.json({
        "file": args.file, "rows": len(sweep.time_s), "rate_unit": args.rate_unit, "plot": args.plot,
        "reference_temperature_degc": args.reference_temperature,
        "axes": [{"axis": r.axis, "coefficients_rad_s": r.coefficients, "raw_rms_rad_s": r.raw_rms_rad_s,
                  "residuals": r.splits} for r in results],
    })
    console.print(f"{args.file}: {len(sweep.time_s)} rows, {sweep.temperature_degc.min():.4g} to {sweep.temperature_degc.max():.4g} degC, "
                  f"{(sweep.time_s[-1] - sweep.time_s[0]) / 60:.4g} min; rates taken as {args.rate_unit}")
    console.table("Residual of a static cubic, rms", ["axis", "split", "float64 [rad/s]", "firmware [rad/s]", "[deg/h]", "difference"], [
        [result.axis, split.name, f"{split.float64_rad_s:.4g}", f"{split.firmware_rad_s:.4g}",
         f"{split.firmware_rad_s * RAD_S_IN_DEG_H:.4g}", f"{split.firmware_rad_s / split.float64_rad_s - 1:+.1e}"]
        for result in results for split in result.splits
    ])
    if args.plot is not None:
        console.print(f"picture: {args.plot}")
    return 0

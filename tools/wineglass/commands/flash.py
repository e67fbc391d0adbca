"""`wineglass flash`: builds the image for the board and writes it, with verification."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from wineglass.console import Console

HELP = "build the image for an STM32F405 board and write it through openocd (ST-Link) or stm32flash (serial loader), with verification"
NEEDS_BUILD = False

RATES = (50000, 48000, 96000)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rate", type=int, choices=RATES, default=RATES[0], help="sample rate of the codec, Hz")
    parser.add_argument("--bringup", action="store_true", help="the image that uses the internal 12-bit converters, at 50000 Hz: for a first try, not to measure")
    parser.add_argument("--image", type=Path, metavar="FILE.bin", help="write this image instead of the built one")
    parser.add_argument("--tool", choices=("openocd", "stm32flash"), help="default: stm32flash with --port, else openocd")
    parser.add_argument("--port", metavar="DEVICE", help="serial port of the board's ROM loader, for stm32flash")
    parser.add_argument("--no-build", action="store_true", help="take the image that was built last")
    parser.add_argument("--dry-run", action="store_true", help="check everything, print the command, touch no board")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass import flash
    from wineglass.errors import BadInput

    if args.bringup and args.rate != RATES[0]:
        raise BadInput("the internal converters have 50000 Hz", f"--bringup with --rate {args.rate}", "leave one of the two out")
    tool = flash.choose(args.tool, args.port)
    image = _image(args, console)
    length = flash.check(image)
    words = flash.command(tool, image, length, args.port)
    console.print(f"{image}: {length} of {flash.PROGRAM_BYTES} bytes, sealed")
    console.print(shlex.join(words))
    console.json({"image": str(image), "bytes": length, "tool": tool, "command": words, "written": not args.dry_run})
    if not args.dry_run:
        flash.require(tool)
        flash.run(words)
        console.print("written and verified; the calibration in the board is as it was")
    return 0


def _image(args: argparse.Namespace, console: Console) -> Path:
    if args.image is not None:
        return args.image
    from wineglass.emulation.machines import STM32F405

    if not args.no_build:
        with console.progress("building the image"):
            STM32F405.build(emulated=False)
    name = "wineglass_stm32f405" + ("_bringup" if args.bringup else "" if args.rate == RATES[0] else f"_{args.rate}")
    return STM32F405.program(f"{name}.bin")

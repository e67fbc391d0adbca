"""`wineglass prove`: what runs on the target is what was simulated."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from wineglass.console import Console

if TYPE_CHECKING:
    from wineglass.emulation.machines import Machine
    from wineglass.emulation.proof import Proof

HELP = "build the firmware's images, boot them in emulation, record from them over a socket, and show that the recordings equal the host's"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, default=Path("out/prove"), metavar="FOLDER", help="for the recordings (default: out/prove)")
    parser.add_argument("--seconds", type=float, default=2.0, metavar="S", help="of the simulated cold start (default: 2)")
    parser.add_argument("--m7", action="store_true", help="also on the emulated Cortex-M7")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.emulation import proof
    from wineglass.emulation.machines import BOARDS, STM32F405
    from wineglass.errors import BadInput

    if not 0.2 <= args.seconds <= 600:
        raise BadInput("0.2 to 600 s can be run", "--seconds", "give another time")
    processors = BOARDS if args.m7 else BOARDS[:1]
    _require(*processors, STM32F405)
    try:
        args.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"the folder cannot be made ({error.strerror})", args.output, "choose another one") from None
    proofs = []
    for machine in processors:
        _build(machine, console)
        with console.progress(f"{machine.what}: recording in lock step", total=1.0) as bar:
            proofs.append(proof.lock_step(machine, args.seconds, args.output, bar.update))
        _tell(proofs[-1], console)
    _build(STM32F405, console)
    with console.progress("STM32F405: recording its image", total=1.0) as bar:
        proofs.append(proof.board(STM32F405.program("wineglass_stm32f405.elf"), args.output, bar.update))
    _tell(proofs[-1], console)
    failed = [item for item in proofs if item.difference]
    console.json({"equal": not failed, "proofs": proofs})
    console.print("the target does something else than the host" if failed else "the target does what the host does, to the last bit")
    return 1 if failed else 0


def _require(*machines: Machine) -> None:
    """One line that says what to install, before anything is built."""
    from wineglass.errors import BadInput
    from wineglass.launch import system_packages

    missing = list(dict.fromkeys(tool for machine in machines for tool in machine.missing()))
    if missing:
        packages = list(dict.fromkeys(package for machine in machines for package in machine.packages))
        raise BadInput(f"{' and '.join(missing)} not installed", "prove", f"run: {system_packages.install_line(packages)}")


def _build(machine: Machine, console: Console) -> None:
    with console.progress(f"{machine.what}: building its image"):
        machine.build()
    console.print(f"{machine.what}: built by the preset {machine.preset}")


def _tell(found: Proof, console: Console) -> None:
    console.print(f"{found.what}: recorded to {found.recording}")
    if found.difference:
        console.print(f"  DIFFERENT at {found.difference}")
    else:
        console.print("  equal: " + ", ".join(f"{count} {what}" for what, count in found.compared.items()))

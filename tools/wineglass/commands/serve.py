"""`wineglass serve SCENARIO --socket PATH|--tcp PORT`: a simulated device to record from and to command."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from wineglass.console import Console

HELP = "run a scenario in real time as a device behind a socket, for `record` and `device` without hardware"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", nargs="?", metavar="SCENARIO", help="a shipped scenario, or the path of a .toml file")
    parser.add_argument("--protocol", metavar="NAME", help="chamber and rate table of a bench protocol instead; its commands come from `record --script`")
    parser.add_argument("--loop", choices=("open", "rebalance"), help="of the protocol")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--socket", type=Path, metavar="PATH", help="unix socket to make")
    where.add_argument("--tcp", metavar="PORT", help="TCP port, of this machine only; HOST:PORT for another address, 0: a free one")
    parser.add_argument("--speed", type=float, default=1.0, metavar="X", help="simulated over real time; 0: as fast as it goes")
    parser.add_argument("--byte-errors", type=float, default=0.0, metavar="P", help="probability that a byte from the device is damaged or lost")
    parser.add_argument("--device", metavar="DEVICE", help="instead of the scenario's: a shipped device, or the path of a .toml file")
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="KEY=VALUE", help="change a field of scenario or device")
    parser.add_argument("--seed", type=int, metavar="N", help="of all noise")
    parser.add_argument("--duration", type=float, metavar="SECONDS", help="simulated time")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.commands.simulate import prepare
    from wineglass.errors import BadInput
    from wineglass.link import serve as link

    if not (args.speed >= 0.0 and 0.0 <= args.byte_errors < 1.0):
        raise BadInput("a speed is at least 0, a probability within 0 to 1", "--speed, --byte-errors", "choose other values")
    prepared = prepare(args)
    listening: AbstractContextManager[Any] = link.listen_unix(args.socket) if args.socket else link.listen_tcp(args.tcp)
    with listening as listener:
        name = str(args.socket) if args.socket else "tcp://{}:{}".format(*listener.getsockname()[:2])
        console.print(f"{prepared.scenario.name or 'scenario'} on {prepared.device.name}: waiting at {name}; "
                      f"./wineglass record --port {name} -o run.h5")
        with console.progress("serving", total=prepared.n_blocks) as bar:
            done = link.serve(prepared, listener, args.speed, args.byte_errors, bar.advance)
    console.print(f"{done.simulated_s:g} s simulated, {done.clients} clients, {done.bytes_sent} bytes sent")
    console.json(done)
    return 0

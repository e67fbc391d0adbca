"""`wineglass simulate SCENARIO -o run.h5`, or `--protocol NAME` instead of a scenario"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from wineglass.console import Console

HELP = "run a scenario or a bench protocol through the digital twin, firmware in the loop, and write a recording"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", nargs="?", metavar="SCENARIO", help="a shipped scenario, or the path of a .toml file; none: list them")
    parser.add_argument("-o", "--output", type=Path, metavar="REC.h5", help="recording to write")
    parser.add_argument("--protocol", metavar="NAME", help="a bench protocol instead of a scenario, in times and sizes that follow the device")
    parser.add_argument("--loop", choices=("open", "rebalance"), help="of the protocol: open loop (default) or force-to-rebalance")
    parser.add_argument("--effect", dest="effects", action="append", default=[], metavar="ID[:PARAM=VALUE,...]",
                        help="what the true device has beside its description; ID alone: of typical size, ID:x2: twice that")
    parser.add_argument("--device", metavar="DEVICE", help="instead of the scenario's: a shipped device, or the path of a .toml file")
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="KEY=VALUE",
                        help="change a field of the scenario or of the device, e.g. rate.value_deg_s=5 or resonator.split_hz=0.005")
    parser.add_argument("--seed", type=int, metavar="N", help="of all noise")
    parser.add_argument("--duration", type=float, metavar="SECONDS", help="simulated time")


def run(args: argparse.Namespace, console: Console) -> int:
    if args.scenario is None and args.protocol is None:
        return _list(console)
    from wineglass import effects
    from wineglass.errors import BadInput
    from wineglass.simulation import simulate

    prepared = prepare(args)
    chosen = [effects.parse(text) for text in args.effects]
    if args.output is None:
        raise BadInput("no output file", "simulate", "add -o REC.h5")
    what = f"{prepared.scenario.name or 'scenario'} on {prepared.device.name}"
    with console.progress(f"simulating {what}", total=prepared.n_blocks) as bar:
        done = simulate(prepared, args.output, lambda blocks: bar.advance(blocks), effects=chosen)
    console.print(f"{args.output}: {what}, {done.simulated_s:g} s simulated in {done.elapsed_s:.1f} s "
                  f"({done.samples_per_s / 1e6:.0f} million samples/s), seed {done.seed}")
    for warning in done.warnings:
        console.warn(warning)
    console.json(done)
    if done.interrupted:
        raise KeyboardInterrupt
    return 0


def prepare(args: argparse.Namespace) -> Any:
    from wineglass import device as devices
    from wineglass import scenario as scenarios
    from wineglass.errors import BadInput

    for_scenario, for_device = scenarios.split_settings(args.settings)
    if args.protocol is not None:
        return _protocol(args, for_scenario, for_device)
    if args.scenario is None:
        raise BadInput("neither a scenario nor a protocol is given", "command line", "name one; ./wineglass simulate lists the scenarios")
    if args.loop is not None:
        raise BadInput("--loop belongs to --protocol", "command line", "use --set mode.loop=... for a scenario")
    given = {"seed": args.seed, "duration_s": args.duration, "device": args.device}
    for_scenario |= {key: value for key, value in given.items() if value is not None}
    scenario = scenarios.load(args.scenario).changed(for_scenario, "command line")
    device = devices.load(scenario.device).override(scenario.override, f"scenario {scenario.name}, override")
    return scenarios.prepare(scenario.changed({"override": {}}), device.override(for_device, "command line"))


def _protocol(args: argparse.Namespace, for_scenario: dict[str, Any], for_device: dict[str, Any]) -> Any:
    """Times and sizes follow the device as it is after --set."""
    from wineglass import device as devices
    from wineglass import protocols
    from wineglass import scenario as scenarios
    from wineglass.errors import BadInput

    if args.scenario is not None:
        raise BadInput("a scenario and a protocol are given", "command line", "give one of them")
    device = devices.load(args.device or protocols.DEVICE).override(for_device, "command line")
    scenario = protocols.scenario(args.protocol, device, args.loop or "open", 1 if args.seed is None else args.seed)
    if args.duration is not None:
        scenario = protocols.cut(scenario, args.duration)
    return scenarios.prepare(scenario.changed(for_scenario, "command line"), device)


def _list(console: Console) -> int:
    from wineglass import scenario as scenarios

    shipped = [scenarios.load(name) for name in scenarios.names()]
    console.table("Scenarios", ["name", "device", "duration [s]", "description"],
                  [(item.name, item.device, f"{item.duration_s:g}", item.description) for item in shipped])
    console.print("Bench protocols, for --protocol: ./wineglass protocol")
    console.json([{"name": item.name, "device": item.device, "duration_s": item.duration_s, "description": item.description}
                  for item in shipped])
    return 0

"""`wineglass protocol NAME`: the bench day for a person; `--script` for the device, `--scenario` for the twin."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from wineglass.console import Console

HELP = "print a bench protocol as a day's plan for a device, and write its command script or its scenario"
NEEDS_BUILD = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", metavar="NAME", help="a shipped protocol, or the path of a .toml file; none: list them")
    parser.add_argument("--device", default="metal", metavar="DEVICE", help="a shipped device, or the path of a .toml file (default: metal)")
    parser.add_argument("--loop", choices=("open", "rebalance"), default="open", help="open loop or force-to-rebalance (default: open)")
    parser.add_argument("--start", default="0:00", metavar="H:MM", help="time of day at which the recording starts")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of all noise, for --scenario")
    parser.add_argument("--script", type=Path, metavar="FILE.toml", help="write the device's commands with their times, for `record --script`")
    parser.add_argument("--profile", type=Path, metavar="FILE.csv", help="write what chamber and rate table play: time, temperature, rate")
    parser.add_argument("--scenario", type=Path, metavar="FILE.toml", help="write the scenario, for `simulate` and both twins")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass import device as devices
    from wineglass import protocols

    if args.name is None:
        return _list(console)
    start_s = _start(args.start)
    protocol, device = protocols.load(args.name), devices.load(args.device)
    scenario = protocols.scenario(protocol, args.device, args.loop, args.seed)
    parts = protocols.placed(protocol, device)
    _show(console, protocol, device, args, parts, start_s)
    written = _write(args, scenario)
    for kind, path in written.items():
        console.print(f"{kind}: {path}")
    console.json({"protocol": protocol.name, "device": device.name, "loop": args.loop, "duration_s": scenario.duration_s,
                  "unit_s": protocols.unit_s(device), "segments": scenario.segment, "commands": scenario.command,
                  "bursts": scenario.recording.bursts, "files": written})
    return 0


def _list(console: Console) -> int:
    from wineglass import device as devices
    from wineglass import protocols

    shipped = [protocols.load(name) for name in protocols.names()]
    metal, fast = devices.load("metal"), devices.load("metal-fast")
    rows = [(item, protocols.placed(item, metal)[-1].end_s, protocols.placed(item, fast)[-1].end_s) for item in shipped]
    console.table("Bench protocols", ["name", "on metal", "on metal-fast", "description"],
                  [(item.name, clock(long_s), f"{short_s:.0f} s", item.description) for item, long_s, short_s in rows])
    console.json([{"name": item.name, "description": item.description, "units": item.units} for item in shipped])
    return 0


def _show(console: Console, protocol: Any, device: Any, args: argparse.Namespace, parts: list[Any], start_s: float) -> None:
    from wineglass import protocols

    rate = protocols.rate_range_rad_s(device, args.loop) * 57.29577951308232
    low, high = min(part.to_degc for part in parts), max(part.to_degc for part in parts)
    fastest = max(abs(part.speed_degc_per_min) for part in parts)
    console.print(f"{protocol.name} on {device.name}, {'open loop' if args.loop == 'open' else 'force-to-rebalance'}: {protocol.description}\n"
                  f"lasts {clock(parts[-1].end_s)}, thermal unit {protocols.unit_s(device):g} s; chamber {low:.1f} to {high:.1f} degC, "
                  f"at most {fastest:.3g} degC/min; table up to {rate:.3g} deg/s")
    console.table("", ["clock", "s", "segment", "chamber [degC]", "table and device", "check"],
                  [(clock(start_s + part.begin_s), f"{part.begin_s:g}", part.segment.name, _chamber(part), _asked(part, device, args.loop),
                    part.segment.check) for part in parts])
    console.print(f"{clock(start_s + parts[-1].end_s)}  the end")


def _chamber(part: Any) -> str:
    if part.to_degc == part.from_degc:
        return f"{part.to_degc:.1f}"
    return f"{part.from_degc:.1f} to {part.to_degc:.1f}, {part.speed_degc_per_min:+.3g} a minute"


def _asked(part: Any, device: Any, loop: str) -> str:
    from wineglass import protocols

    times = [f"{part.at(at):g}" for at in part.segment.bursts]
    bursts = f"{'bursts' if len(times) > 1 else 'burst'} at {', '.join(times)} s" if times else ""
    return "; ".join(filter(None, [protocols.table_text(part, device, loop), protocols.device_text(part, device, loop), bursts])) or "rest"


def _write(args: argparse.Namespace, scenario: Any) -> dict[str, Path]:
    from wineglass import atomic, bench_script, protocols
    from wineglass import scenario as scenarios

    written = {}
    if args.script is not None:
        title = f"protocol {scenario.name} on {args.device}, {args.loop} loop\n./wineglass record --port PORT --script {args.script.name} -o run.h5"
        atomic.write_text(args.script, bench_script.of(scenarios.prepare(scenario)).to_toml(title))
        written["script"] = args.script
    if args.profile is not None:
        rows = [f"{time_s:.4f},{degc:.4f},{rate:.6f}" for time_s, degc, rate in protocols.profile(scenario)]
        atomic.write_text(args.profile, "\n".join(["time[s],chamber_temperature[degC],true_rate[deg/s]", *rows]) + "\n")
        written["profile"] = args.profile
    if args.scenario is not None:
        atomic.write_text(args.scenario, scenario.to_toml())
        written["scenario"] = args.scenario
    return written


def _start(text: str) -> float:
    from wineglass.errors import BadInput

    match = re.fullmatch(r"(\d{1,2}):(\d{2})", text)
    if match is None or int(match[1]) > 23 or int(match[2]) > 59:
        raise BadInput(f"'{text}' is no time of day", "--start", "write it as 9:30")
    return 3600.0 * int(match[1]) + 60.0 * int(match[2])


def clock(seconds: float) -> str:
    """h:mm:ss; days go on counting hours."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"

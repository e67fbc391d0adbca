"""`wineglass devices [NAME]`: the device descriptions that ship, or every field of one."""

from __future__ import annotations

import argparse
from typing import Any

from wineglass.console import Console

HELP = "list the device descriptions, or every field of one with value, unit, default and meaning"
NEEDS_BUILD = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", metavar="NAME", help="a shipped device, or the path of a .toml file")
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="KEY=VALUE", help="change a field first")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass import device as devices
    from wineglass.toml_text import assignment

    if args.name is None:
        _list(console)
    else:
        _show(devices.load(args.name).override(dict(map(assignment, args.settings)), "--set"), console)
    return 0


def _list(console: Console) -> None:
    from wineglass import device as devices

    shipped = [devices.load(name) for name in devices.names()]
    console.table("Devices", ["name", "f [Hz]", "Q", "shell [s]", "description"],
                  [(d.name, f"{d.resonator.frequency_hz:g}", f"{d.resonator.q:g}", f"{d.thermal.shell_time_constant_s:g}", d.description)
                   for d in shipped])
    console.json([{"name": d.name, "description": d.description} for d in shipped])


def _show(device: Any, console: Console) -> None:
    from wineglass.fields import rows

    fields = [row for row in rows(device) if row.path != "tolerance"]
    console.print(f"{device.name}: {device.description}")
    sections = dict.fromkeys(row.path.rpartition(".")[0] for row in fields)
    for section in filter(None, sections):
        console.table(section, ["field", "value", "unit", "default", "meaning"],
                      [(row.path.rpartition(".")[2], _text(row.value), row.unit, _text(row.default), row.meaning)
                       for row in fields if row.path.rpartition(".")[0] == section])
    console.table("What is uncertain (one standard deviation)", ["field", "tolerance", "because"],
                  [(path, _tolerance(item), item.why) for path, item in device.tolerance.items()])
    console.json({"device": device, "fields": [{"field": r.path, "value": r.value, "unit": r.unit, "default": r.default, "meaning": r.meaning}
                                               for r in fields]})


def _tolerance(item: Any) -> str:
    return f"{100 * item.relative:g} %" if item.relative is not None else _text(item.absolute).replace("\n", ", ")


def _text(value: Any) -> str:
    if isinstance(value, list):
        return "\n".join(_text(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)

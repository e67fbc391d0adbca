"""`wineglass bench`: the performance table, every ratio measured side by side in this run."""

from __future__ import annotations

import argparse

from wineglass.console import Console

HELP = "measure speed: kernels against numpy and scipy in float64, sample path, plant and twin"


LOOPS = {
    "plant_constant": "plant alone, constant rate and temperature",
    "plant_changing": "plant alone, rate and temperature new in every ms",
    "twin_constant": "twin: plant, noise, converters, whole firmware",
    "twin_changing": "the same, rate and temperature new in every ms",
    "envelope_open": "envelope twin at 50 Hz, open loop; samples it stands for",
    "envelope_rebalance": "the same, force-to-rebalance",
    "envelope_effects": "the same, two effects",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--link", type=int, metavar="FRAMES", help="instead: so many telemetry frames over a wire that damages 1 byte in 1000")


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.bench import envelope, kernels, loops

    if args.link is not None:
        return _link(args.link, console)
    rows = []
    with console.progress("measuring", total=8) as bar:
        for row in kernels.rows():
            rows.append(row)
            bar.advance()
        loops.build()
        measured = loops.figures() | envelope.figures()
        bar.advance()
        for row in loops.rows(measured):
            rows.append(row)
            bar.advance()
    console.table("One core, ns a sample; ratio: how many times faster than the reference", ["what", "ns", "reference", "ns", "ratio"],
                  [(row.what, f"{row.ours_ns:.2f}", row.reference, f"{row.reference_ns:.2f}", f"{row.speedup:.2f}") for row in rows])
    console.table("Loops, one core", ["what", "M samples/s", "times real time"],
                  [(name, f"{measured[key]:.1f}", f"{measured[key] * 1e6 / loops.SAMPLE_RATE_HZ:.0f}") for key, name in LOOPS.items()])
    console.json({"rows": [{"what": row.what, "reference": row.reference, "ours_ns": row.ours_ns, "reference_ns": row.reference_ns,
                            "ratio": row.speedup} for row in rows], "loops": measured})
    return 0


def _link(frames: int, console: Console) -> int:
    """A damaged frame whose CRC-32 fits by chance would be accepted: one in 2^32 of them."""
    from wineglass.bench import loops

    with console.progress(f"{frames} frames"):
        loops.build()
        account = loops.link(frames)
    broken = account["wrong"] or account["recovered"] != account["intact"]
    console.print(f"{account['frames']} frames, {account['bytes']} bytes, {account['errors']} of them replaced, lost or doubled")
    console.print(f"  {account['intact']} frames went through unharmed, {account['recovered']} of them were received")
    console.print(f"  {account['refused']} damaged packets were refused, {account['wrong']} accepted "
                  f"(by CRC-32 alone {account['refused'] / 2**32:.1e} are expected)")
    console.json(account)
    return 1 if broken else 0

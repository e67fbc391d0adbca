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
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    del parser  # nothing to choose


def run(args: argparse.Namespace, console: Console) -> int:
    from wineglass.bench import kernels, loops

    rows = []
    with console.progress("measuring", total=8) as bar:
        for row in kernels.rows():
            rows.append(row)
            bar.advance()
        loops.build()
        measured = loops.figures()
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


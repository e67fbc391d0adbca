"""How large every variant of every effect of the independent generator shows, at a multiple of its typical size.

    python tests/campaigns/generator_variants.py --protocol full --loop open --device metal-fast
    python tests/campaigns/generator_variants.py                      # the short day of the tests, both loops, half a minute of processor time each

One line per variant: the oracle's SNR and the channels that show it most. Lines in which no channel that is named for the effect reaches
SNR 8 are marked, and the exit status says whether there were any.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "tools"), str(HERE.parent / "python")]

import generator_case
from wineglass.blind import generator, setting
from wineglass.blind.generator import Applied, Case

BAR = 8.0


def case_of(protocol: str, device: str, loop: str, seed: int, effects: tuple[Applied, ...] = ()) -> Case:
    if not protocol:
        return generator_case.case(loop, seed, effects)
    return setting.case(protocol, device=device, loop=loop, seed=seed, effects=effects)


def line(key: tuple[str, str], make_case, factor: float, plain: Path, block: bytes) -> tuple[str, bool]:
    """One variant: what the table says, and whether it shows where it should."""
    one = generator.find(*key)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.h5"
        generator.make(make_case(effects=(Applied(one.id, one.name, factor * one.typical),)), path, block)
        grade = generator.grade(path, plain)
    shown = max(_seen(grade, channel) for channel in one.channels)
    top = sorted(grade.channels, key=lambda name: -grade.channels[name].snr)[:3]
    parts = "  ".join(f"{name} {grade.channels[name].shift:.0f}/{grade.channels[name].noise:.0f}" for name in top)
    mark = " " if shown > BAR else "!"
    return f"{mark} {one.id:24s} {one.name:18s} {factor * one.typical:9.3g} {one.unit:14s} SNR {grade.snr:9.1f}  named {shown:9.1f}   {parts}", shown > BAR


def _seen(grade: generator.Grade, channel: str) -> float:
    found = grade.channels.get(channel.removeprefix("noise of "))
    if found is None:
        return 0.0
    return max(found.noise, found.shift) if channel.startswith("noise of ") else found.shift


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--protocol", default="", help="bench protocol; left out: the short day of the tests")
    parser.add_argument("--device", default="metal-fast")
    parser.add_argument("--loop", choices=("open", "rebalance"), default="open")
    parser.add_argument("--factor", type=float, default=3.0, help="strength over the typical one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    make_case = partial(case_of, args.protocol, args.device, args.loop, args.seed)
    plain_case = make_case()
    block = setting.calibration_block(plain_case)
    keys = [(one.id, one.name) for one in generator.variants() if one.loop in ("", args.loop)]
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(args.jobs) as pool:
        plain = Path(folder) / "plain.h5"
        generator.make(plain_case, plain, block)
        results = []
        for text, good in pool.map(partial(line, make_case=make_case, factor=args.factor, plain=plain, block=block), keys):
            print(text, flush=True)
            results.append(good)
    print(f"{sum(results)} of {len(results)} variants show where they are said to; seed {args.seed}")
    sys.exit(0 if all(results) else 1)


if __name__ == "__main__":
    main()

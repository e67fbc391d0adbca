"""How often the 95 % intervals of `calibrate` hold the truth, on simulated sweeps with the firmware in the loop.

    python tests/campaigns/calibration_coverage.py --seeds 1000

Prints one line per coefficient: how many of the runs' intervals hold it, with the Wilson interval of that share. Too long for every
change (about 1.5 s a seed); docs/NUMBERS.md has the last result.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))

from wineglass import scenario, simulation
from wineglass.calibration.base import find_base
from wineglass.calibration.identify import Settings, identify
from wineglass.calibration.observations import observe
from wineglass.recording import Recording

SWEEP = {
    "device": "metal-fast",
    "duration_s": 265,
    "temperature": {"kind": "ramps", "start_degc": 25, "ramps": [
        {"to_degc": -35, "speed_degc_per_min": 60}, {"duration_s": 5}, {"to_degc": 80, "speed_degc_per_min": 60}, {"duration_s": 5},
        {"to_degc": 0, "speed_degc_per_min": 60}]},
    "plant": {"override": {"resonator.split_hz": 0.0}},
    "override": {"resonator.split_hz": 0.0},
    "mode": {"compensation": "none"},
    "recording": {"baseband_hz": 10, "output_hz": 10, "reference_hz": 10},
}


def identified(run: scenario.Run, folder: Path):
    path = folder / "sweep.h5"
    simulation.simulate(run, path)
    with Recording.open(path) as recording:
        base = find_base(recording, None, None)
        settings = Settings(reference_temperature_degc=base.reference_temperature_degc, tau_s=base.tau_s, gain=base.gain, delay_s=base.delay_s)
        return identify(observe(recording, None), settings, lambda *_: None)


def wilson(hits: int, n: int) -> tuple[float, float]:
    z, share = 1.959964, hits / n
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return centre - half, centre + half


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--first", type=int, default=1, help="first noise seed")
    args = parser.parse_args()
    base = scenario.parse(SWEEP, "coverage")
    truth = np.array(scenario.prepare(base).truth.resonator.cross_damping_rad_s)
    scores, orders = [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(args.first, args.first + args.seeds):
            found = identified(scenario.prepare(base.changed({"seed": seed})), Path(folder))
            n = min(len(found.bias_rad_s), len(truth))
            scores.append([(found.bias_rad_s[i] - truth[i]) / found.bias_half_width_rad_s[i] if i < n else np.nan for i in range(len(truth))])
            orders.append(found.order)
            if len(scores) % 20 == 0:
                print(f"{len(scores)} of {args.seeds}: {np.mean(np.abs(scores) <= 1, axis=0)}, mean z {1.96 * np.mean(scores, axis=0).round(3)}, orders {np.bincount(orders)}", file=sys.stderr, flush=True)
    for i, column in enumerate(np.array(scores).T):
        hits = int(np.sum(np.abs(column) <= 1))
        low, high = wilson(hits, len(column))
        print(f"alpha{i}: {hits} of {len(column)} = {hits / len(column):.3f} ({low:.3f} to {high:.3f}); z: mean {1.96 * np.mean(column):+.2f}, sd {1.96 * np.std(column):.2f}")
    print(f"orders chosen: {dict(enumerate(np.bincount(orders)))}")


if __name__ == "__main__":
    main()

"""The sample path, the plant and the whole twin: programs of benchmarks/, built and run here."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from wineglass.bench.model import Row, side_by_side
from wineglass.errors import BadInput
from wineglass.paths import repository_root

BUILD = Path("build/release")
PROGRAMS = ("bench_core", "bench_plant", "bench_twin")
SAMPLE_RATE_HZ = 50_000.0


def build() -> None:
    root = repository_root()
    command = ["cmake", "--build", str(root / BUILD), "--target", "benchmarks", "--parallel", "2"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BadInput("the benchmarks do not build", BUILD, f"see: {' '.join(command)}")


def figures() -> dict[str, float]:
    """Name -> ns a sample, or M samples/s, as each program prints them."""
    found = {}
    for program in PROGRAMS:
        output = subprocess.run([repository_root() / BUILD / "bin" / program], capture_output=True, text=True, check=True).stdout
        found.update({name: float(value) for name, value, _ in (line.split("\t") for line in output.splitlines())})
    return found


def link(frames: int, byte_errors: float = 1e-3, seed: int = 1) -> dict[str, int]:
    """Frames over a bad wire, encoder to receiver, in C; the account of what came through."""
    program = repository_root() / BUILD / "bin" / "bench_link"
    done = subprocess.run([program, str(frames), str(byte_errors), str(seed)], capture_output=True, text=True, check=False)
    return json.loads(done.stdout)


def rows(measured: dict[str, float]) -> Iterator[Row]:
    yield Row("sample path, G2 on, locked (all of it)", "the same mixers, biquad and forces in C with double, nothing else",
              measured["core_g2"], measured["float64_chain"])
    yield Row("plant, rate and temperature new in every ms", "scipy DOP853, rtol 1e-12", 1e3 / measured["plant_changing"], _dop853_ns())


def _dop853_ns() -> float:
    """One mode at 5 kHz is enough: the cost is the number of steps per cycle."""
    k, damping = 2 * np.pi * 5000.0, np.pi * 5000.0 / 1e4
    samples = 500
    span = samples / SAMPLE_RATE_HZ

    def motion(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -k * k * y[0] - 2 * damping * y[1], y[3], -k * k * y[2] - 2 * damping * y[3] + 2.0 * y[1]]

    row = side_by_side("", "", samples, lambda: None, lambda: solve_ivp(motion, (0, span), [1.0, 0, 0, 0], "DOP853", rtol=1e-12, atol=1e-15))
    return row.reference_ns

"""The envelope twin on the sweep that ships, 600 s at 50 Hz, with the calibration of the described device."""

from __future__ import annotations

import time

from wineglass import scenario
from wineglass.effects import Setting, typical
from wineglass.envelope import Envelope

FRAME_TICKS = 20
REPETITIONS = 15
CASES: dict[str, tuple[str, tuple[Setting, ...]]] = {
    "envelope_open": ("open", ()),
    "envelope_rebalance": ("rebalance", ()),
    "envelope_effects": ("rebalance", (typical("frequency_split"), typical("thermal_hysteresis"))),
}


def figures() -> dict[str, float]:
    """Name -> millions of samples a second that the sampled twin would have needed."""
    return {name: _million_samples_per_s(loop, effects) for name, (loop, effects) in CASES.items()}


def _million_samples_per_s(loop: str, effects: tuple[Setting, ...]) -> float:
    run = scenario.prepare(scenario.load("thermal-sweep").changed({"mode.loop": loop}))
    samples = run.n_blocks * run.device.block_samples
    inputs = Envelope(run, frame_ticks=FRAME_TICKS, step_ticks=FRAME_TICKS, effects=list(effects)).inputs()
    best_s = float("inf")
    for _ in range(REPETITIONS):
        envelope = Envelope(run, frame_ticks=FRAME_TICKS, step_ticks=FRAME_TICKS, effects=list(effects))
        begin = time.thread_time()
        envelope.run(inputs)
        best_s = min(best_s, time.thread_time() - begin)
    return 1e-6 * samples / best_s

"""A short bench day for the generator's tests: everything that excites an effect within a quarter of a minute."""

from __future__ import annotations

from typing import Any

from wineglass import nominal, scenario
from wineglass.blind.generator import Applied, Case
from wineglass.calibration_block import to_binary
from wineglass.scenario import Scenario

FAST_SHELL = {"thermal.shell_time_constant_s": 0.3}


def day(loop: str = "open", seed: int = 5, **tables: Any) -> Scenario:
    """tables: whole entries of the scenario in place of the day's own."""
    return scenario.parse({
        "name": "short_day", "device": "metal-fast", "override": FAST_SHELL, "duration_s": 14.0, "seed": seed,
        "temperature": {"kind": "table", "times_s": [3.0, 5.5, 6.5, 9.5, 10.5, 12.5], "values_degc": [25.0, 65.0, 65.0, -15.0, -15.0, 25.0]},
        "rate": {"kind": "steps", "times_s": [4.5, 5.8, 7.0, 9.8, 10.4], "values_deg_s": [20.0, 0.0, -20.0, 15.0, 0.0], "edge_s": 0.1},
        "mode": {"loop": loop},
        "recording": {"baseband_hz": 50.0, "output_hz": 50.0, "reference_hz": 50.0, "bursts": [{"time_s": 4.1, "samples": 1000}]},
        "command": [{"kind": "amplitude", "at_s": 11.5, "set_point_fs": 0.6}, {"kind": "amplitude", "at_s": 13.0, "set_point_fs": 0.9}],
        **tables,
    }, "short day")


def case(loop: str = "open", seed: int = 5, effects: tuple[Applied, ...] = (), **more: Any) -> Case:
    return Case(day(loop, seed), effects=effects, **more)


def block(one: Case) -> bytes:
    return to_binary(nominal.calibration(scenario.prepare(one.scenario)))

"""What an examiner needs from the product to set a case: the protocol as a scenario, and the calibration that the device gets.

    case = setting.case("full", device="metal-fast", loop="rebalance", seed=7, effects=(generator.Applied("ageing", "linear", 30.0),))
    generator.make(case, "case.h5", setting.calibration_block(case))
"""

from __future__ import annotations

from typing import Any, Literal

from wineglass import nominal, protocols, scenario
from wineglass.blind.generator import Applied, Case
from wineglass.calibration_block import to_binary


def case(protocol: str, device: str = protocols.DEVICE, loop: Literal["open", "rebalance"] = "open", seed: int = 1,
         effects: tuple[Applied, ...] = (), **more: Any) -> Case:
    """A case on one of the bench protocols. more: another_unit, noise_factor, lost_fraction."""
    return Case(protocols.scenario(protocol, device=device, loop=loop, seed=seed), effects=effects, **more)


def calibration_block(case: Case) -> bytes:
    """The nominal calibration of the described device, set up for the scenario's loop."""
    return to_binary(nominal.calibration(scenario.prepare(case.scenario)))

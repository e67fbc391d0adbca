"""What is asked of the generator: a bench day, what is wrong with the device, and how the day was unlucky."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from wineglass.scenario import Scenario


@dataclass(frozen=True)
class Applied:
    """One effect. strength: in the variant's own unit (`effects.find(id, variant).unit`); 0 is no effect."""

    id: str
    variant: str
    strength: float

    def scaled(self, factor: float) -> Applied:
        return replace(self, strength=self.strength * factor)


@dataclass(frozen=True)
class Case:
    """One recording to be made.

    scenario: device, profiles, loop and seed; its `plant` (what differs in truth) is not used, `effects` say what differs
    another_unit: a device drawn within the description's tolerances instead of one exactly as described
    noise_factor: over the described converter noise; the recording's description states it
    lost_fraction: of the telemetry frames that never reach the recorder
    """

    scenario: Scenario
    effects: tuple[Applied, ...] = ()
    another_unit: bool = False
    noise_factor: float = 1.0
    lost_fraction: float = 0.0
    seed: int | None = None
    """of everything drawn; None: the scenario's"""
    noise_seed: int | None = None
    """of noise and described floors alone; None: `seed`"""
    fields: Mapping[str, Any] = field(default_factory=dict)
    """of the unit, by dotted name, in place of what would be drawn"""
    paced: bool = False
    """the bench goes by the device's clock, so that nothing but the device itself tells of that clock"""

    @property
    def draw(self) -> int:
        return self.scenario.seed if self.seed is None else self.seed

    @property
    def noise_draw(self) -> int:
        return self.draw if self.noise_seed is None else self.noise_seed

    def without_effects(self) -> Case:
        return replace(self, effects=())

    def label(self) -> dict[str, Any]:
        """What is sealed: plain data, without the scenario's profiles."""
        return {
            "scenario": self.scenario.name, "device": self.scenario.device, "loop": self.scenario.mode.loop, "seed": self.draw,
            "another_unit": self.another_unit, "noise_factor": self.noise_factor, "lost_fraction": self.lost_fraction,
            "effects": [{"id": one.id, "variant": one.variant, "strength": one.strength} for one in self.effects],
        }


@dataclass(frozen=True)
class Made:
    """What making a recording did."""

    path: str
    clipped_codes: int
    elapsed_s: float
    truth: dict[str, Any] = field(default_factory=dict)
    """fields of the device that were drawn, by dotted name"""

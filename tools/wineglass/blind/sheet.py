"""One case of an exam as plain data: what is sealed, and what the generator makes the recording from."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from wineglass import protocols
from wineglass.blind import profiles, setting
from wineglass.blind.choices import NULLS, TIERS
from wineglass.blind.generator import Applied, Case

__all__ = ["NULLS", "TIERS", "Effect", "Sheet"]

Tier = Literal[TIERS]


class Effect(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    id: str
    variant: str
    strength: float


class Sheet(BaseModel):
    """twins: sets of ids that nobody could tell apart on this recording, the truth among them; empty: the truth can be found
    profile: 0 as the protocol says, else the seed of another bench day of the same kind
    factor: strength over the typical one of the first effect; 0 without effects"""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str
    tier: Tier
    protocol: str
    loop: Literal["open", "rebalance"]
    device: str = protocols.DEVICE
    seed: int
    effects: tuple[Effect, ...] = ()
    factor: float = 0.0
    another_unit: bool = True
    noise_factor: float = Field(1.0, gt=0)
    lost_fraction: float = Field(0.0, ge=0, lt=1)
    profile: int = 0
    at_rest: bool = False
    twins: tuple[tuple[str, ...], ...] = ()

    @property
    def group(self) -> str:
        """Recordings of one kind, which may be compared number by number."""
        return f"{self.device} {self.protocol} {self.loop}"

    @property
    def kind(self) -> str:
        """Of the day without what is wrong, as a name of a folder."""
        return f"{Path(self.device).stem}_{self.protocol}_{self.loop}{'_at_rest' if self.at_rest else ''}"

    def healthy(self) -> Sheet:
        """The same for all of a kind."""
        return self.model_copy(update={"name": self.kind, "tier": "null", "seed": 1, "effects": (), "factor": 0.0, "twins": (), "another_unit": False})

    def case(self) -> Case:
        """For the generator."""
        day = protocols.load(self.protocol)
        if self.profile or self.at_rest:
            day = profiles.varied(day, self.profile, self.at_rest)
        scenario = protocols.scenario(day, device=self.device, loop=self.loop, seed=self.seed)
        scenario = scenario.model_copy(update={"device": self.device})
        effects = tuple(Applied(one.id, one.variant, one.strength) for one in self.effects)
        return Case(scenario, effects, self.another_unit, self.noise_factor, self.lost_fraction)

    def block(self) -> bytes:
        """The calibration in the device's store."""
        return setting.calibration_block(self.case())

    def label(self) -> dict[str, Any]:
        return self.model_dump(mode="json")

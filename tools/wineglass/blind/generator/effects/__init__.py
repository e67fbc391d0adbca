"""What can be wrong: one module per stage, every effect in several functional forms."""

from __future__ import annotations

from collections.abc import Iterable

from wineglass.blind.generator.case import Applied
from wineglass.blind.generator.effects import (  # noqa: F401  (each fills the register)
    actuation, beyond, clock, coupling, environment, firmware, pickoff, primary, secondary, temperature,
)
from wineglass.blind.generator.effects.register import Variant, find, ids, variants
from wineglass.blind.generator.world import World

__all__ = ["Variant", "apply", "find", "ids", "variants"]


def apply(world: World, effects: Iterable[Applied]) -> None:
    """Puts effects into a world, the clock's first since every profile hangs on the time. Strength 0 changes nothing at all."""
    chosen = [(find(one.id, one.variant), one.strength) for one in effects if one.strength != 0.0]
    for variant, strength in sorted(chosen, key=lambda pair: pair[0].stage != "clock"):
        variant.law(world, strength)

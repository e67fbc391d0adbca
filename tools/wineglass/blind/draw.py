"""Which cases an exam holds. The same seed and the same wishes draw the same cases, in an order that says nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np

from wineglass import protocols
from wineglass.blind import generator
from wineglass.blind.generator import Variant
from wineglass.blind.sheet import TIERS, Effect, Sheet

STRENGTHS = (0.1, 0.2, 0.5, 1.0, 1.7, 3.0)  # over the typical one
TOGETHER = (0.7, 1.7)  # of effects that come together: one should not drown the other
SHARES = {"null": 6, "null_unit": 6, "null_profile": 5, "null_lossy": 4, "null_noisy": 4, "single": 42, "pair": 12, "triple": 6, "outside": 8,
          "known_and_unknown": 4, "unidentifiable": 3}
PROTOCOL_SHARES = {"full": 55, "operating": 15, "thermal": 15, "table": 15}
LOST = 0.002
NOISE = 2.0

# Of either sign, in all their variants.
SIGNED = ("frequency_temperature", "damping_temperature", "amplitude_frequency", "cross_damping", "cross_stiffness", "coriolis_gain", "thermal_gradient",
          "thermal_hysteresis", "ageing", "drive_misalignment", "actuator_gain", "pickoff_gain", "drive_feedthrough", "clock_error", "thermometer_error",
          "rate_reference", "firmware_mismatch", "thermal_acceleration", "rate_squared", "chamber_stress", "secondary_sees_primary", "channel_memory")

# What physics makes the same on a recording at rest, in the open loop: (variants to draw from, ids that nobody tells apart).
TWINS = (
    ((("frequency_split", "constant"), ("pickoff_phase", "constant")), ("frequency_split", "pickoff_phase")),
    ((("drive_feedthrough", "resistive"), ("cross_stiffness", "constant"), ("drive_misalignment", "constant")),
     ("cross_stiffness", "drive_feedthrough", "drive_misalignment")),
)


@dataclass(frozen=True)
class Wishes:
    """shares: weights of the tiers and of the protocols."""

    cases: int
    seed: int
    device: str = protocols.DEVICE
    tiers: tuple[str, ...] = TIERS
    protocols: tuple[str, ...] = tuple(PROTOCOL_SHARES)


def draw(wishes: Wishes) -> list[Sheet]:
    """Sheets named case_0001 onwards."""
    random = np.random.default_rng([wishes.seed, 0x424C494E])
    tiers = apportioned(wishes.cases, {tier: SHARES[tier] for tier in wishes.tiers})
    days = _endless(apportioned(max(wishes.cases, len(wishes.protocols)), {one: PROTOCOL_SHARES.get(one, 15) for one in wishes.protocols}), random)
    known, outside = generator.ids(in_catalogue=True), generator.ids(in_catalogue=False)
    ids = {"alone": _endless(known, random), "known": _endless(known, random), "outside": _endless(outside, random)}
    strengths, twins = _endless(STRENGTHS, random), _endless(range(len(TWINS)), random)
    return [_sheet(f"case_{number:04d}", str(tier), wishes, random, days, ids, strengths, twins)
            for number, tier in enumerate(random.permutation(tiers), start=1)]


def apportioned(total: int, shares: dict[str, int]) -> list[str]:
    """`total` names in proportion to their shares, each at least once if there is room, largest remainders first."""
    names, weight = list(shares), sum(shares.values())
    least = 1 if total >= len(names) else 0
    exact = {name: (total - least * len(names)) * shares[name] / weight for name in names}
    counts = {name: least + int(exact[name]) for name in names}
    for name in sorted(names, key=lambda one: int(exact[one]) - exact[one])[: total - sum(counts.values())]:
        counts[name] += 1
    return [name for name in names for _ in range(counts[name])]


def _endless(items: Sequence, random: np.random.Generator) -> Iterator:
    """All items in random order, again and again, so that each comes as often as the others."""
    for _ in count():
        yield from (items[index] for index in random.permutation(len(items)))


def _sheet(name: str, tier: str, wishes: Wishes, random: np.random.Generator, days: Iterator, ids: dict[str, Iterator], strengths: Iterator,
           twins: Iterator) -> Sheet:
    protocol, loop, seed = next(days), str(random.choice(["open", "rebalance"])), int(random.integers(1, 2**31))
    common = {"name": name, "tier": tier, "protocol": protocol, "loop": loop, "device": wishes.device, "seed": seed}
    if tier in NULL_FIELDS:
        return Sheet(**common, **NULL_FIELDS[tier], profile=seed if tier == "null_profile" else 0)
    if tier == "unidentifiable":
        choices, indistinct = TWINS[next(twins)]
        id, variant = choices[int(random.integers(len(choices)))]
        effect = _effect(generator.find(id, variant), 1.0, random)
        still = {"protocol": "operating" if "thermal" not in wishes.protocols else "thermal", "loop": "open", "at_rest": True}
        return Sheet(**{**common, **still}, effects=(effect,), factor=1.0, twins=tuple((one,) for one in indistinct))
    if tier == "single":
        factor = float(next(strengths))
        return Sheet(**common, effects=_effects(1, ids["alone"], loop, factor, random), factor=factor)
    factor = float(np.exp(random.uniform(*np.log(TOGETHER))))
    known = {"pair": 2, "triple": 3, "outside": 0, "known_and_unknown": 1}[tier]
    outside = _effects(0 if known > 1 else 1, ids["outside"], loop, factor, random)
    return Sheet(**common, effects=_effects(known, ids["known"], loop, factor, random) + outside, factor=factor)


NULL_FIELDS = {"null": {"another_unit": False}, "null_unit": {}, "null_profile": {}, "null_lossy": {"lost_fraction": LOST}, "null_noisy": {"noise_factor": NOISE}}


def _effects(wanted: int, ids: Iterator, loop: str, factor: float, random: np.random.Generator) -> tuple[Effect, ...]:
    """Different ids, in variants that show in this loop."""
    found: dict[str, Effect] = {}
    while len(found) < wanted:
        id = next(ids)
        choices = [one for one in generator.variants(id) if one.loop in ("", loop)]
        if choices and id not in found:
            found[id] = _effect(choices[int(random.integers(len(choices)))], factor, random)
    return tuple(found.values())


def _effect(variant: Variant, factor: float, random: np.random.Generator) -> Effect:
    sign = float(random.choice([-1.0, 1.0])) if variant.id in SIGNED else 1.0
    return Effect(id=variant.id, variant=variant.name, strength=float(f"{sign * factor * variant.typical:.6g}"))

"""Another bench day of the same kind: other lengths, temperatures and rates than the protocol's."""

from __future__ import annotations

import numpy as np

from wineglass.protocols import Protocol, ProtocolSegment

LENGTHS = 0.8, 1.3
SIZES = 0.7, 1.0  # never beyond what the protocol dares


def varied(day: Protocol, seed: int, at_rest: bool = False) -> Protocol:
    """seed 0: as it is; at_rest: the table does not move."""
    random = np.random.default_rng([seed, 0x50524F46])
    size = float(random.uniform(*SIZES)) if seed else 1.0
    return day.model_copy(update={"segment": [_segment(one, random, seed != 0, size, at_rest) for one in day.segment]})


def _segment(one: ProtocolSegment, random: np.random.Generator, other: bool, size: float, at_rest: bool) -> ProtocolSegment:
    length = float(random.uniform(*LENGTHS)) if other else 1.0
    moved = {} if not at_rest else {"rate_steps": [], "rate_chirp": 0.0}
    temperature = None if one.temperature is None else one.temperature * size
    rates = [rate * size for rate in one.rate_steps]
    return one.model_copy(update={"lasts": one.lasts * length, "temperature": temperature, "rate_steps": rates,
                                  "rate_chirp": one.rate_chirp * size, **moved})

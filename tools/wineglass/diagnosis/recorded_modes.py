"""When the device ran as its calibration block says, as far as the recording's events tell."""

from __future__ import annotations

import math

from wineglass.calibration_block import Calibration
from wineglass.recording.reader import Recording

SETTLING_DECAYS, SETTLING_LONGEST_S = 10.0, 8.0


def settling_s(calibration: Calibration | None) -> float:
    """After a change: ten decays of the shell; what a slow shell still does then is smooth."""
    decay = calibration.decay_rate_per_s[0] if calibration is not None else 1.0
    return min(SETTLING_DECAYS / decay, SETTLING_LONGEST_S)


def foreign_spans(recording: Recording, calibration: Calibration) -> list[tuple[float, float]]:
    """Times [s] in which a command had set another loop or compensation than the calibration block, or had switched the drive; and a while after."""
    stated = {"loop": calibration.loop, "compensation": calibration.compensation}
    settle_s = settling_s(calibration)
    since: dict[str, float] = {}
    spans: list[tuple[float, float]] = []
    for event in recording.events:
        kind, _, rest = event.value.partition(" ") if event.kind == "command" else (event.kind, "", event.value)
        at, value = event.sample / recording.counter_rate_hz, rest.rpartition("=")[2].strip()
        if kind in stated and event.sample > 0:
            if value != stated[kind]:
                since.setdefault(kind, at)
            elif kind in since:
                spans.append((since.pop(kind), at + settle_s))
        if kind == "drive":
            spans.append((at, at + settle_s))
    return [*spans, *((at, math.inf) for at in since.values())]

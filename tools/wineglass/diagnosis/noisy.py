"""What the noise side has named is no riddle to the slow channels: a floor as high as that noise makes it, no frames that single events shake,
and no line that beats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wineglass.diagnosis import tones
from wineglass.diagnosis.channels import Frames
from wineglass.diagnosis.described_noise import FLAT_ALLAN
from wineglass.diagnosis.drive import Driven
from wineglass.diagnosis.noise_added import Added
from wineglass.diagnosis.noise_level import NoiseEvidence
from wineglass.recording.memory import Source

DROPPED = "dropped_samples"
BEATING = frozenset({"interference", "vibration"})
BENT = frozenset({"adc_nonlinearity", "adc_saturation"})
"""Converters that bend: their harmonics beat with the sampling clock in whatever stands still otherwise, and no envelope knows the phase"""
SLOW_HZ = (0.01, 0.1)  # where a wander of the bias is compared with the described floor
FED = ("secondary_", "rebalance_", "rate", "quadrature")
MOST_MASKED = 0.93  # of all frames; what is left beyond that says nothing


def device_with(driven: Driven, added: Added) -> Driven:
    """The device described as restless as its bias is."""
    freq_hz = np.array(SLOW_HZ)
    wander_rad_s = float(np.sqrt(np.max(FLAT_ALLAN * freq_hz * added.wander_psd(freq_hz))))
    floor_rad_s = driven.run.device.noise_floor.rate_bias_instability_rad_s
    if wander_rad_s <= floor_rad_s:
        return driven
    noisy = driven.run.device.override({"noise_floor.rate_bias_instability_rad_s": min(1.0, float(np.hypot(wander_rad_s, floor_rad_s)))})
    return replace(driven, run=replace(driven.run, device=noisy))


def undisturbed(recorded: Frames, driven: Driven, noise: NoiseEvidence) -> Frames:
    """Frames in which a single event still shakes the shell are not used."""
    resonator = driven.run.device.resonator
    time_s = recorded.grid.time_s
    shaken = np.zeros(len(time_s), bool)
    for begin, end in noise.disturbed_s(float(resonator.decay_rate_at(resonator.reference_temperature_degc))):
        shaken |= (time_s > begin - recorded.grid.frame_s) & (time_s < end + recorded.grid.frame_s)
    if np.mean(shaken) > MOST_MASKED:
        shaken[:] = True
    return replace(recorded, use=recorded.use & ~shaken, shaken=True)


def unseen_bends(named: frozenset[str]) -> frozenset[str]:
    """Codes show the converters' curve as it is: where they tell one way to bend, slow channels need not ask for the other."""
    return BENT - named if BENT & named else frozenset()


def with_beats(recorded: Frames) -> Frames:
    """Whatever changes from frame to frame is noise of a converter that bends."""
    return replace(recorded, beating=True)


def without_beats(recorded: Frames, recording: Source, noise: NoiseEvidence) -> Frames:
    """A tone, and a line of the mount, beat in whatever the secondary pickoff feeds, slowly enough for frames, and drift as the shell does. The line is taken
    out before the means; a channel in which that cannot be done is not used. What is left of it where a loop was open for a short while is noise."""
    lines = [line for line in (noise.lines.clear if noise.lines is not None else []) if line.kind in BEATING & frozenset(noise.named)]
    fed = [name for name in recorded.names if name.startswith(FED)]
    freed = tones.without(recorded, recording, lines, fed) if lines else {}
    values, use = recorded.values.copy(), recorded.use.copy()
    for name in fed:
        i = recorded.names.index(name)
        if name in freed:
            values[i], sound = freed[name]
            use[i] &= sound
        else:
            use[i] = False
    return replace(recorded, values=values, use=use, freed=frozenset(fed))

"""The slow noise that a description grants a healthy device: flicker of bias, frequency, losses and thermometer, as spectra of the slow channels.

A described floor is where the Allan deviation is flat: density h/f with h = floor^2 / (2 ln 2) (IEEE Std 952, flicker noise). How it gets into a
channel is asked of the envelope twin at rest: a step of the rate stands for one of the bias, a step of the losses for theirs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft

from wineglass.diagnosis.drive import Driven
from wineglass.effects import Setting
from wineglass.envelope import Envelope
from wineglass.profiles import StepRate
from wineglass.scenario import Run

FLAT_ALLAN = 2.0 * np.log(2.0)
STEP_AT_S = 6.0
STEP_RATE_DEG_S, STEP_LOSSES = 0.01, 1e-3
FRAMES = 250  # of the answer to a step; the secondary rings down within a quarter of them
STEPPED = {"rate_bias_instability_rad_s": ("secondary_in_phase", "rebalance_in_phase"), "drive_level_relative": ("primary_in_phase", "drive_level")}
"""Where a noise of which floor is to be seen, by the answer to a step; others are what they are."""


def densities(resting: Run, driven: Driven, frame_s: float, names: Sequence[str], freq_hz: np.ndarray) -> np.ndarray:
    """(channels, n): one-sided spectral densities of frame means in the channels' units^2/Hz. resting: the device standing still in the loop of
    interest; freq_hz (n,): n even steps up to half the frame rate, without zero."""
    found = np.zeros((len(names), len(freq_hz)))
    flicker = 1.0 / (FLAT_ALLAN * freq_hz)
    for name, size in direct_floors(driven).items():
        if name in names:
            found[names.index(name)] = size**2 * flicker
    floor = driven.run.device.noise_floor
    for source, channels in STEPPED.items():
        size = getattr(floor, source)
        if size > 0.0 and any(name in names for name in channels):
            steps = _answer(resting, driven, frame_s, source)
            for name in channels:
                if name in names and name in steps:
                    found[names.index(name)] = size**2 * flicker * _gain_squared(steps[name], len(freq_hz))
    return found


def direct_floors(driven: Driven) -> dict[str, float]:
    """Floors that a channel shows as they are, in its unit."""
    device = driven.run.device
    return {"temperature_measured": device.noise_floor.temperature_degc,
            "drive_frequency": 1e-6 * device.noise_floor.frequency_ppm * device.resonator.frequency_hz}


def _answer(resting: Run, driven: Driven, frame_s: float, source: str) -> dict[str, np.ndarray]:
    """(FRAMES,) per channel: what one unit of the noise's quantity, from one frame on, does to it."""
    device = resting.device
    at_s = frame_s * round(STEP_AT_S / frame_s)
    scenario = resting.scenario.model_copy(update={"duration_s": at_s + (FRAMES + 1) * frame_s})
    stepped, effects, size = scenario, [], STEP_LOSSES
    if source == "rate_bias_instability_rad_s":
        edge_s = 1.0 / device.slow_rate_hz
        stepped = scenario.model_copy(update={"rate": StepRate(times_s=[at_s], values_deg_s=[STEP_RATE_DEG_S], edge_s=edge_s)})
        size = np.radians(STEP_RATE_DEG_S)
    else:
        effects = [Setting("damping_step", {"damping": STEP_LOSSES, "time_s": at_s})]
    ticks, first = max(1, round(frame_s * device.slow_rate_hz)), round(at_s / frame_s)
    values = []
    for given, having in ((scenario, []), (stepped, effects)):
        with Envelope(Run(given, resting.device, resting.truth), calibration_block=driven.calibration_block, frame_ticks=ticks, effects=having) as envelope:
            values.append(envelope.run())
    plain, moved = values
    return {name: (moved[name] - plain[name])[first : first + FRAMES] / size for name in STEPPED[source]}


def _gain_squared(steps: np.ndarray, count: int) -> np.ndarray:
    """(count,): of a filter with this step response (FRAMES,), at even steps up to half the frame rate."""
    return np.abs(fft.rfft(np.diff(steps, prepend=0.0), 2 * count)[1:]) ** 2

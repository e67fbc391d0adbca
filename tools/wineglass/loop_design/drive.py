"""The two loops of the primary mode, phase (PLL) and amplitude (AGC), with the nominal gains of a described device."""

from __future__ import annotations

import math

from wineglass import nominal
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.loop_design.margins import margins
from wineglass.loop_design.model import Gains, Loop, Schedule, phase_plant, resonant_plant

SLOT = 2  # firmware/core/gyro_loop.c: run_drive()
AT_ONCE = -1  # the oscillator's new frequency turns it on the way to the next sample
LEAST_PHASE_MARGIN_DEG, LEAST_GAIN_MARGIN_DB = 30.0, 6.0


def pll(device: Device, gains: Gains | None = None) -> Loop:
    """Phase of the primary [rad] -> frequency of the oscillator [rad/s]."""
    schedule = Schedule(device.electronics.sample_rate_hz, device.firmware.decimation, SLOT, AT_ONCE)
    return Loop(phase_plant(_decay(device)), schedule, gains or _gains(nominal.pll_gains(device)))


def agc(device: Device, gains: Gains | None = None) -> Loop:
    """Amplitude [FS] -> drive force [FS]."""
    electronics, resonator = device.electronics, device.resonator
    latency = electronics.dac.latency_samples + electronics.adc.delay_samples
    schedule = Schedule(electronics.sample_rate_hz, device.firmware.decimation, SLOT, latency)
    full = device.holding_acceleration_fs_s2 * electronics.dac.drive_reach
    plant = resonant_plant(resonator.frequency_hz, _decay(device), full, resonator.frequency_hz, nominal.loop_delay_samples(device),
                           electronics.sample_rate_hz)
    return Loop(plant, schedule, gains or _gains(nominal.agc_gains(device)))


def check(loop: Loop, where: str) -> None:
    """Refuses a loop that is unstable or too near to it."""
    if not loop.stable:
        raise BadInput("the loop is unstable", where, "choose a smaller bandwidth")
    found = margins(loop)
    short = found.phase_margin_deg < LEAST_PHASE_MARGIN_DEG or found.gain_margin_db < LEAST_GAIN_MARGIN_DB
    if short or math.isnan(found.phase_margin_deg):
        raise BadInput(f"only {found.phase_margin_deg:.1f} deg and {found.gain_margin_db:.1f} dB of margin", where, "choose a smaller bandwidth")


def _gains(found: nominal.Gains) -> Gains:
    return Gains(found.proportional, found.integral)


def _decay(device: Device) -> float:
    return float(device.resonator.decay_rate_at(device.resonator.reference_temperature_degc))

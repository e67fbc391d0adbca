"""The channels a recording may hold: one table of names, units and meanings."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Channel:
    name: str
    tap: str
    unit: str
    meaning: str


TAPS = ("raw", "baseband", "output", "reference")

_CHANNELS = [
    Channel("primary_adc_raw", "raw", "FS", "primary pickoff, of ADC full scale"),
    Channel("secondary_adc_raw", "raw", "FS", "secondary pickoff, of ADC full scale"),
    Channel("drive_dac_raw", "raw", "FS", "drive force, of drive DAC full scale"),
    Channel("rebalance_dac_raw", "raw", "FS", "rebalance force, of rebalance DAC full scale"),
    Channel("thermometer_raw", "raw", "LSB", "thermometer code that the firmware had at this sample (-2^31: none)"),
    Channel("primary_in_phase", "baseband", "FS", "primary pickoff in phase with the demodulation reference"),
    Channel("primary_quadrature", "baseband", "FS", "primary pickoff in quadrature"),
    Channel("secondary_in_phase", "baseband", "FS", "secondary pickoff in phase"),
    Channel("secondary_quadrature", "baseband", "FS", "secondary pickoff in quadrature"),
    Channel("drive_frequency", "baseband", "Hz", "frequency of the drive loop's oscillator"),
    Channel("drive_level", "baseband", "FS", "drive force amplitude, of drive DAC full scale"),
    Channel("amplitude_set_point", "baseband", "FS", "amplitude the drive loop holds, of ADC full scale"),
    Channel("rebalance_in_phase", "baseband", "FS", "rebalance force in phase, of rebalance DAC full scale"),
    Channel("rebalance_quadrature", "baseband", "FS", "rebalance force in quadrature, of rebalance DAC full scale"),
    Channel("status", "baseband", "bits", "status bits of the firmware"),
    Channel("temperature_measured", "output", "degC", "temperature as the firmware sees it"),
    Channel("rate", "output", "rad/s", "rate output as configured (compensated where compensation is on)"),
    Channel("rate_uncompensated", "output", "rad/s", "rate output without bias compensation"),
    Channel("quadrature", "output", "rad/s", "quadrature, as the rate that it would be a quarter of a period later"),
    Channel("angle", "output", "rad", "integral of the rate (compensated, unfiltered) to the end of the interval"),
    Channel("true_rate", "reference", "rad/s", "rate of the rate table"),
    Channel("chamber_temperature", "reference", "degC", "air temperature in the climate chamber"),
    Channel("shell_temperature", "reference", "degC", "temperature of the resonator shell"),
]

CHANNELS = {channel.name: channel for channel in _CHANNELS}

TIME = Channel("time", "", "s", "time of each sample, where the samples are not evenly spaced")

ABSOLUTE_ZERO_DEGC = -273.15


def channels_of(tap: str) -> list[Channel]:
    return [channel for channel in _CHANNELS if channel.tap == tap]


def find(tap: str, name: str) -> Channel | None:
    """The table's entry for a channel of a tap; `time` may stand in every tap but raw."""
    if name == TIME.name and tap != "raw":
        return TIME
    channel = CHANNELS.get(name)
    return channel if channel is not None and channel.tap == tap else None

"""The one table of stages, components and effects that a diagnosis may name."""

from __future__ import annotations

from dataclasses import dataclass

STAGES = ("primary", "secondary", "coupling", "actuation", "pickoff", "clock", "temperature", "environment", "firmware")
COMPONENTS = ("in_phase", "quadrature", "frequency", "level", "temperature", "noise")
VERDICTS = ("no_gap", "attributed", "ambiguous", "unknown", "insufficient")
NONE, OTHER, FLICKER = "none", "other", "flicker_noise"


@dataclass(frozen=True)
class Entry:
    id: str
    stage: str
    component: str
    says: str


_ENTRIES = [
    Entry("frequency_temperature", "primary", "frequency", "the frequency depends on temperature in another way"),
    Entry("damping_temperature", "primary", "level", "the quality factor depends on temperature in another way"),
    Entry("amplitude_frequency", "primary", "frequency", "the frequency depends on the amplitude"),
    Entry("amplitude_damping", "primary", "level", "the damping depends on the amplitude"),
    Entry("damping_step", "primary", "level", "the damping steps or creeps at constant temperature"),
    Entry("frequency_split", "secondary", "quadrature", "the two modes have different frequencies"),
    Entry("damping_mismatch", "secondary", "in_phase", "the two modes have different damping"),
    Entry("cross_damping", "coupling", "in_phase", "the bias over temperature is another static curve"),
    Entry("cross_stiffness", "coupling", "quadrature", "the quadrature over temperature is another one"),
    Entry("coriolis_gain", "coupling", "in_phase", "the scale factor is another one"),
    Entry("thermal_gradient", "coupling", "in_phase", "the bias follows the speed of the temperature"),
    Entry("thermal_hysteresis", "coupling", "in_phase", "the bias depends on the way the temperature took"),
    Entry("ageing", "coupling", "in_phase", "the bias drifts with time"),
    Entry("drive_misalignment", "actuation", "quadrature", "the drive force leaks into the secondary mode"),
    Entry("actuator_gain", "actuation", "level", "the force per code changes"),
    Entry("drive_phase", "actuation", "quadrature", "the force lags the drive reference"),
    Entry("pickoff_gain", "pickoff", "in_phase", "the secondary pickoff has another gain"),
    Entry("pickoff_phase", "pickoff", "quadrature", "the secondary channel has another delay"),
    Entry("drive_feedthrough", "pickoff", "quadrature", "the drive voltage leaks into the secondary pickoff"),
    Entry("adc_nonlinearity", "pickoff", "in_phase", "the converter is not linear"),
    Entry("adc_saturation", "pickoff", "level", "the converter clips"),
    Entry("excess_noise", "pickoff", "noise", "there is more white noise than the device should have"),
    Entry("flicker_noise", "pickoff", "noise", "the bias wanders like 1/f noise"),
    Entry("clock_error", "clock", "frequency", "the sampling clock is off"),
    Entry("clock_jitter", "clock", "noise", "the sampling clock jitters"),
    Entry("dropped_samples", "clock", "noise", "samples are lost or doubled"),
    Entry("thermometer_lag", "temperature", "temperature", "thermometer and bias do not follow the temperature at the same instant"),
    Entry("thermometer_error", "temperature", "temperature", "the thermometer has an offset or another gain"),
    Entry("thermometer_quantisation", "temperature", "temperature", "the thermometer has coarse steps"),
    Entry("vibration", "environment", "in_phase", "the base moves"),
    Entry("interference", "environment", "in_phase", "a tone couples in"),
    Entry("rate_reference", "environment", "in_phase", "the true rate is not what the reference says"),
    Entry("firmware_mismatch", "firmware", "in_phase", "the output is not what this firmware makes of the codes"),
]

EFFECTS = {entry.id: entry for entry in _ENTRIES}


def stage_of(effect_id: str) -> str:
    return EFFECTS[effect_id].stage


def component_of(effect_id: str) -> str:
    return EFFECTS[effect_id].component

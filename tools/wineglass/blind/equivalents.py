"""Parameters that the generator's forms and the diagnosis' catalogue both have, and how one becomes the other: what intervals are checked with.

Forms that are not here have no parameter of the catalogue: `WITHOUT` says why."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from wineglass import device as devices
from wineglass.blind.sheet import Effect, Sheet
from wineglass.device import Device

DEG = math.pi / 180.0
DEG_H = DEG / 3600.0
PLAY_DEGC, ROCKING_HZ, LOGARITHM, CREEP, BACK, KNEE_FS, INNER = 8.0, 7.3, 50.0, 0.15, 0.25, 0.7, 0.2  # numbers of the generator's forms


@dataclass(frozen=True)
class Day:
    """What a strength may hang on beside itself. unit: the fields that were drawn, by dotted name"""

    sheet: Sheet
    unit: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def described(self) -> Device:
        return devices.load(self.sheet.device)

    @cached_property
    def duration_s(self) -> float:
        return self.sheet.case().scenario.duration_s

    @property
    def late_s(self) -> float:
        """A milliradian of the carrier."""
        return 1e-3 / (2.0 * math.pi * self.described.resonator.frequency_hz)

    @property
    def inner_s(self) -> float:
        """The node within the shell follows it so late."""
        return INNER * self.unit.get("thermal.shell_time_constant_s", self.described.thermal.shell_time_constant_s)

    @property
    def noise_fs(self) -> float:
        """Of this unit's converters, rms."""
        snr_db = self.unit.get("electronics.adc.snr_db", self.described.electronics.adc.snr_db)
        return math.sqrt(0.5) * 10.0 ** (-snr_db / 20.0) * self.sheet.noise_factor if snr_db else 0.0


@dataclass(frozen=True)
class Same:
    """parameter: of the catalogue; value: in its unit, of (strength, day); either_sign: a quarter turn of its axis, half a period, or a bias that is there all the time, turns the sign"""

    parameter: str
    value: Callable[[float, Day], float]
    either_sign: bool = False


def _times(parameter: str, factor: float = 1.0, either_sign: bool = False) -> Same:
    return Same(parameter, lambda strength, day: factor * strength, either_sign)


def _is(parameter: str, value: Callable[[Day], float]) -> Same:
    return Same(parameter, lambda strength, day: value(day))


def _clipped() -> Same:
    return Same("loss_fs", lambda strength, day: 1.0 - day.described.firmware.amplitude_fs * (1.0 - strength))


SAME: dict[tuple[str, str], tuple[Same, ...]] = {
    ("frequency_temperature", "slope"): (_times("slope_ppm_per_degc"),),
    ("frequency_temperature", "curvature"): (_times("curvature_ppm_per_degc2"),),
    ("amplitude_frequency", "duffing"): (_times("frequency_ppm"),),
    ("amplitude_frequency", "drive_mode_only"): (_times("frequency_ppm"),),
    ("amplitude_damping", "square"): (_times("damping"),),
    ("damping_step", "step"): (_times("damping"),),
    ("damping_step", "creep"): (_times("damping"), _is("creep_s", lambda day: CREEP * day.duration_s)),
    ("damping_step", "there_and_back"): (_times("damping"), _is("lasts_s", lambda day: BACK * day.duration_s)),
    ("frequency_split", "constant"): (_times("split_hz", either_sign=True),),
    ("frequency_split", "secondary_only"): (_times("split_hz", either_sign=True),),
    ("frequency_split", "thermal"): (_times("slope_hz_per_degc", either_sign=True),),
    ("damping_mismatch", "symmetric"): (_times("mismatch", either_sign=True),),
    ("damping_mismatch", "secondary_only"): (Same("mismatch", lambda strength, day: strength / (1.0 + 0.5 * strength), either_sign=True),),
    ("cross_damping", "constant"): (_times("c0_rad_s", DEG_H),),
    ("cross_damping", "slope"): (_times("c1_rad_s_per_degc", DEG_H),),
    ("cross_stiffness", "constant"): (_times("c0_rad_s", DEG),),
    ("cross_stiffness", "slope"): (_times("c1_rad_s_per_degc", DEG),),
    ("coriolis_gain", "constant"): (_times("gain"),),
    ("coriolis_gain", "slope"): (_times("slope_per_degc"),),
    ("coriolis_gain", "cubic"): (_times("cubic_s2_rad2"),),
    ("thermal_gradient", "derivative"): (_times("bias_rad_s_per_degc_s", DEG_H),),
    ("thermal_gradient", "mount"): (Same("bias_rad_s_per_degc_s", lambda strength, day: DEG_H * strength * day.inner_s), _is("settles_s", lambda day: day.inner_s)),
    ("thermal_hysteresis", "play"): (_times("bias_rad_s", -DEG_H), _is("half_width_degc", lambda day: PLAY_DEGC)),
    ("ageing", "linear"): (Same("linear_rad_s_per_h", lambda strength, day: DEG_H * strength * 3600.0 / day.duration_s),),
    ("ageing", "logarithmic"): (_times("logarithmic_rad_s", DEG_H / math.log1p(LOGARITHM)), _is("time_constant_s", lambda day: day.duration_s / LOGARITHM)),
    ("drive_misalignment", "constant"): (_times("angle_rad", 1e-3),),
    ("drive_misalignment", "thermal"): (_times("slope_rad_per_degc", 1e-3),),
    ("actuator_gain", "slope"): (_times("slope_per_degc"),),
    ("actuator_gain", "curvature"): (_times("curvature_per_degc2"),),
    ("drive_phase", "delay"): (Same("delay_s", lambda strength, day: abs(strength) * day.late_s),),
    ("drive_phase", "pickoffs"): (Same("delay_s", lambda strength, day: strength * day.late_s),),
    ("pickoff_gain", "constant"): (_times("gain"),),
    ("pickoff_gain", "slope"): (_times("slope_per_degc"),),
    ("pickoff_phase", "constant"): (Same("delay_s", lambda strength, day: strength * day.late_s),),
    ("pickoff_phase", "slope"): (Same("slope_s_per_degc", lambda strength, day: strength * day.late_s),),
    ("drive_feedthrough", "resistive"): (_times("leak", 1e-6),),
    ("drive_feedthrough", "thermal"): (_times("slope_per_degc", 1e-6),),
    ("drive_feedthrough", "capacitive"): (_times("edge", 1e-6),),
    ("adc_nonlinearity", "cubic"): (_times("cubic"),),
    ("adc_nonlinearity", "step"): (_times("half_step_fs"),),
    ("adc_nonlinearity", "zero_step"): (_times("sign_step_fs"),),
    ("adc_nonlinearity", "sawtooth"): (_times("teeth_fs"),),
    ("adc_saturation", "hard"): (_clipped(),),
    ("adc_saturation", "one_sided"): (_clipped(),),
    ("adc_saturation", "soft"): (_is("loss_fs", lambda day: 1.0 - KNEE_FS),),
    ("excess_noise", "white"): (Same("secondary_fs", lambda strength, day: strength * day.noise_fs),),
    ("excess_noise", "both"): (Same("primary_fs", lambda strength, day: strength * day.noise_fs), Same("secondary_fs", lambda strength, day: strength * day.noise_fs)),
    ("flicker_noise", "flicker"): (_times("bias_rad_s", DEG_H),),
    ("clock_error", "constant"): (_times("error_ppm"),),
    ("clock_jitter", "white"): (_times("jitter_s", 1e-9),),
    ("thermometer_lag", "one_pole"): (_times("lag_s"),),
    ("thermometer_error", "offset"): (_times("offset_degc"),),
    ("thermometer_error", "gain"): (_times("gain"),),
    ("thermometer_quantisation", "steps"): (_times("step_degc"),),
    ("thermometer_quantisation", "sticking_steps"): (_times("step_degc"),),
    ("vibration", "rectified"): (_times("rectified_rad_s", DEG_H, either_sign=True),),
    ("vibration", "rocking"): (_times("rate_rad_s", DEG, either_sign=True), _is("frequency_hz", lambda day: ROCKING_HZ)),
    ("interference", "near_carrier"): (_times("amplitude_fs", 1e-6),),
    ("rate_reference", "scale"): (Same("scale", lambda strength, day: 1.0 / (1.0 + strength) - 1.0),),
    ("rate_reference", "offset"): (_times("offset_rad_s", -DEG_H),),
    ("rate_reference", "earth"): (_times("offset_rad_s", DEG_H),),
    ("firmware_mismatch", "other_scale"): (_times("scale"),),
}

_CURVE = "another curve: what a fit of the catalogue's calls its size hangs on where it was measured"
_PLACE = "acts at another place than the catalogue's"
WITHOUT: dict[tuple[str, str], str] = {
    **dict.fromkeys((("frequency_temperature", "sigmoid"), ("damping_temperature", "thermoelastic"), ("amplitude_frequency", "quartic"),
                     ("amplitude_damping", "linear"), ("amplitude_damping", "quartic"), ("damping_step", "leak"),
                     ("frequency_split", "thermal_curved"), ("cross_damping", "bump"), ("cross_damping", "sigmoid"), ("cross_stiffness", "curvature"),
                     ("coriolis_gain", "saturating"), ("thermal_gradient", "distributed"),
                     ("thermal_hysteresis", "prandtl_ishlinskii"), ("thermal_hysteresis", "preisach"), ("ageing", "exponential"),
                     ("drive_misalignment", "curved"), ("actuator_gain", "sigmoid"), ("drive_phase", "amplifier_pole"), ("pickoff_gain", "curvature"),
                     ("pickoff_phase", "pole"), ("thermometer_lag", "two_poles"), ("thermometer_lag", "diffusion"), ("thermometer_error", "curvature")), _CURVE),
    **dict.fromkeys((("damping_temperature", "slope"), ("damping_temperature", "curvature")), "1/Q follows the polynomial here, Q in the catalogue"),
    ("damping_mismatch", "thermal"): "of mode 2 alone: the mean damping follows, too, which the catalogue's does not",
    **dict.fromkeys((("excess_noise", "thermal"), ("excess_noise", "lost_bits"), ("flicker_noise", "wander"), ("clock_jitter", "bandlimited"),
                     ("clock_jitter", "periodic")), "another spectrum or course of the noise"),
    ("flicker_noise", "phase"): _PLACE,
    ("clock_error", "thermal"): "follows the electronics' temperature, the catalogue's the shell's",
    ("clock_error", "ageing"): _CURVE,
    **dict.fromkeys((("dropped_samples", "lost"), ("dropped_samples", "doubled"), ("dropped_samples", "stale"), ("dropped_samples", "bursts")),
                    "at random times, the catalogue's at equal distances"),
    **dict.fromkeys((("rate_reference", "misalignment"), ("interference", "drifting")), "not the same all day"),
    **dict.fromkeys((("vibration", "near_carrier"), ("interference", "alias"), ("firmware_mismatch", "scaled_output"), ("firmware_mismatch", "shifted_output"),
                     ("firmware_mismatch", "other_bias")), _PLACE),
}


def covered(effect: Effect, found: list[dict[str, Any]], day: Day) -> Iterator[tuple[str, bool]]:
    """(effect and parameter, does the interval hold the truth?) where the diagnosis named the effect with that parameter."""
    same = {one.parameter: one for one in SAME.get((effect.id, effect.variant), ())}
    for one in found:
        for parameter in one["parameters"] if one["id"] == effect.id else ():
            if parameter["name"] in same and parameter["interval"] is not None:
                yield f"{effect.id}.{parameter['name']}", _holds(parameter["interval"], same[parameter["name"]], effect.strength, day)


def _holds(interval: list[float], same: Same, strength: float, day: Day) -> bool:
    value = same.value(strength, day)
    return any(interval[0] <= one <= interval[1] for one in ((value, -value) if same.either_sign else (value,)))

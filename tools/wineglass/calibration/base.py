"""The calibration that the identification starts from, and the one that comes out of it. The only place that knows both sides."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.polynomial import Polynomial

from wineglass import calibration_block, device
from wineglass.atomic import write_bytes, write_text
from wineglass.calibration.identify import MAX_ORDER, Identified
from wineglass.calibration_block import Calibration
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.recording import Recording

FALLBACK_DEVICE = "metal"
BESSEL4_DELAY_RAD = 2.1139  # fourth-order Bessel: delay of slow signals times the angular frequency of the -3 dB corner


@dataclass(frozen=True)
class Base:
    """calibration: what all other fields are taken from. source: where it comes from, for people.

    described: the recording or the user says what device this is; otherwise only the shape of the block is borrowed.
    """

    calibration: Calibration
    source: str
    described: bool

    @property
    def reference_temperature_degc(self) -> float:
        return self.calibration.reference_temperature_degc if self.described else 25.0

    def tau_s(self, temperature_degc: np.ndarray) -> np.ndarray:
        """Time constant [s] of the open loop at each temperature (n,)."""
        return 1.0 / np.maximum(self._law(self.calibration.decay_rate_per_s, temperature_degc), 1e-9)

    def gain(self, temperature_degc: np.ndarray) -> np.ndarray:
        """Scale factor [rad/s per unit of ratio] that the firmware applies at each temperature (n,)."""
        return self._law(self.calibration.scale_rad_s_per_ratio, temperature_degc)

    @property
    def delay_s(self) -> float:
        """Delay of the output filter for slow signals: fourth-order Bessel (firmware/core/output_filter.h), corner at -3 dB."""
        name = self.calibration.output_filter
        if name == "none":
            return 0.0
        corner_hz = float(name) * self.calibration.slow_rate_hz
        return BESSEL4_DELAY_RAD / (2.0 * np.pi * corner_hz)

    def _law(self, coefficients: list[float], temperature_degc: np.ndarray) -> np.ndarray:
        return Polynomial(coefficients)(temperature_degc - self.calibration.reference_temperature_degc)


def find_base(recording: Recording, base_path: Path | None, device_name: str | None) -> Base:
    """--base, else --device, else what the recording carries, else the shape of a shipped device."""
    if base_path is not None:
        return Base(calibration_block.read_json(base_path), str(base_path), True)
    if device_name is not None:
        return Base(nominal_calibration(device.load(device_name)), f"device {device_name}", True)
    if recording.calibration_block:
        where = f"{recording.path}, calibration_block"
        return Base(calibration_block.from_binary(recording.calibration_block, where), "calibration in the recording", True)
    if recording.calibration_json:
        where = f"{recording.path}, calibration_json"
        return Base(calibration_block.from_json(recording.calibration_json, where), "calibration in the recording", True)
    if recording.device_toml:
        described = device.loads(recording.device_toml, f"{recording.path}, device_toml")
        return Base(nominal_calibration(described), "device in the recording", True)
    return Base(nominal_calibration(device.load(FALLBACK_DEVICE)), f"device {FALLBACK_DEVICE} (assumed)", False)


def nominal_calibration(described: Device) -> Calibration:
    """What a perfect laboratory would find on the described device."""
    from wineglass import nominal
    from wineglass.scenario import Scenario, prepare

    return nominal.calibration(prepare(Scenario(), described))


def calibrated(base: Base, found: Identified, add_to_base: bool) -> Calibration:
    """The base with what was identified. add_to_base: the recording showed what the base's own bias left over."""
    bias = _shifted(found.bias_rad_s, found.reference_temperature_degc, base.calibration.reference_temperature_degc)
    if add_to_base:
        bias = _sum(bias, np.array(base.calibration.bias_rad_s))
    changes = {
        "bias_rad_s": bias.tolist(),
        "temperature_min_degc": found.temperature_min_degc,
        "temperature_max_degc": found.temperature_max_degc,
        "sequence": base.calibration.sequence + 1,
        **({} if base.described else {"device_name": "", "serial": 0}),
        "created_unix_s": int(time.time()),
    }
    if found.order and not found.temperature_min_degc < found.temperature_max_degc:
        raise BadInput("the recording has a single temperature", f"channel {found.channel}", "record a sweep")
    if found.order == 0:
        del changes["temperature_min_degc"], changes["temperature_max_degc"]
    if found.scale is not None:
        scale = _scale(base, found)
        changes["scale_rad_s_per_ratio"] = scale.tolist()
        changes["pickoff_gain_ratio"] = _pickoff_gain_ratio(base, float(scale[0]))
    checked = base.calibration.with_changes(**changes)
    calibration_block.to_binary(checked)
    return checked


def _scale(base: Base, found: Identified) -> np.ndarray:
    """Scale-factor polynomial; a correction is multiplied with the present one and cut to the firmware's order by a fit."""
    reference = base.calibration.reference_temperature_degc
    scale = _shifted(found.scale, found.reference_temperature_degc, reference)
    if found.scale_is_ratio:
        return scale
    product = Polynomial(scale) * Polynomial(base.calibration.scale_rad_s_per_ratio)
    if product.degree() <= MAX_ORDER:
        return product.coef
    shift = np.linspace(found.temperature_min_degc, found.temperature_max_degc, 200) - reference
    return Polynomial.fit(shift, product(shift), MAX_ORDER).convert().coef


def _pickoff_gain_ratio(base: Base, scale_rad_s_per_ratio: float) -> float:
    """What the secondary pickoff shows of the rate against the ideal 2 zeta2 k2 / g: its gain, and what a detuned secondary mode loses. The
    decoupling filter computes the ideal amplitude, so it needs the same factor. At the calibration temperature."""
    return 2.0 * base.calibration.decay_rate_per_s[0] / (base.calibration.angular_gain * scale_rad_s_per_ratio)


def _shifted(coefficients: np.ndarray, from_degc: float, to_degc: float) -> np.ndarray:
    """The same polynomial about another calibration temperature."""
    return Polynomial(coefficients)(Polynomial([to_degc - from_degc, 1.0])).coef if from_degc != to_degc else coefficients


def _sum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (Polynomial(a) + Polynomial(b)).coef


def write(calibration: Calibration, target: Path) -> None:
    """NAME.json: SI values with units; NAME.bin: the block as the firmware loads it."""
    if target.suffix == ".bin":
        write_bytes(target, calibration_block.to_binary(calibration))
    elif target.suffix == ".json":
        write_text(target, calibration_block.to_json(calibration))
    else:
        raise BadInput("unknown kind of file", target, "end the name in .json (values with units) or .bin (block for the firmware)")

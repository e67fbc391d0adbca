"""Device descriptions: what a gyro nominally is, in a readable TOML file, every field with unit, default and meaning.

A file may say `extends = "metal"` and give only what differs. Temperatures are in degC; laws over temperature use the shift from
`resonator.reference_temperature_degc`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from wineglass import paths, toml_text
from wineglass.effect_table import EffectTable
from wineglass.effects import Setting
from wineglass.errors import BadInput
from wineglass.fields import Section, quantity, validate

FOLDER = paths.repository_root() / "devices"


class Resonator(Section):
    """The vibrating shell: two modes, their coupling, and what temperature does to them."""

    reference_temperature_degc: float = quantity(25.0, "degC", "T0: polynomials and slopes count from here", ge=-100, le=200)
    frequency_hz: float = quantity(5000.0, "Hz", "mean of the two resonance frequencies at T0", ge=100, le=100e3)
    frequency_slope_ppm_per_degc: float = quantity(0.0, "ppm/degC", "slope of the frequency over temperature", ge=-500, le=500)
    frequency_curvature_ppm_per_degc2: float = quantity(0.0, "ppm/degC^2", "curvature of the same", ge=-5, le=5)
    q: float = quantity(1e4, "1", "quality factor at T0 (decay time Q/(pi f))", gt=1, le=1e8)
    q_slope_per_degc: float = quantity(0.0, "1/degC", "relative slope of Q over temperature, below the knee", ge=-0.01, le=0.01)
    q_knee_degc: float = quantity(200.0, "degC", "temperature (not shift) at which the slope of Q changes", ge=-100, le=300)
    q_slope_above_knee_per_degc: float = quantity(0.0, "1/degC", "relative slope of Q above the knee, of Q at T0", ge=-0.01, le=0.01)
    split_hz: float = quantity(0.0, "Hz", "frequency split of the two modes", ge=0, le=100)
    split_axis_deg: float = quantity(0.0, "deg", "axis of the split, angle in mode space (1 mode: 0, equal mix: 45)", ge=-90, le=90)
    damping_mismatch: float = quantity(0.0, "1", "relative difference of the two dampings; its cross part is in cross_damping_rad_s",
                                       ge=0, le=1)
    damping_axis_deg: float = quantity(0.0, "deg", "axis of the damping mismatch, angle in mode space", ge=-90, le=90)
    cross_damping_rad_s: list[float] = quantity(
        [0.0], "rad/s per degC^i", "total cross damping as a rate, 2 k zeta12 / g, polynomial in the shift from T0",
        min_length=1, max_length=6)
    quadrature_rad_s: float = quantity(0.0, "rad/s", "cross stiffness beside the split's, as the rate it looks like", ge=-10, le=10)
    angular_gain: float = quantity(2.0, "1", "g: Coriolis force g W v on the other mode", gt=0, le=2)

    def frequency_at(self, temperature_degc: np.ndarray | float) -> Any:
        """Resonance frequency [Hz] at the shell temperature [degC], any shape."""
        shift = np.asarray(temperature_degc) - self.reference_temperature_degc
        ppm = self.frequency_slope_ppm_per_degc * shift + self.frequency_curvature_ppm_per_degc2 * shift**2
        return self.frequency_hz * (1.0 + 1e-6 * ppm)

    def q_at(self, temperature_degc: np.ndarray | float) -> Any:
        """Quality factor at the shell temperature [degC], any shape."""
        temperature = np.asarray(temperature_degc)
        below = np.minimum(temperature, self.q_knee_degc) - self.reference_temperature_degc
        above = np.maximum(temperature - self.q_knee_degc, 0.0)
        return self.q * (1.0 + self.q_slope_per_degc * below + self.q_slope_above_knee_per_degc * above)

    def decay_rate_at(self, temperature_degc: np.ndarray | float) -> Any:
        """Decay rate zeta k = pi f / Q [1/s] of the amplitude, mean of both modes, any shape."""
        return np.pi * self.frequency_at(temperature_degc) / self.q_at(temperature_degc)

    def secondary_decay_rate_at(self, temperature_degc: np.ndarray | float) -> Any:
        """Decay rate zeta2 k2 [1/s] of the secondary mode, any shape."""
        unequal = 0.5 * self.damping_mismatch * math.cos(2.0 * math.radians(self.damping_axis_deg))
        return self.decay_rate_at(temperature_degc) * (1.0 - unequal)

    def cross_damping_at(self, temperature_degc: np.ndarray | float) -> Any:
        """Cross damping as a rate [rad/s], any shape."""
        shift = np.asarray(temperature_degc) - self.reference_temperature_degc
        return np.polynomial.polynomial.polyval(shift, self.cross_damping_rad_s)

    def cross_damping_limit_at(self, temperature_degc: np.ndarray | float) -> Any:
        """|cross damping| [rad/s] beyond which the shell would feed energy into itself: zeta12^2 <= zeta1 zeta2."""
        unequal = 0.5 * self.damping_mismatch * math.cos(2.0 * math.radians(self.damping_axis_deg))
        return 2.0 * self.decay_rate_at(temperature_degc) / self.angular_gain * math.sqrt(max(0.0, 1.0 - unequal**2))


class Thermal(Section):
    """Chamber -> shell -> thermometer, one-pole lags."""

    shell_time_constant_s: float = quantity(60.0, "s", "shell follows the chamber with this lag", ge=0, le=1e5)
    thermometer_lag_s: float = quantity(0.0, "s", "thermometer follows the shell with this lag", ge=0, le=1e5)
    protocol_unit: float = quantity(1.0, "1", "unit of time of bench protocols, of the shell's time constant", ge=0.01, le=100)
    temperature_min_degc: float = quantity(-45.0, "degC", "least temperature of the device; calibration holds from here ...", ge=-100, le=200)
    temperature_max_degc: float = quantity(85.0, "degC", "... to here", ge=-100, le=200)


class Adc(Section):
    """Both pickoff converters. Full scale (FS) is +-1 of the displacement's unit."""

    bits: int = quantity(16, "bit", "resolution; 32 with snr_db = 0 (noise off) switches the quantiser off", ge=8, le=32)
    snr_db: float = quantity(90.0, "dB", "full-scale sine over the noise in half the sample rate; 0: no noise", ge=0, le=200)
    primary_offset_fs: float = quantity(0.0, "FS", "offset of the primary channel", ge=-0.1, le=0.1)
    secondary_offset_fs: float = quantity(0.0, "FS", "offset of the secondary channel", ge=-0.1, le=0.1)
    delay_samples: float = quantity(0.0, "sample", "conversion delay of both channels", ge=0, le=24)
    secondary_delay_samples: float = quantity(0.0, "sample", "what the secondary channel is later than the primary", ge=0, le=24)

    @property
    def noise_fs_rms(self) -> float:
        """Noise [FS rms] per sample."""
        return 0.0 if self.snr_db == 0 else math.sqrt(0.5) * 10.0 ** (-self.snr_db / 20.0)


class Dac(Section):
    """Both force converters. A code computed at sample n acts during [n + latency, n + latency + 1)."""

    bits: int = quantity(16, "bit", "resolution", ge=8, le=32)
    latency_samples: int = quantity(1, "sample", "from the pickoff sample to the start of its force", ge=0, le=24)
    drive_reach: float = quantity(2.0, "1", "full drive force over the force that holds the amplitude at T0", ge=1.1, le=100)
    rebalance_reach: float = quantity(2.6, "1", "full rebalance force over the same holding force", gt=0, le=100)


class Thermometer(Section):
    """The temperature sensor: code = round((temperature - zero) / lsb)."""

    lsb_degc: float = quantity(1 / 128, "degC", "one code", ge=2.0**-20, le=2.0**-6)
    zero_degc: float = quantity(0.0, "degC", "temperature of code 0", ge=-300, le=300)
    noise_degc: float = quantity(0.0, "degC", "rms noise of one reading", ge=0, le=10)


class Electronics(Section):
    """Converters, clock and thermometer."""

    sample_rate_hz: float = quantity(50e3, "Hz", "ADC and DAC sample rate", ge=33e3, le=1e6)
    adc: Adc = Field(default_factory=Adc)
    dac: Dac = Field(default_factory=Dac)
    thermometer: Thermometer = Field(default_factory=Thermometer)


class Firmware(Section):
    """How the signal processor is set up for this device."""

    decimation: int = quantity(10, "sample", "samples per loop tick", ge=8, le=32)
    loops_per_slow: int = quantity(5, "loop tick", "loop ticks per slow tick (temperature, retuning, rate)", ge=1, le=64)
    amplitude_fs: float = quantity(0.9, "FS", "set-point of the primary amplitude", gt=0.05, le=0.98)
    pll_bandwidth_hz: float = quantity(40.0, "Hz", "bandwidth of the drive loop's phase", ge=1, le=200)
    agc_bandwidth_hz: float = quantity(5.0, "Hz", "bandwidth of the amplitude control", ge=0.01, le=50)
    rebalance_bandwidth_hz: float = quantity(100.0, "Hz", "design bandwidth of force-to-rebalance; delay makes the closed loop faster", ge=1, le=300)
    rebalance_in_phase_limit_fs: float = quantity(0.9, "FS", "largest in-phase rebalance force: the range", gt=0, le=0.9999)
    rebalance_quadrature_limit_fs: float = quantity(0.43, "FS", "largest quadrature force; squares of both limits sum to 0.9998", ge=0, le=0.9999)
    search_fraction: float = quantity(0.012, "1", "cold start looks for the resonance within +- this of nominal", gt=0, le=0.05)


class Tolerance(Section):
    """How far a nominal value may be off (one standard deviation): absolute in the field's unit, or relative to its value."""

    absolute: float | list[float] | None = Field(None, description="standard deviation in the field's unit; a list for a polynomial")
    relative: float | None = Field(None, description="standard deviation over the nominal value", gt=0, le=1)
    why: str = Field(..., description="where the figure comes from", min_length=3)

    @model_validator(mode="after")
    def _one_of_both(self) -> Tolerance:
        if (self.absolute is None) == (self.relative is None):
            raise ValueError("give either absolute or relative")
        return self


class NoiseFloor(Section):
    """Noise that a healthy device shows beside its converters' own."""

    rate_bias_instability_rad_s: float = quantity(2.4e-7, "rad/s", "flicker floor of the rate output", ge=0, le=1)
    rate_random_walk_rad_s_per_rt_hz: float = quantity(0.0, "rad/s/sqrt(Hz)", "white rate noise beyond the converters'", ge=0, le=1)
    temperature_degc: float = quantity(0.002, "degC", "unexplained wander of the thermometer", ge=0, le=10)
    frequency_ppm: float = quantity(0.002, "ppm", "wander of the resonance at constant temperature", ge=0, le=100)
    drive_level_relative: float = quantity(1e-5, "1", "wander of the drive level at constant temperature", ge=0, le=1)


class Device(Section):
    """One gyro. `name` is at most 16 characters, as it is kept in the calibration block."""

    name: str = Field(..., description="short name", min_length=1, max_length=16, pattern=r"^[a-z0-9][a-z0-9_-]*$",
                      json_schema_extra={"unit": ""})
    description: str = quantity("", "", "what this device is")
    resonator: Resonator = Field(default_factory=Resonator)
    thermal: Thermal = Field(default_factory=Thermal)
    electronics: Electronics = Field(default_factory=Electronics)
    firmware: Firmware = Field(default_factory=Firmware)
    tolerance: dict[str, Tolerance] = Field(default_factory=dict, description="which nominal values are uncertain, and how much",
                                            json_schema_extra={"unit": ""})
    noise_floor: NoiseFloor = Field(default_factory=NoiseFloor)
    effect: list[EffectTable] = quantity([], "tables", "in which ways of the catalogue it differs from its nominal fields: id and parameters; "
                                         "the nominal calibration does not know of them")

    @property
    def effects(self) -> list[Setting]:
        """What the twins switch on beside the fields."""
        return [table.setting for table in self.effect]

    @property
    def slow_rate_hz(self) -> float:
        """Rate of the slow ticks: temperature, retuning, rate output."""
        return self.electronics.sample_rate_hz / (self.firmware.decimation * self.firmware.loops_per_slow)

    @property
    def block_samples(self) -> int:
        """Samples of one slow tick, the block in which the twin holds its parameters."""
        return self.firmware.decimation * self.firmware.loops_per_slow

    @property
    def holding_acceleration_fs_s2(self) -> float:
        """Force per modal mass [FS/s^2] that holds the amplitude at T0: A 2 zeta k^2."""
        resonator = self.resonator
        return self.firmware.amplitude_fs * (2.0 * math.pi * resonator.frequency_hz) ** 2 / resonator.q

    def calibration_range_degc(self) -> tuple[float, float]:
        return self.thermal.temperature_min_degc, self.thermal.temperature_max_degc

    def to_toml(self) -> str:
        """Complete description, nothing inherited and no default left out."""
        return toml_text.dumps(self.model_dump(mode="json"))

    def override(self, dotted: dict[str, Any], source: str = "override") -> Device:
        """The same device with some fields changed: {"resonator.split_hz": 0.005}."""
        if not dotted:
            return self
        return parse(toml_text.merge(self.model_dump(mode="json", exclude_none=True), toml_text.nested(dotted)), source)


def names() -> list[str]:
    """Names of the devices that ship."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load(name_or_path: str | Path, beside: Path | None = None) -> Device:
    """A shipped device by its name, or a description by its path (relative to `beside`, or to the present folder)."""
    path = find(name_or_path, beside)
    return parse(_inherited(path, []), str(path))


def loads(text: str, source: str = "device description") -> Device:
    """A device from TOML text, as recordings carry it."""
    data = toml_text.loads(text, source)
    if "extends" in data:
        data = toml_text.merge(_inherited(find(_parent(data, source)), []), _without_parent(data))
    return parse(data, source)


def find(name_or_path: str | Path, beside: Path | None = None) -> Path:
    text = str(name_or_path)
    if not text.endswith(".toml"):
        path = FOLDER / f"{text}.toml"
        if not path.is_file():
            raise BadInput(f"no device '{text}'", str(FOLDER), f"choose one of {', '.join(names())}, or give the path of a .toml file")
        return path
    candidates = [Path(text)] if beside is None else [beside / text, Path(text)]
    for path in candidates:
        if path.is_file():
            return path
    raise BadInput("no such device file", str(candidates[0]), f"give an existing .toml file or one of {', '.join(names())}")


def parse(data: dict[str, Any], source: str) -> Device:
    """Schema first, then what no schema can say."""
    device: Device = validate(Device, data, source)
    _check_temperatures(device, source)
    _check_resonator(device, source)
    _check_rates(device, source)
    _check_tolerances(device, source)
    return device


def _inherited(path: Path, descendants: list[Path]) -> dict[str, Any]:
    data = toml_text.read(path)
    if "extends" not in data:
        return data
    if path.resolve() in descendants:
        raise BadInput("extends itself", str(path), "break the circle of 'extends'")
    parent = find(_parent(data, str(path)), beside=path.parent)
    return toml_text.merge(_inherited(parent, [*descendants, path.resolve()]), _without_parent(data))


def _parent(data: dict[str, Any], source: str) -> str:
    if not isinstance(data["extends"], str):
        raise BadInput("'extends' is not a text", source, "give the name of a device or the path of a .toml file")
    return data["extends"]


def _without_parent(data: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in data.items() if key != "extends"}


def _check_temperatures(device: Device, source: str) -> None:
    low, high = device.calibration_range_degc()
    reference = device.resonator.reference_temperature_degc
    if not low < reference < high:
        raise BadInput(f"T0 = {reference:g} degC is outside the temperature range {low:g} to {high:g} degC",
                       f"{source}, thermal", "widen temperature_min_degc and temperature_max_degc")
    if max(reference - low, high - reference) > 127.0:
        raise BadInput("the temperature range reaches more than 127 degC from T0, beyond what the firmware's polynomials hold",
                       f"{source}, thermal", "narrow temperature_min_degc and temperature_max_degc")


def _check_resonator(device: Device, source: str) -> None:
    resonator = device.resonator
    temperature = np.linspace(*device.calibration_range_degc(), 1001)
    q = resonator.q_at(temperature)
    if np.min(q) < 2.0:
        raise BadInput(f"Q falls to {np.min(q):.3g} at {temperature[np.argmin(q)]:.0f} degC",
                       f"{source}, resonator.q_slope_per_degc", "use a smaller slope of Q or a narrower temperature range")
    excess = np.abs(resonator.cross_damping_at(temperature)) - resonator.cross_damping_limit_at(temperature)
    worst = int(np.argmax(excess))
    if excess[worst] > 0:
        limit = resonator.cross_damping_limit_at(temperature[worst])
        raise BadInput(f"|cross damping| exceeds {limit:.3g} rad/s at {temperature[worst]:.0f} degC: the shell would feed itself with energy "
                       "(zeta12^2 > zeta1 zeta2)", f"{source}, resonator.cross_damping_rad_s", "check the coefficients and their unit, rad/s")


def _check_rates(device: Device, source: str) -> None:
    electronics, firmware = device.electronics, device.firmware
    ratio = device.resonator.frequency_hz / electronics.sample_rate_hz
    if not 0.02 <= ratio <= 0.4:
        raise BadInput(f"the resonance is {ratio:.3g} of the sample rate, not within 0.02 to 0.4",
                       f"{source}, electronics.sample_rate_hz", "choose a sample rate of about ten times the resonance")
    samples = device.block_samples
    if (electronics.sample_rate_hz / samples) % 1.0:
        raise BadInput(f"{electronics.sample_rate_hz:g} Hz over {samples} samples is not a whole number of slow ticks a second",
                       f"{source}, firmware", "choose decimation and loops_per_slow so that their product divides the sample rate")
    if math.hypot(firmware.rebalance_in_phase_limit_fs, firmware.rebalance_quadrature_limit_fs) > 0.9999:
        raise BadInput("both rebalance limits together exceed the DAC's full scale", f"{source}, firmware.rebalance_quadrature_limit_fs",
                       "keep the root of the sum of their squares below 0.9999")
    if firmware.pll_bandwidth_hz > electronics.sample_rate_hz / firmware.decimation / 20:
        raise BadInput(f"{firmware.pll_bandwidth_hz:g} Hz is too fast for the loop rate", f"{source}, firmware.pll_bandwidth_hz",
                       "stay below a twentieth of the loop rate")


def _check_tolerances(device: Device, source: str) -> None:
    for path, tolerance in device.tolerance.items():
        value: Any = device
        for part in path.split("."):
            value = getattr(value, part, None)
        if not isinstance(value, (int, float, list)) or isinstance(value, bool):
            raise BadInput(f"tolerance of '{path}', which is no number of this description", f"{source}, tolerance",
                           "name a field as in \"resonator.q\"")
        if isinstance(tolerance.absolute, list) != (isinstance(value, list) and tolerance.relative is None):
            raise BadInput("absolute tolerance and value differ in shape", f"{source}, tolerance.{path}",
                           "give a list for a polynomial and a number for a number")

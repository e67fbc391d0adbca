"""Calibration of one device: SI values (JSON, for people) and the integers the firmware reads (binary block).

    calibration = read_json("unit7.json")
    block = to_binary(calibration)
    assert to_binary(from_binary(block)) == block

docs/SPEC.md has the bytes. Floats become integers by rounding half to even; whatever does not fit its field is refused.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

from pydantic import field_validator, model_validator

from wineglass import fields, rebalance
from wineglass.errors import BadInput
from wineglass.fields import Section, quantity

FORMAT = "wineglass-calibration"
VERSION = 1
MAGIC = 0x42434757
BINARY_VERSION = 1
NAME_BYTES = 16
MAX_ORDER = 5
SPAN_DEGC = 128

LOOPS = ("open", "rebalance")
COMPENSATIONS = ("none", "static", "g2")
OUTPUT_FILTERS = ("none", "0.01", "0.025", "0.05", "0.1")

_U32 = 2**32 - 1
_AMPLITUDE_MAX_Q30 = 1052266988  # 0.98
_DRIVE_MAX_Q31 = 2147268900  # 0.9999
_POLYNOMIALS = {"bias_rad_s": 31, "scale_rad_s_per_ratio": 28, "rebalance_scale_rad_s_per_ratio": 28, "decay_rate_per_s": 22,
                "demodulation_phase_rad": 31, "drive_phase_rad": 31}


class Calibration(Section):
    """What the firmware knows about its device. Every field's unit is part of the JSON form.

    Polynomials are lists of 1 to 6 coefficients: value = sum c[i] (T - reference temperature)^i, T in degC.
    """

    device_name: str = quantity("", "", "name of the device, at most 16 ASCII characters")
    serial: int = quantity(0, "1", "serial number", ge=0, le=_U32)
    sequence: int = quantity(0, "1", "counts the calibrations of this device", ge=0, le=_U32)
    created_unix_s: int = quantity(0, "s", "when it was made, seconds since 1970", ge=0, lt=2**63)
    sample_rate_hz: float = quantity(..., "Hz", "ADC and DAC rate", ge=32769.0, le=_U32 / 1000)
    decimation: int = quantity(..., "1", "samples per loop tick", ge=8, le=32)
    loops_per_slow: int = quantity(..., "1", "loop ticks per slow tick", ge=1, le=64)
    reference_temperature_degc: float = quantity(..., "degC", "calibration temperature T0", ge=-273.15, le=1000.0)
    thermometer_code_at_reference: int = quantity(..., "LSB", "thermometer code at T0", ge=-(2**31), lt=2**31)
    thermometer_degc_per_lsb: float = quantity(..., "degC/LSB", "temperature per thermometer code", gt=0.0, lt=2.0**-5)
    temperature_min_degc: float = quantity(..., "degC", "lower end of the calibrated range")
    temperature_max_degc: float = quantity(..., "degC", "upper end of the calibrated range")
    bias_rad_s: list[float] = quantity(..., "rad/s/degC^i", "bias that cross damping causes")
    scale_rad_s_per_ratio: list[float] = quantity(..., "rad/s/degC^i", "rate per secondary over primary amplitude, open loop")
    rebalance_scale_rad_s_per_ratio: list[float] = quantity([0.0], "rad/s/degC^i", "rate per rebalance force over primary amplitude")
    decay_rate_per_s: list[float] = quantity(..., "1/s/degC^i", "decay rate of the secondary mode, zeta2 k2")
    demodulation_phase_rad: list[float] = quantity([0.0], "rad/degC^i", "by which the secondary pickoff lags the primary")
    drive_phase_rad: list[float] = quantity([0.0], "rad/degC^i", "by which both forces lag, beyond the loop delay")
    angular_gain: float = quantity(..., "1", "Coriolis coupling g", gt=0.0, le=4.0)
    pickoff_gain_ratio: float = quantity(1.0, "1", "secondary over primary pickoff gain", gt=0.0)
    nominal_frequency_hz: float = quantity(..., "Hz", "about this frequency the decoupling filter is tuned", gt=0.0)
    search_min_hz: float = quantity(..., "Hz", "the resonance lies above", gt=0.0)
    search_max_hz: float = quantity(..., "Hz", "the resonance lies below", gt=0.0)
    chirp_s: float = quantity(..., "s", "length of the first chirp, 2^n loop ticks", gt=0.0)
    settle_s: float = quantity(..., "s", "pause between chirp and listening", gt=0.0)
    listen_s: float = quantity(..., "s", "length of the listening, 2^n loop ticks", gt=0.0)
    audible_amplitude_fs: float = quantity(..., "FS", "least amplitude that counts as ringing", ge=2.0**-16, le=0.5)
    acquisition_attempts: int = quantity(3, "1", "chirps before starting at the band's centre", ge=0, le=6)
    pll_kp_per_s: float = quantity(..., "1/s", "phase loop, proportional", gt=0.0)
    pll_ki_per_s2: float = quantity(..., "1/s^2", "phase loop, integral", ge=0.0)
    agc_kp: float = quantity(..., "FS/FS", "amplitude loop, force per amplitude", gt=0.0, le=1000.0)
    agc_ki_per_s: float = quantity(..., "FS/FS/s", "amplitude loop, integral", ge=0.0)
    amplitude_set_point_fs: float = quantity(..., "FS", "amplitude of the primary, of ADC full scale", ge=1 / 32, le=_AMPLITUDE_MAX_Q30 / 2**30)
    drive_limit_fs: float = quantity(..., "FS", "largest drive force, of DAC full scale", gt=0.0,
                                    le=_DRIVE_MAX_Q31 / 2**31)
    rebalance_kp: float = quantity(0.0, "FS/FS", "rebalance loop, force per amplitude", ge=0.0, le=32000.0)
    rebalance_ki_per_s: float = quantity(0.0, "FS/FS/s", "rebalance loop, integral", ge=0.0)
    rebalance_in_phase_limit_fs: float = quantity(0.0, "FS", "largest in-phase rebalance force", ge=0.0, le=_DRIVE_MAX_Q31 / 2**31)
    rebalance_quadrature_limit_fs: float = quantity(0.0, "FS", "largest quadrature force", ge=0.0, le=_DRIVE_MAX_Q31 / 2**31)
    loop_delay_samples: float = quantity(..., "samples", "ADC delay, computation and DAC hold", ge=0.0, lt=64.0)
    lock_phase_limit_deg: float = quantity(..., "deg", "phase error within which the loop counts as locked", gt=0.0, le=90.0)
    lock_amplitude_limit: float = quantity(..., "1", "amplitude error within which it does, of the set-point", gt=0.0, le=0.51)
    lock_hold_s: float = quantity(..., "s", "time within limits before the loop counts as locked", gt=0.0)
    adc_limit_fs: float = quantity(..., "FS", "a pickoff beyond this counts as saturated", ge=0.5, lt=1.0)
    loop: Literal["open", "rebalance"] = quantity("open", "", "open loop or force-to-rebalance after start-up")
    compensation: Literal["none", "static", "g2"] = quantity("none", "", "bias compensation after start-up")
    output_filter: Literal["none", "0.01", "0.025", "0.05", "0.1"] = quantity(
        "none", "", "corner of the output filter, of the slow tick's rate")

    @field_validator("device_name")
    @classmethod
    def _name_fits(cls, name: str) -> str:
        if not (name.isascii() and name.isprintable() and len(name) <= NAME_BYTES):
            raise ValueError(f"at most {NAME_BYTES} printable ASCII characters fit")
        return name

    @field_validator(*_POLYNOMIALS)
    @classmethod
    def _order_fits(cls, coefficients: list[float]) -> list[float]:
        if not 1 <= len(coefficients) <= MAX_ORDER + 1:
            raise ValueError(f"1 to {MAX_ORDER + 1} coefficients fit, found {len(coefficients)}")
        return coefficients

    @model_validator(mode="after")
    def _ranges_make_sense(self) -> Calibration:
        if not self.temperature_min_degc < self.temperature_max_degc:
            raise ValueError("temperature_min_degc must lie below temperature_max_degc")
        if not self.search_min_hz < self.search_max_hz:
            raise ValueError("search_min_hz must lie below search_max_hz")
        if not self.sample_rate_hz / 256 <= min(self.search_min_hz, self.nominal_frequency_hz):
            raise ValueError("the frequencies must lie above 1/256 of the sample rate")
        if not max(self.search_max_hz, self.nominal_frequency_hz) < self.sample_rate_hz / 3:
            raise ValueError("the frequencies must lie below a third of the sample rate")
        if math.hypot(self.rebalance_in_phase_limit_fs, self.rebalance_quadrature_limit_fs) > 0.9999:
            raise ValueError("the root of the sum of the squares of both rebalance limits must not exceed 0.9999")
        usable = rebalance.is_described(self)
        if self.loop == "rebalance" and not usable:
            raise ValueError("loop rebalance needs rebalance_kp, rebalance_in_phase_limit_fs and a positive rebalance_scale_rad_s_per_ratio")
        if usable and not rebalance.is_accepted(rebalance.loop_of(self)):
            raise ValueError("rebalance_kp and rebalance_ki_per_s would make the rebalance loop unstable, or nearly so")
        return self

    @property
    def loop_rate_hz(self) -> float:
        return self.sample_rate_hz / self.decimation

    @property
    def slow_rate_hz(self) -> float:
        return self.loop_rate_hz / self.loops_per_slow

    def with_changes(self, **changes: Any) -> Calibration:
        """The same with other values, checked like new."""
        return make(self.model_dump() | changes)


def make(values: dict[str, Any], source: str = "calibration") -> Calibration:
    """A checked calibration; BadInput says what is wrong with which field."""
    return fields.validate(Calibration, values, source)


def output_filter_at(corner_hz: float, slow_rate_hz: float) -> str:
    """Name of the output filter with that corner frequency; 0 is none."""
    for name in OUTPUT_FILTERS[1:]:
        if math.isclose(float(name) * slow_rate_hz, corner_hz, rel_tol=1e-9):
            return name
    if corner_hz == 0.0:
        return "none"
    known = ", ".join(f"{float(name) * slow_rate_hz:g}" for name in OUTPUT_FILTERS[1:])
    raise BadInput(f"there is no output filter with a corner at {corner_hz:g} Hz", "output filter", f"take 0 (none), {known} Hz")


# ---- JSON ----------------------------------------------------------------------------------------------------------------


def to_json(calibration: Calibration) -> str:
    """Every field as {"value": ..., "unit": ...}; fields without a unit (names and choices) carry an empty one."""
    document: dict[str, Any] = {"format": FORMAT, "version": VERSION}
    for name in Calibration.model_fields:
        document[name] = {"value": getattr(calibration, name), "unit": fields.unit_of(Calibration, name)}
    return json.dumps(document, indent=2) + "\n"


def from_json(text: str, source: str = "calibration JSON") -> Calibration:
    """The checked calibration; BadInput for broken JSON, another format, missing or unknown fields, wrong units or values."""
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise BadInput(f"this is no JSON: {error.msg}", f"{source}, line {error.lineno}", "repair the file") from None
    if not isinstance(document, dict) or document.pop("format", None) != FORMAT:
        raise BadInput("this is no calibration", source, f'it must hold "format": "{FORMAT}"')
    version = document.pop("version", None)
    if version != VERSION:
        raise BadInput(f"version {version!r} of the format is unknown", source, f"this program reads version {VERSION}")
    return make({name: _value(name, entry, source) for name, entry in document.items()}, source)


def _value(name: str, entry: Any, source: str) -> Any:
    if name not in Calibration.model_fields:
        return entry  # refused by name
    unit = fields.unit_of(Calibration, name)
    if not isinstance(entry, dict) or entry.keys() != {"value", "unit"}:
        raise BadInput("a value with a unit is needed", f"{source}, {name}", f'write {{"value": ..., "unit": "{unit}"}}')
    if entry["unit"] != unit:
        raise BadInput(f"the unit is {entry['unit']!r}", f"{source}, {name}", f"give it in {unit or 'no unit'}")
    return entry["value"]


def read_json(path: str | Path) -> Calibration:
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise BadInput(f"cannot read the calibration: {reason}", path, "give the path of a calibration JSON file") from None
    return from_json(text, str(path))


# ---- binary --------------------------------------------------------------------------------------------------------------

_POLYNOMIAL_LAYOUT = [("{}_order", "I"), *((f"{{}}_{i}", "i") for i in range(MAX_ORDER + 1))]

LAYOUT: list[tuple[str, str]] = [
    ("magic", "I"), ("version", "H"), ("size", "H"), ("device_name", f"{NAME_BYTES}s"),
    ("serial", "I"), ("sequence", "I"), ("created_unix_s", "Q"),
    ("sample_rate_millihz", "I"), ("decimation", "I"), ("normalise_q31", "i"), ("loops_per_slow", "I"),
    ("reference_temperature_mdegc", "i"), ("thermometer_offset_raw", "i"), ("thermometer_gain_degc_q36", "i"),
    ("shift_min_q20", "i"), ("shift_max_q20", "i"),
    *((name.format(polynomial), code) for polynomial in _POLYNOMIALS for name, code in _POLYNOMIAL_LAYOUT),
    ("angular_gain_q24", "i"),
    ("center_freq_u64", "Q"), ("center_2cos_q40", "q"), ("center_cos_q31", "i"), ("center_sin_q31", "i"),
    ("sample_period_q46", "i"), ("coupling_gain_q44", "i"),
    ("search_min_u64", "Q"), ("search_max_u64", "Q"), ("chirp_ticks_log2", "I"), ("settle_ticks", "I"),
    ("listen_ticks_log2", "I"), ("audible_q30", "i"), ("acquisition_attempts", "I"),
    ("pll_proportional_q32", "I"), ("pll_integral_q32", "I"), ("agc_proportional_q16", "i"), ("agc_integral_q24", "i"),
    ("amplitude_q30", "i"), ("drive_max_q31", "i"),
    ("rebalance_proportional_q16", "i"), ("rebalance_integral_q24", "i"), ("rebalance_in_phase_limit_q31", "i"),
    ("rebalance_quadrature_limit_q31", "i"), ("loop_delay_samples_q16", "I"),
    ("phase_limit_i32", "i"), ("amplitude_limit_q30", "i"), ("hold_ticks", "I"), ("adc_limit_q31", "i"),
    ("loop", "I"), ("compensation", "I"), ("output_filter", "I"),
    ("crc", "I"),
]
_STRUCT = struct.Struct("<" + "".join(code for _, code in LAYOUT))
SIZE = _STRUCT.size

_RANGES = {
    "chirp_ticks_log2": (2, 16), "settle_ticks": (1, 65535), "listen_ticks_log2": (2, 12), "hold_ticks": (1, 1_000_000),
    "pll_proportional_q32": (1, 2**29), "pll_integral_q32": (0, 2**29), "agc_proportional_q16": (1, 1000 * 2**16),
    "agc_integral_q24": (0, 64 * 2**24), "rebalance_integral_q24": (0, 64 * 2**24), "coupling_gain_q44": (1, 2**31 - 1), "angular_gain_q24": (1, 4 * 2**24),
    "thermometer_gain_degc_q36": (1, 2**31 - 1), "shift_min_q20": (-(2**27), 2**27), "shift_max_q20": (-(2**27), 2**27),
    "phase_limit_i32": (1, 2**30), "amplitude_limit_q30": (1, 2**29), "drive_max_q31": (1, _DRIVE_MAX_Q31),
    "amplitude_q30": (2**25, _AMPLITUDE_MAX_Q30), "loop_delay_samples_q16": (0, 64 * 2**16 - 1),
}
_WIDTHS = {"i": (-(2**31), 2**31 - 1), "I": (0, _U32), "H": (0, 65535), "q": (-(2**63), 2**63 - 1), "Q": (0, 2**64 - 1)}


def to_binary(calibration: Calibration) -> bytes:
    """The block for the firmware; BadInput names the value that does not fit."""
    numbers: dict[str, Any] = integers(calibration)
    numbers |= {"magic": MAGIC, "version": BINARY_VERSION, "size": SIZE, "crc": 0,
                "device_name": calibration.device_name.encode("ascii").ljust(NAME_BYTES, b"\0")}
    body = _STRUCT.pack(*(numbers[name] for name, _ in LAYOUT))[:-4]
    return body + struct.pack("<I", zlib.crc32(body))


def integers(calibration: Calibration) -> dict[str, int]:
    """Every integer of the block by name, checked to fit."""
    numbers = {**_clock(calibration), **_temperature(calibration), **_polynomials(calibration), **_tuning(calibration),
               **_acquisition(calibration), **_loops(calibration), **_monitors(calibration)}
    numbers |= {"serial": calibration.serial, "sequence": calibration.sequence, "created_unix_s": calibration.created_unix_s}
    for name, code in LAYOUT:
        if name in numbers:
            _check(name, numbers[name], code)
    return numbers


def _check(name: str, number: int, code: str) -> None:
    low, high = _RANGES.get(name, _WIDTHS[code])
    if not low <= number <= high:
        raise BadInput(f"the value does not fit the firmware's field ({number} is not within {low} … {high})",
                       f"calibration, {name}", "correct the value it is computed from (docs/SPEC.md)")


def _fixed(value: float | Fraction, bits: int) -> int:
    """value 2^bits, rounded half to even."""
    return round(Fraction(value) * 2**bits)


def _floor(value: float, bits: int) -> int:
    """value 2^bits, rounded down: a limit is never exceeded."""
    return math.floor(Fraction(value) * 2**bits)


def _rate(calibration: Calibration) -> Fraction:
    """Sample rate as the block carries it, in Hz."""
    return Fraction(round(Fraction(calibration.sample_rate_hz) * 1000), 1000)


def _loop_period(calibration: Calibration) -> Fraction:
    return calibration.decimation / _rate(calibration)


def _word(frequency_hz: float, rate_hz: Fraction) -> int:
    """Turns per sample, 2^64 = one turn, of a frequency rounded to 1 nHz."""
    return round(round(Fraction(frequency_hz), 9) / rate_hz * 2**64)


def _frequency(word: int, rate_hz: Fraction) -> float:
    return float(round(Fraction(word, 2**64) * rate_hz, 9))


def _clock(c: Calibration) -> dict[str, int]:
    return {"sample_rate_millihz": int(_rate(c) * 1000), "decimation": c.decimation, "loops_per_slow": c.loops_per_slow,
            "normalise_q31": _fixed(Fraction(4, c.decimation**2), 31)}


def _temperature(c: Calibration) -> dict[str, int]:
    reference = Fraction(round(Fraction(c.reference_temperature_degc) * 1000), 1000)
    return {"reference_temperature_mdegc": int(reference * 1000), "thermometer_offset_raw": c.thermometer_code_at_reference,
            "thermometer_gain_degc_q36": _fixed(c.thermometer_degc_per_lsb, 36),
            "shift_min_q20": _fixed(Fraction(c.temperature_min_degc) - reference, 20),
            "shift_max_q20": _fixed(Fraction(c.temperature_max_degc) - reference, 20)}


def _polynomials(c: Calibration) -> dict[str, int]:
    numbers = {}
    for name, bits in _POLYNOMIALS.items():
        coefficients = getattr(c, name)
        numbers[f"{name}_order"] = len(coefficients) - 1
        for i in range(MAX_ORDER + 1):
            coefficient = coefficients[i] if i < len(coefficients) else 0.0
            numbers[f"{name}_{i}"] = polynomial_coefficient(name, i, coefficient)
    return numbers


def polynomial_coefficient(name: str, i: int, coefficient: float) -> int:
    """c_i 128^i in the format of the polynomial `name`; BadInput when it does not fit 32 bit."""
    number = _fixed(Fraction(coefficient) * SPAN_DEGC**i, _POLYNOMIALS[name])
    if not -(2**31) <= number < 2**31:
        limit = 2.0 ** (31 - _POLYNOMIALS[name]) / SPAN_DEGC**i
        raise BadInput(f"coefficient {i} is {coefficient:g}, but the firmware's format ends at ±{limit:.4g}", f"calibration, {name}",
                       "check its unit, or lower the order of the fit")
    return number


def _tuning(c: Calibration) -> dict[str, int]:
    rate = _rate(c)
    word = _word(c.nominal_frequency_hz, rate)
    angle = 2.0 * math.pi * float(Fraction(word, 2**64))
    return {"angular_gain_q24": _fixed(c.angular_gain, 24), "center_freq_u64": word,
            "center_2cos_q40": _fixed(2.0 * math.cos(angle), 40), "center_cos_q31": _clip(_fixed(math.cos(angle), 31)),
            "center_sin_q31": _clip(_fixed(math.sin(angle), 31)), "sample_period_q46": _fixed(1 / rate, 46),
            "coupling_gain_q44": _fixed(Fraction(c.angular_gain) * Fraction(c.pickoff_gain_ratio) / rate, 44)}


def _clip(number: int) -> int:
    """±1 in Q31 has no code on the positive side."""
    return min(number, 2**31 - 1)


def _acquisition(c: Calibration) -> dict[str, int]:
    rate = _rate(c)
    return {"search_min_u64": _word(c.search_min_hz, rate), "search_max_u64": _word(c.search_max_hz, rate),
            "chirp_ticks_log2": _log2_ticks("chirp_s", c.chirp_s, c),
            "settle_ticks": round(Fraction(c.settle_s) / _loop_period(c)),
            "listen_ticks_log2": _log2_ticks("listen_s", c.listen_s, c) - 1,
            "audible_q30": _fixed(c.audible_amplitude_fs, 30), "acquisition_attempts": c.acquisition_attempts}


def _log2_ticks(name: str, seconds: float, c: Calibration) -> int:
    """Logarithm of a duration that must be a power of two of loop ticks, to one per cent."""
    ticks = seconds * c.loop_rate_hz
    log2 = round(math.log2(ticks))
    if not math.isclose(ticks, 2.0**log2, rel_tol=0.01):
        raise BadInput(f"{seconds:g} s is not 2^n loop ticks", f"calibration, {name}", f"take {2.0**log2 / c.loop_rate_hz:.9g} s")
    return log2


def _loops(c: Calibration) -> dict[str, int]:
    period, loop_period = 1 / _rate(c), _loop_period(c)
    return {"pll_proportional_q32": _fixed(Fraction(c.pll_kp_per_s) * period, 32),
            "pll_integral_q32": _fixed(Fraction(c.pll_ki_per_s2) * period * loop_period, 32),
            "agc_proportional_q16": _fixed(c.agc_kp, 16),
            "agc_integral_q24": _fixed(Fraction(c.agc_ki_per_s) * loop_period, 24),
            "amplitude_q30": _fixed(c.amplitude_set_point_fs, 30),
            "drive_max_q31": _fixed(c.drive_limit_fs, 31),
            "rebalance_proportional_q16": _fixed(c.rebalance_kp, 16),
            "rebalance_integral_q24": _fixed(Fraction(c.rebalance_ki_per_s) * loop_period, 24),
            "rebalance_in_phase_limit_q31": _floor(c.rebalance_in_phase_limit_fs, 31),
            "rebalance_quadrature_limit_q31": _floor(c.rebalance_quadrature_limit_fs, 31),
            "loop_delay_samples_q16": _fixed(c.loop_delay_samples, 16)}


def _monitors(c: Calibration) -> dict[str, int]:
    return {"phase_limit_i32": _fixed(Fraction(c.lock_phase_limit_deg) / 360, 32),
            "amplitude_limit_q30": _fixed(Fraction(c.lock_amplitude_limit) * Fraction(c.amplitude_set_point_fs), 30),
            "hold_ticks": round(Fraction(c.lock_hold_s) / _loop_period(c)),
            "adc_limit_q31": _clip(_fixed(c.adc_limit_fs, 31)),
            "loop": LOOPS.index(c.loop), "compensation": COMPENSATIONS.index(c.compensation), "output_filter": OUTPUT_FILTERS.index(c.output_filter)}


def unpack(block: bytes, source: str = "calibration block") -> dict[str, Any]:
    """Every number of a block by name; BadInput for another size, magic, version or a wrong CRC."""
    if len(block) != SIZE:
        raise BadInput(f"it has {len(block)} bytes instead of {SIZE}", source, "give a whole calibration block")
    numbers = dict(zip((name for name, _ in LAYOUT), _STRUCT.unpack(block), strict=True))
    if numbers["magic"] != MAGIC:
        raise BadInput("this is no calibration block", source, "give a file that the calibration wrote")
    if numbers["version"] != BINARY_VERSION or numbers["size"] != SIZE:
        raise BadInput(f"version {numbers['version']} of the block is unknown", source, f"this program reads version {BINARY_VERSION}")
    if numbers["crc"] != zlib.crc32(block[:-4]):
        raise BadInput("the CRC is wrong", source, "the block was damaged on its way; fetch it again")
    return numbers


def from_binary(block: bytes, source: str = "calibration block") -> Calibration:
    """The calibration in SI, from the integers as they are."""
    n = unpack(block, source)
    if n["loop"] >= len(LOOPS) or n["compensation"] >= len(COMPENSATIONS) or n["output_filter"] >= len(OUTPUT_FILTERS):
        raise BadInput("unknown loop, compensation or output filter", source, "give a block of this version")
    if any(n[f"{name}_order"] > MAX_ORDER for name in _POLYNOMIALS):
        raise BadInput(f"a polynomial's order is beyond {MAX_ORDER}", source, "give a block of this version")
    if any(n[name] > _RANGES[name][1] for name in ("chirp_ticks_log2", "listen_ticks_log2")):
        raise BadInput("chirp or listening is longer than the firmware can count", source, "give a block that the firmware takes")
    for name in ("sample_rate_millihz", "decimation", "amplitude_q30"):
        if n[name] == 0:
            raise BadInput(f"{name} is 0", source, "give a block that the firmware takes")
    return make({**_general_si(n), **_temperature_si(n), **_polynomials_si(n), **_tuning_si(n), **_acquisition_si(n),
                 **_loops_si(n), **_monitors_si(n)}, source)


def _general_si(n: dict[str, Any]) -> dict[str, Any]:
    name = n["device_name"].rstrip(b"\0").decode("ascii", "replace")
    return {"device_name": name, "serial": n["serial"], "sequence": n["sequence"], "created_unix_s": n["created_unix_s"],
            "sample_rate_hz": n["sample_rate_millihz"] / 1000, "decimation": n["decimation"], "loops_per_slow": n["loops_per_slow"],
            "loop": LOOPS[n["loop"]], "compensation": COMPENSATIONS[n["compensation"]], "output_filter": OUTPUT_FILTERS[n["output_filter"]]}


def _temperature_si(n: dict[str, Any]) -> dict[str, Any]:
    reference = Fraction(n["reference_temperature_mdegc"], 1000)
    return {"reference_temperature_degc": float(reference), "thermometer_code_at_reference": n["thermometer_offset_raw"],
            "thermometer_degc_per_lsb": n["thermometer_gain_degc_q36"] / 2**36,
            "temperature_min_degc": float(reference + Fraction(n["shift_min_q20"], 2**20)),
            "temperature_max_degc": float(reference + Fraction(n["shift_max_q20"], 2**20))}


def _polynomials_si(n: dict[str, Any]) -> dict[str, Any]:
    return {name: [n[f"{name}_{i}"] / (2**bits * SPAN_DEGC**i) for i in range(n[f"{name}_order"] + 1)]
            for name, bits in _POLYNOMIALS.items()}


def _tuning_si(n: dict[str, Any]) -> dict[str, Any]:
    rate = Fraction(n["sample_rate_millihz"], 1000)
    gain = Fraction(n["angular_gain_q24"], 2**24)
    ratio = Fraction(n["coupling_gain_q44"], 2**44) * rate / gain if gain else Fraction(0)
    return {"angular_gain": float(gain), "pickoff_gain_ratio": float(ratio), "nominal_frequency_hz": _frequency(n["center_freq_u64"], rate)}


def _acquisition_si(n: dict[str, Any]) -> dict[str, Any]:
    rate = Fraction(n["sample_rate_millihz"], 1000)
    tick_s = n["decimation"] / rate
    return {"search_min_hz": _frequency(n["search_min_u64"], rate), "search_max_hz": _frequency(n["search_max_u64"], rate),
            "chirp_s": float(2 ** n["chirp_ticks_log2"] * tick_s), "settle_s": float(n["settle_ticks"] * tick_s),
            "listen_s": float(2 ** (n["listen_ticks_log2"] + 1) * tick_s), "audible_amplitude_fs": n["audible_q30"] / 2**30,
            "acquisition_attempts": n["acquisition_attempts"]}


def _loops_si(n: dict[str, Any]) -> dict[str, Any]:
    rate = Fraction(n["sample_rate_millihz"], 1000)
    loop_rate = rate / n["decimation"]
    return {"pll_kp_per_s": float(Fraction(n["pll_proportional_q32"], 2**32) * rate),
            "pll_ki_per_s2": float(Fraction(n["pll_integral_q32"], 2**32) * rate * loop_rate),
            "agc_kp": n["agc_proportional_q16"] / 2**16, "agc_ki_per_s": float(Fraction(n["agc_integral_q24"], 2**24) * loop_rate),
            "amplitude_set_point_fs": n["amplitude_q30"] / 2**30, "drive_limit_fs": n["drive_max_q31"] / 2**31,
            "rebalance_kp": n["rebalance_proportional_q16"] / 2**16,
            "rebalance_ki_per_s": float(Fraction(n["rebalance_integral_q24"], 2**24) * loop_rate),
            "rebalance_in_phase_limit_fs": n["rebalance_in_phase_limit_q31"] / 2**31,
            "rebalance_quadrature_limit_fs": n["rebalance_quadrature_limit_q31"] / 2**31,
            "loop_delay_samples": n["loop_delay_samples_q16"] / 2**16}


def _monitors_si(n: dict[str, Any]) -> dict[str, Any]:
    tick_s = Fraction(1000 * n["decimation"], n["sample_rate_millihz"])
    return {"lock_phase_limit_deg": float(Fraction(n["phase_limit_i32"] * 360, 2**32)),
            "lock_amplitude_limit": float(Fraction(n["amplitude_limit_q30"], n["amplitude_q30"])),
            "lock_hold_s": float(n["hold_ticks"] * tick_s), "adc_limit_fs": n["adc_limit_q31"] / 2**31}

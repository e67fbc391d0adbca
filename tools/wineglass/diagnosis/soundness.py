"""Is this recording what it says it is? Contradictions are bad input; damage that leaves enough behind is a note.

    device = described(recording, None)          # the description in the recording, or the one asked for
    notes = check(recording, device)             # raises BadInput; what was lost comes back in words
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wineglass import calibration_block
from wineglass import device as devices
from wineglass.calibration_block import Calibration
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.recording import Recording, Tap
from wineglass.wire import Status

OTHER_FREQUENCY = 0.01  # the lock-in's search reaches 1.2 %; tolerances of a device are far below
UNIT_FACTORS = (180.0 / np.pi, 3600.0 * 180.0 / np.pi, 3600.0, 1e3, 1e6)
NEAR_FACTOR = 0.2  # logarithm: no scale factor is that far off
OTHER_TEMPERATURE_DEGC = 100.0
HOTTEST_DEGC = 200.0
STRAY_LSB = 2  # a calibration written as text and read again


def described(recording: Recording, wanted: str | Path | None, strict: bool = True) -> Device | None:
    """The device the recording is of: `wanted` (a name or a path), else the description that it carries; None: none is known.

    strict: refuse a recording that says it is of another device than `wanted`."""
    stored = devices.loads(recording.device_toml, f"{recording.path}, device_toml") if recording.device_toml else None
    if wanted is None:
        return stored
    device = devices.load(wanted)
    if strict and stored is not None and stored.name != device.name:
        raise BadInput(f"this is a recording of {stored.name}, not of {device.name}", recording.path, f"leave --device away, or describe {stored.name}")
    calibration = calibration_of(recording)
    if strict and stored is None and calibration is not None and calibration.device_name not in ("", device.name):
        raise BadInput(f"the calibration in the recording is of {calibration.device_name}, not of {device.name}", recording.path,
                       f"leave --device away, or describe {calibration.device_name}")
    return device


def check(recording: Recording, device: Device | None) -> list[str]:
    """BadInput where the recording contradicts itself or the device; else notes about what is missing or damaged."""
    calibration = calibration_of(recording)
    _check_calibration(recording, calibration, device)
    _check_frequency(recording, calibration, device)
    _check_fractions(recording)
    _check_temperatures(recording)
    _check_rate_unit(recording)
    return _damage(recording)


def calibration_of(recording: Recording) -> Calibration | None:
    """The calibration in force; a block whose own CRC is wrong is refused."""
    if recording.calibration_block:
        return calibration_block.from_binary(recording.calibration_block, f"{recording.path}, calibration_block")
    if recording.calibration_json:
        return calibration_block.from_json(recording.calibration_json, f"{recording.path}, calibration_json")
    return None


def _check_calibration(recording: Recording, calibration: Calibration | None, device: Device | None) -> None:
    if calibration is None:
        return
    if recording.calibration_block:
        _check_hash(recording)
        _check_text(recording)
    stored = devices.loads(recording.device_toml, f"{recording.path}, device_toml") if recording.device_toml else None
    if stored is not None and calibration.device_name not in ("", stored.name):
        raise BadInput(f"the calibration is of {calibration.device_name}, the recording of {stored.name}", recording.path,
                       "put the calibration that was in force into the recording")
    _same("calibration was made for a sample rate", calibration.sample_rate_hz, recording.counter_rate_hz, recording, "Hz")
    if device is not None:
        _same("sample counter runs at", recording.counter_rate_hz, device.electronics.sample_rate_hz, recording, "Hz")
        _same("calibration's reference temperature is", calibration.reference_temperature_degc, device.resonator.reference_temperature_degc,
              recording, "degC")


def _same(what: str, found: float, expected: float, recording: Recording, unit: str) -> None:
    if abs(found - expected) > 1e-3 * max(1.0, abs(expected)):
        raise BadInput(f"the {what} {found:g} {unit}, where {expected:g} {unit} is expected", recording.path, "this is another device or another calibration")


def _check_hash(recording: Recording) -> None:
    """The CRC that the device reported while it was recorded against that of the block in the recording."""
    stored = int.from_bytes(recording.calibration_block[-4:], "little")
    if recording.calibration_crc is not None and recording.calibration_crc != stored:
        raise BadInput(f"the device ran with calibration {recording.calibration_crc:08x}, the recording holds {stored:08x}", recording.path,
                       "put the calibration that was in force into the recording")


def _check_text(recording: Recording) -> None:
    """Both forms of the calibration must say the same, but for the last bits of numbers written in decimals."""
    if not recording.calibration_json:
        return
    text = calibration_block.from_json(recording.calibration_json, f"{recording.path}, calibration_json")
    block = calibration_block.unpack(recording.calibration_block, f"{recording.path}, calibration_block")
    other = calibration_block.unpack(calibration_block.to_binary(text))
    for name, value in block.items():
        if isinstance(value, int) and name not in ("crc", "created_unix_s") and abs(value - other[name]) > STRAY_LSB + 1e-9 * abs(value):
            raise BadInput(f"calibration_json and calibration_block differ in {name}", recording.path,
                           "put the calibration that was in force into the recording, in one form or in both")


def _check_frequency(recording: Recording, calibration: Calibration | None, device: Device | None) -> None:
    tap = recording.taps.get("baseband")
    if tap is None or "drive_frequency" not in tap or (device is None and calibration is None):
        return
    nominal = device.resonator.frequency_hz if device is not None else calibration.nominal_frequency_hz
    values = tap["drive_frequency"][_locked(tap)]
    if len(values) == 0:
        return
    found = float(np.nanmedian(values))
    reach = OTHER_FREQUENCY + (0.0 if device is None else _thermal_reach(device))
    if abs(found / nominal - 1.0) > reach:
        hint = "check the unit of drive_frequency" if found > 0 and abs(np.log10(found / nominal)) > 1.0 else "this is another device"
        raise BadInput(f"the drive runs at {found:.6g} Hz, the described device at {nominal:.6g} Hz", recording.path, hint)


def _thermal_reach(device: Device) -> float:
    """Largest relative change of the frequency over the device's temperatures."""
    degc = np.linspace(*device.calibration_range_degc(), 21)
    return float(np.max(np.abs(device.resonator.frequency_at(degc) / device.resonator.frequency_hz - 1.0)))


def _locked(tap: Tap) -> np.ndarray:
    if "status" not in tap:
        return tap.valid
    return tap.valid & (tap.codes("status").astype(np.int64) & Status.LOCKED != 0)


def _check_fractions(recording: Recording) -> None:
    """Fractions of full scale beyond full scale: the scale attribute is wrong."""
    tap = recording.taps.get("baseband")
    for name in tap.channels if tap is not None else ():
        if tap.channels[name] == "FS" and (reach := float(np.nanmax(np.abs(tap[name]), initial=0.0))) > 2.0:
            raise BadInput(f"channel {name} reaches {reach:.4g} of full scale", f"{recording.path}, group baseband", "check its attributes unit and scale")


def _check_temperatures(recording: Recording) -> None:
    output = recording.taps.get("output")
    if output is None or "temperature_measured" not in output:
        return
    measured = output["temperature_measured"]
    middle = float(np.nanmedian(measured)) if np.isfinite(measured).any() else 0.0
    if middle > HOTTEST_DEGC:
        raise BadInput(f"temperature_measured is about {middle:.4g} degC", recording.path, "check its unit")
    reference = recording.taps.get("reference")
    for name in ("shell_temperature", "chamber_temperature"):
        if reference is None or name not in reference or not np.isfinite(reference[name]).any():
            continue
        apart = middle - float(np.nanmedian(reference[name]))
        if abs(apart) > OTHER_TEMPERATURE_DEGC:
            raise BadInput(f"temperature_measured and {name} are {abs(apart):.4g} degC apart", recording.path, "check their units")
        return


def _check_rate_unit(recording: Recording) -> None:
    """A scale factor of 57.3 is no effect but degrees taken for radians."""
    output, reference = recording.taps.get("output"), recording.taps.get("reference")
    if output is None or reference is None or "true_rate" not in reference:
        return
    there = np.isfinite(reference["true_rate"])
    for name in ("rate_uncompensated", "rate"):
        if name not in output or there.sum() < 20:
            continue
        true_rate = np.interp(output.time_s, reference.time_s[there], reference["true_rate"][there])
        use = np.isfinite(output[name])
        gain = unit_factor(true_rate[use], output[name][use])
        if gain is not None:
            raise BadInput(f"channel {name} is {gain:.4g} times the true rate", recording.path, "check the units of both")
        return


def unit_factor(true_rate: np.ndarray, values: np.ndarray) -> float | None:
    """By how much two rates (n,) differ, where that is the ratio of two units; None where it is not, or cannot be told."""
    if len(values) < 20:
        return None
    moves = true_rate - true_rate.mean()
    if np.std(moves) < 1e-9 or np.std(values) == 0.0 or abs(np.corrcoef(moves, values)[0, 1]) < 0.5:
        return None
    gain = abs(float(moves @ values / (moves @ moves)))
    factors = (*UNIT_FACTORS, *(1.0 / f for f in UNIT_FACTORS))
    return gain if any(abs(np.log(gain / factor)) < NEAR_FACTOR for factor in factors) else None


def _damage(recording: Recording) -> list[str]:
    notes = []
    for tap in [*recording.taps.values(), *recording.bursts]:
        damaged, lost = int(tap.damaged.sum()), int(tap.lost.sum())
        if damaged:
            notes.append(f"{damaged} of {tap.length} samples of {tap.name} cannot be read: the file is damaged; the diagnosis uses the others")
        if lost > damaged:
            notes.append(f"{lost - damaged} of {tap.length} samples of {tap.name} are lost; the diagnosis uses the others")
    notes += [f"the recording was interrupted ({event.value})" for event in recording.events if event.kind == "interrupted"]
    notes += [f"a raw burst was cut ({event.value})" for event in recording.events if event.kind == "raw_burst_cut"]
    return notes

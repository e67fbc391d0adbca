"""What calibrate needs of a recording, on one time grid: temperature, the measured channel, and the true rate where the bench has it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wineglass import calibration_block
from wineglass.errors import BadInput
from wineglass.recording import Recording, Tap
from wineglass.wire import Status

MAX_SAMPLES = 50_000  # longer records are averaged in pairs, threes, ... to stay below this
SETTLED_DECAYS = 8.0  # of the open secondary, e^-8 = 3e-4 of a disturbance is left
SETTLED_CLOSED_S = 0.5
RATE_MOVES_RAD_S = 1e-6  # a true rate that stays within this is a constant


@dataclass(frozen=True)
class Observations:
    """All arrays (n,).

    measured: rate in rad/s, or the in-phase ratio secondary/primary (`is_ratio`)
    true_rate_rad_s: None where nothing is known: then the device is taken to stand still
    valid: samples that the fit may use; temperature and true rate are without gaps (interpolated), as the lag needs their history
    """

    channel: str
    is_ratio: bool
    time_s: np.ndarray
    temperature_degc: np.ndarray
    measured: np.ndarray
    true_rate_rad_s: np.ndarray | None
    valid: np.ndarray

    @property
    def rate_moves(self) -> bool:
        return self.true_rate_rad_s is not None and float(np.ptp(self.true_rate_rad_s)) > RATE_MOVES_RAD_S


def observe(recording: Recording, channel: str | None = None) -> Observations:
    """channel: rate, rate_uncompensated or ratio; None chooses by what the recording holds."""
    output = recording.tap("output")
    if "temperature_measured" not in output:
        raise BadInput("no temperature_measured in the recording", recording.path, "a thermal calibration needs the temperature")
    true_rate = _true_rate(recording)
    channel = channel or _best_channel(recording, true_rate)
    time_s, measured = _measured(recording, channel)
    temperature = _resampled(output, "temperature_measured", time_s)
    covered = _covered(output, time_s) & (true_rate is None or _covered(true_rate, time_s))
    observations = Observations(
        channel=channel,
        is_ratio=channel == "ratio",
        time_s=time_s,
        temperature_degc=temperature,
        measured=measured,
        true_rate_rad_s=None if true_rate is None else _resampled(true_rate, "true_rate", time_s),
        valid=np.isfinite(measured) & covered & _locked(recording, time_s),
    )
    if observations.valid.sum() < 20:
        raise BadInput(f"only {int(observations.valid.sum())} usable samples", recording.path, "record longer")
    return _thinned(observations)


def _true_rate(recording: Recording) -> Tap | None:
    if "reference" not in recording.taps:
        return None
    tap = recording.tap("reference")
    return tap if "true_rate" in tap and tap.length > 1 else None


def _best_channel(recording: Recording, true_rate: Tap | None) -> str:
    moves = true_rate is not None and np.nanmax(true_rate["true_rate"]) - np.nanmin(true_rate["true_rate"]) > RATE_MOVES_RAD_S
    if moves and _has_ratio(recording) and not _decoupled(recording):
        return "ratio"
    output = recording.tap("output")
    for name in ("rate_uncompensated", "rate"):
        if name in output:
            return name
    raise BadInput("no rate in the recording", recording.path, "a calibration needs output/rate_uncompensated or output/rate")


def _has_ratio(recording: Recording) -> bool:
    names = ("primary_in_phase", "primary_quadrature", "secondary_in_phase", "secondary_quadrature")
    return "baseband" in recording.taps and all(name in recording.tap("baseband") for name in names)


def _decoupled(recording: Recording) -> bool:
    """Did the firmware take the cross damping out before demodulation? Then the baseband no longer shows it."""
    modes = [event.value.lower() for event in recording.events if event.kind == "compensation"]
    if not modes and recording.calibration_block:
        modes = [calibration_block.from_binary(recording.calibration_block, f"{recording.path}, calibration_block").compensation]
    return "g2" in modes


def _locked(recording: Recording, time_s: np.ndarray) -> np.ndarray:
    """Mask of the times at which the drive loop was locked, nothing saturated and no test disturbed the rate; all, where no status was
    recorded."""
    if "baseband" not in recording.taps or "status" not in recording.tap("baseband"):
        return np.ones(len(time_s), bool)
    tap = recording.tap("baseband")
    status = tap.codes("status").astype(np.int64)
    good = tap.valid & (status & Status.LOCKED != 0) & (status & (Status.ADC_SATURATED | Status.OVERFLOW) == 0)
    good &= ~_disturbed(recording, status, tap.sample_rate_hz)
    nearest = np.clip(np.searchsorted(tap.time_s, time_s - 0.5 / tap.sample_rate_hz), 0, tap.length - 1)
    return good[nearest]


def _disturbed(recording: Recording, status: np.ndarray, rate_hz: float) -> np.ndarray:
    """Test forces, ring-downs and changes of the loop, and after each of them what the secondary mode takes to forget; (n,) bool."""
    disturbed = status & (Status.TEST_ACTIVE | Status.DRIVE_OFF) != 0
    closed = (status & Status.REBALANCE_ACTIVE) != 0
    locked = (status & Status.LOCKED) != 0
    disturbed[1:] |= (closed[1:] != closed[:-1]) & locked[1:] & locked[:-1]
    if not disturbed.any():
        return disturbed
    last = np.maximum.accumulate(np.where(disturbed, np.arange(len(status)), -len(status)))
    since_s = (np.arange(len(status)) - last) / rate_hz
    return since_s <= np.where(closed, SETTLED_CLOSED_S, SETTLED_DECAYS * _decay_s(recording))


def _decay_s(recording: Recording) -> float:
    """Of the secondary mode, at the calibration's temperature; 0: not known."""
    if not recording.calibration_block:
        return 0.0
    block = calibration_block.from_binary(recording.calibration_block, f"{recording.path}, calibration_block")
    return 1.0 / block.decay_rate_per_s[0] if block.decay_rate_per_s[0] > 0 else 0.0


def _measured(recording: Recording, channel: str) -> tuple[np.ndarray, np.ndarray]:
    if channel != "ratio":
        tap = recording.tap("output")
        return tap.time_s, tap[channel].copy()
    if not _has_ratio(recording):
        raise BadInput("the baseband of both pickoffs is not in the recording", recording.path, "choose --channel rate_uncompensated")
    tap = recording.tap("baseband")
    primary = tap["primary_in_phase"] + 1j * tap["primary_quadrature"]
    secondary = tap["secondary_in_phase"] + 1j * tap["secondary_quadrature"]
    power = np.abs(primary) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.real(secondary * np.conj(primary)) / power
    return tap.time_s, np.where(power > 0.1 * np.nanmedian(power), ratio, np.nan)


def _resampled(tap: Tap, name: str, time_s: np.ndarray) -> np.ndarray:
    values = tap[name]
    there = ~np.isnan(values)
    if there.sum() < 2:
        raise BadInput(f"channel {name} holds no samples", tap.name, "record it again")
    return np.interp(time_s, tap.time_s[there], values[there])


def _covered(tap: Tap, time_s: np.ndarray) -> np.ndarray:
    """Times at which the tap has a sample near by: inside its record, and not in a gap."""
    there = tap.time_s[tap.valid]
    if len(there) < 2:
        return np.zeros(len(time_s), bool)
    step = 1.5 * max(float(np.median(np.diff(there))), float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0)
    after = np.clip(np.searchsorted(there, time_s), 1, len(there) - 1)
    distance = np.minimum(np.abs(time_s - there[after - 1]), np.abs(there[after] - time_s))
    return distance <= step


def _thinned(full: Observations) -> Observations:
    """Means over groups of samples; a group counts when half of it does."""
    size = -(-len(full.time_s) // MAX_SAMPLES)
    if size == 1:
        return full
    count = len(full.time_s) // size

    def mean(values: np.ndarray) -> np.ndarray:
        return values[: count * size].reshape(count, size).mean(axis=1)

    weight = mean(full.valid.astype(float))
    filled = np.where(full.valid, full.measured, 0.0)
    return Observations(
        channel=full.channel,
        is_ratio=full.is_ratio,
        time_s=mean(full.time_s),
        temperature_degc=mean(full.temperature_degc),
        measured=mean(filled) / np.maximum(weight, 1e-12),
        true_rate_rad_s=None if full.true_rate_rad_s is None else mean(full.true_rate_rad_s),
        valid=weight >= 0.5,
    )

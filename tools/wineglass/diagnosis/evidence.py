"""What the rate-level engine looks at: one rate over time and temperature, from a recording or a table."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wineglass.diagnosis.soundness import HOTTEST_DEGC, unit_factor
from wineglass.errors import BadInput

if TYPE_CHECKING:
    from wineglass.calibration.base import Base
    from wineglass.calibration.observations import Observations
    from wineglass.device import Device
    from wineglass.diagnosis.described import Expected
    from wineglass.diagnosis.noise_level import NoiseEvidence
    from wineglass.recording import Recording

DEVIATING_STEP = 1.5  # of the usual distance between samples: beyond it samples are missing
RESTING = 1e-3  # of the true rate's span: closer than that a turn has come to rest
TURNING_S = 0.3  # before and after a turn changes: filters and loops
PAUSE_S = 30.0  # and usual steps: a longer pause is a new power-up or segment, not lost samples


@dataclass(frozen=True)
class Evidence:
    """Arrays (n,), without lost samples.

    temperature_degc: the shell's own where the bench recorded it (then measured_degc is the thermometer's), else the thermometer's
    bias_rad_s: what the calibration predicts (n,), None: no calibration is known, so the nominal static curve is fitted
    bias_slope: its derivative over temperature [rad/s/degC] (n,)
    expected: what a described device would do, None: no device is described
    thermometer: the same without anything left out, for judging the thermometer by itself
    noise: what noise, lines and readings of a described device's output say
    """

    source: str
    sha256: str
    channel: str
    time_s: np.ndarray
    temperature_degc: np.ndarray
    rate_rad_s: np.ndarray
    true_rate_rad_s: np.ndarray | None = None
    bias_rad_s: np.ndarray | None = None
    bias_slope: np.ndarray | None = None
    measured_degc: np.ndarray | None = None
    expected: Expected | None = None
    thermometer: Evidence | None = None
    noise: NoiseEvidence | None = None
    lost: int = 0
    device: str | None = None
    firmware: str | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)

    @property
    def measured_minus_reference(self) -> np.ndarray:
        return self.rate_rad_s if self.true_rate_rad_s is None else self.rate_rad_s - self.true_rate_rad_s


def file_hash(path: Path) -> str:
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while piece := file.read(1 << 20):
                digest.update(piece)
    except OSError as error:
        raise BadInput(f"the file cannot be read ({error.strerror})".lower(), path, "check the name") from error
    return digest.hexdigest()


def from_csv(path: Path, columns: dict[str, str], unit_of: dict[str, str], drop_rows: frozenset[int]) -> Evidence:
    from wineglass.importers.csv import ImportOptions, read_csv

    digest = file_hash(path)
    data = read_csv(path, ImportOptions(columns, unit_of, drop_rows, "--column"))
    for channel, role in (("rate", "rate"), ("temperature_measured", "temperature")):
        if channel not in data.channels:
            raise BadInput(f"no {role} column", path, f"add --column {role}=COLUMN")
    notes = ["no calibration is known: the nominal twin is the best static cubic over the measured temperature, fitted on the fit part"]
    if data.ignored:
        notes.append(f"columns not used: {', '.join(data.ignored)}")
    measured = data.channels["temperature_measured"]
    shell = data.channels.get("shell_temperature")
    return checked(Evidence(
        source=str(path), sha256=digest, channel=data.source["rate"], time_s=data.time_s,
        temperature_degc=measured if shell is None else shell, rate_rad_s=data.channels["rate"],
        true_rate_rad_s=data.channels.get("true_rate"), measured_degc=None if shell is None else measured, notes=tuple(notes),
    ))


def from_recording(path: Path, device: str | None = None) -> Evidence:
    """device: name or path of the description, None: the one in the recording."""
    from wineglass.calibration.observations import observe
    from wineglass.diagnosis import soundness
    from wineglass.recording import Recording

    digest = file_hash(path)
    with Recording.open(path, tolerant=True) as recording:
        known = soundness.described(recording, device)
        damage = soundness.check(recording, known)
        if "output" not in recording:
            raise BadInput("the recording has no tap output", path, "the rate-level diagnosis needs its temperature_measured and rate")
        channel = "rate_uncompensated" if "rate_uncompensated" in recording.tap("output") else "rate"
        if channel not in recording.tap("output"):
            raise BadInput("the recording holds no rate", path, "record output/rate_uncompensated or output/rate")
        data = observe(recording, channel)
        measured, shell = data.temperature_degc, _shell(recording, channel, data, known is not None)
        if shell is not None:
            data = replace(data, temperature_degc=shell)
        bias, slope, true_rate, notes = _nominal(recording, channel, data)
        expected = _expected(recording, known, channel, data, measured, true_rate)
        if expected is not None:
            bias, slope = expected.rate - (0.0 if true_rate is None else true_rate), expected.slope
            notes = ["the nominal twin is the envelope twin of the described device over the recorded inputs", *expected.notes]
        noise = None if expected is None else _noise(recording, known)
        unused = [name for name in ("raw", "baseband") if name in recording]
        if unused:
            notes.append(f"taps not used by the rate-level engine: {', '.join(unused)}")
        lost = int(recording.tap("output").lost.sum())
        firmware = recording.firmware_version or None
    use = data.valid & _settled(data, true_rate)
    if expected is not None:
        use &= expected.use
        measured = measured - expected.measured_minus_shell
    nothing = np.zeros(len(data.time_s))
    whole = None if shell is None else Evidence(str(path), digest, "temperature_measured", data.time_s, shell, nothing, measured_degc=measured)
    if not use.all() and use.sum() < data.valid.sum():
        notes.append(f"{int(data.valid.sum() - use.sum())} samples while the rate changed or a command disturbed it, and shortly after, are left out")
    return checked(Evidence(
        source=str(path), sha256=digest, channel=channel, time_s=data.time_s[use], temperature_degc=data.temperature_degc[use],
        rate_rad_s=data.measured[use], true_rate_rad_s=None if true_rate is None else true_rate[use],
        bias_rad_s=None if bias is None else bias[use], bias_slope=None if slope is None else slope[use], lost=lost,
        measured_degc=None if shell is None else measured[use], expected=None if expected is None else expected.at(use),
        thermometer=whole, noise=noise, device=None if known is None else known.name, firmware=firmware, notes=(*damage, *notes),
    ))


def _expected(recording: Recording, device: Device | None, channel: str, data: Observations, measured: np.ndarray,
              true_rate: np.ndarray | None) -> Expected | None:
    """None without calibration: there is no telling what the output's scale is."""
    if device is None or not recording.calibration_block:
        return None
    from wineglass.diagnosis.described import expect

    return expect(recording, device, channel, data.time_s, measured, np.where(data.valid & _settled(data, true_rate), data.measured, np.nan))


def _noise(recording: Recording, device: Device | None) -> NoiseEvidence:
    from wineglass.diagnosis import noise_level

    return noise_level.examine(recording, device)


def _shell(recording: Recording, channel: str, data: Observations, described: bool) -> np.ndarray | None:
    """The shell's own temperature (n,). Not where the rate was compensated by the thermometer, unless the twin knows how: then its own errors count."""
    tap = recording.taps.get("reference")
    if tap is None or "shell_temperature" not in tap or (not described and channel == "rate" and recording.calibration_block):
        return None
    there = np.isfinite(tap["shell_temperature"])
    if there.sum() < 0.9 * len(there) or there.sum() < 20:
        return None
    return np.interp(data.time_s, tap.time_s[there], tap["shell_temperature"][there])


def checked(evidence: Evidence) -> Evidence:
    rate = evidence.rate_rad_s
    if len(rate) and np.ptp(rate) == 0.0:
        raise BadInput(f"channel {evidence.channel} never changes", evidence.source, "a live sensor has noise: check the column")
    if len(rate) and np.max(np.abs(rate)) > 100.0:
        raise BadInput(f"channel {evidence.channel} reaches {np.max(np.abs(rate)):.3g} rad/s", evidence.source, "check the unit of the rate")
    if len(rate) and np.median(evidence.temperature_degc) > HOTTEST_DEGC:
        raise BadInput(f"the temperature is about {np.median(evidence.temperature_degc):.3g} degC", evidence.source, "check the unit of the temperature")
    gain = None if evidence.true_rate_rad_s is None else unit_factor(evidence.true_rate_rad_s, rate)
    if gain is not None:
        raise BadInput(f"channel {evidence.channel} is {gain:.4g} times the true rate", evidence.source, "check the units of both")
    return evidence


def _nominal(recording: Recording, channel: str, data: Observations):  # noqa: ANN202 - four arrays
    """(bias that the calibration predicts, its slope, true rate as the channel shows it, notes); the first two None without calibration."""
    from numpy.polynomial import Polynomial

    from wineglass import calibration_block
    from wineglass.calibration.base import find_base

    if not recording.calibration_block:
        note = "the recording holds no calibration: the nominal twin is the best static cubic, fitted on the fit part"
        return None, None, data.true_rate_rad_s, [note]
    block = calibration_block.from_binary(recording.calibration_block, f"{recording.path}, calibration_block")
    shift = data.temperature_degc - block.reference_temperature_degc
    law = Polynomial(block.bias_rad_s)
    lagged = _open_loop(recording, find_base(recording, None, None), data)
    true_rate = None if data.true_rate_rad_s is None else lagged(data.true_rate_rad_s)
    compensation = block.compensation if channel == "rate" else "none"
    bias = {"none": lagged(law(shift)), "static": lagged(law(shift)) - law(shift), "g2": np.zeros(len(shift))}[compensation]
    return bias, law.deriv()(shift), true_rate, ["the nominal twin is the recording's own calibration"]


def _open_loop(recording: Recording, base: Base, data: Observations) -> Callable[[np.ndarray], np.ndarray]:
    """What the resonator's decay and the output filter make of a slow input; nothing where a rebalance loop holds the mode at rest."""
    from wineglass.calibration.lag import Lag

    force = recording.tap("baseband")["rebalance_in_phase"] if _has_force(recording) else np.zeros(1)
    closed = bool(np.nanmax(np.abs(force), initial=0.0) > 0.0)
    tau = np.zeros(len(data.time_s)) if closed else base.tau_s(data.temperature_degc)
    gain = np.ones(len(tau)) if closed else base.gain(data.temperature_degc)
    lag = Lag(data.time_s, tau, base.delay_s)
    return lambda values: gain * lag(values / gain)


def _settled(data: Observations, lagged_rate: np.ndarray | None) -> np.ndarray:
    """Samples at which the lagged true rate has come to rest; all, where that leaves too few."""
    everything = np.ones(len(data.time_s), bool)
    if lagged_rate is None or not data.rate_moves:
        return everything
    still = np.abs(lagged_rate - data.true_rate_rad_s) <= RESTING * np.ptp(data.true_rate_rad_s)
    moving = np.abs(np.diff(data.true_rate_rad_s, prepend=data.true_rate_rad_s[0])) > RESTING * np.ptp(data.true_rate_rad_s)
    reach = max(1, round(TURNING_S / max(1e-9, float(np.median(np.diff(data.time_s))))))
    still &= np.convolve(moving, np.ones(2 * reach + 1), "same") < 0.5
    return still if still.sum() > 0.3 * len(still) else everything


def _has_force(recording: Recording) -> bool:
    return "baseband" in recording and "rebalance_in_phase" in recording.tap("baseband")


def missing_samples(time_s: np.ndarray) -> int:
    """Samples that should stand between those that do; pauses are not counted."""
    steps = np.diff(time_s)
    usual = float(np.median(steps))
    jump = (steps > DEVIATING_STEP * usual) & (steps < PAUSE_S + 20.0 * usual)
    return int(np.sum(np.round(steps[jump] / usual) - 1.0))

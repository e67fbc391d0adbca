"""Phase self-calibration of the firmware: what to ask for, what comes back, and the polynomials from results at several temperatures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from wineglass.calibration_block import Calibration
from wineglass.commands_wire import CommandEncoder, PhaseOrder, Reason
from wineglass.errors import BadInput
from wineglass.phases_order import duration_s
from wineglass.telemetry import Decoder
from wineglass.twin import Twin

_RAD = 2.0**-31
_DEGC = 2.0**-20
_POLL_S = 0.1
_PATIENCE = 1.2  # over the time that the sequence is expected to take


class Outcome(IntEnum):
    DONE = 0
    ABORTED = 1
    DISTURBED = 2


@dataclass(frozen=True)
class Found:
    """One phase: what has to be added to it, half the difference of two halves of the measurement, and the phase then; rad"""

    correction_rad: float
    uncertainty_rad: float
    phase_rad: float


@dataclass(frozen=True)
class PhaseResult:
    """Answer to a phase calibration. temperature_shift_degc: mean over the measurement, from the calibration temperature"""

    outcome: Outcome
    parts: int
    temperature_shift_degc: float
    drive: Found
    demodulation: Found

    @staticmethod
    def of(record: np.void) -> PhaseResult:
        def found(name: str) -> Found:
            return Found(*(int(record[f"{name}_{what}"]) * _RAD for what in ("correction", "uncertainty", "phase")))

        return PhaseResult(Outcome(int(record["outcome"])), int(record["parts"]), int(record["temperature_shift"]) * _DEGC,
                           found("drive"), found("demodulation"))


def calibrate(twin: Twin, order: PhaseOrder, encoder: CommandEncoder | None = None) -> PhaseResult:
    """Ask the twin's firmware, which must be locked, and run the scenario on until it has answered."""
    slow_rate_hz = twin.run.device.slow_rate_hz
    decoder = Decoder()
    twin.telemetry()
    twin.command((encoder or CommandEncoder()).phase_calibration(order, slow_rate_hz))
    for _ in range(math.ceil(_PATIENCE * duration_s(order) / _POLL_S) + 2):
        twin.step(max(1, round(_POLL_S * slow_rate_hz)))
        frames = decoder.feed(twin.telemetry())
        for ack in frames.ack:
            if ack["reason"] != Reason.OK:
                raise BadInput(f"the firmware refuses the phase calibration ({Reason(int(ack['reason'])).name.lower()})",
                               "phase calibration", "let it lock first, and keep the rate small")
        if len(frames.phases):
            return PhaseResult.of(frames.phases[-1])
    raise BadInput("the firmware has not finished", "phase calibration", "report this")


def with_phases(calibration: Calibration, results: list[PhaseResult], order: int) -> Calibration:
    """The calibration with polynomials of at most this order through the phases found at several temperatures."""
    bad = [result for result in results if result.outcome is not Outcome.DONE]
    if bad or not results:
        raise BadInput("not every phase calibration was done", "phase calibration", "repeat it where the outcome was another")
    shift = np.array([result.temperature_shift_degc for result in results])
    drive = _fit(shift, [result.drive.phase_rad for result in results], order)
    demodulation = _fit(shift, [result.demodulation.phase_rad for result in results], order)
    return calibration.with_changes(drive_phase_rad=drive, demodulation_phase_rad=demodulation, sequence=calibration.sequence + 1)


def _fit(shift_degc: np.ndarray, phase_rad: list[float], order: int) -> list[float]:
    """Least squares; the order stays below the number of different temperatures."""
    distinct = len(np.unique(np.round(shift_degc)))
    fitted = np.polynomial.Polynomial.fit(shift_degc, phase_rad, min(order, distinct - 1), domain=[-128, 128], window=[-128, 128])
    return [float(value) for value in fitted.coef]

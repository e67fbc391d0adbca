"""Commands with answers: each is sent, its acknowledgement awaited, and sent again when the wire swallowed it.

    session = Session(port)
    identity = session.identity()
    session.command("compensation", session.encoder.compensation, "g2")     # Refused says why
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from wineglass.commands_wire import CHUNK_BYTES, CommandEncoder, Reason
from wineglass.errors import BadInput, WineglassError
from wineglass.link.ports import Port
from wineglass.telemetry import Decoder, Frames, Identity

ANSWER_S = 1.0
TRIES = 5
_PATIENCE = 0.05
T = TypeVar("T")


class Refused(WineglassError):
    """The device answered no."""

    def __init__(self, what: str, reason: int) -> None:
        self.what, self.reason = what, reason
        super().__init__(f"{what}: the device refused it ({reason_text(reason)}, reason {reason})")


def reason_text(reason: int) -> str:
    """The firmware's own words."""
    from wineglass.native import ffi, library

    return ffi.string(library().wg_reason_text(reason)).decode("ascii", "replace")


class Session:
    """One conversation with a device over a live port. Telemetry that comes in between goes to `listener`, in order."""

    def __init__(self, port: Port, listener: Callable[[bytes], None] | None = None, answer_s: float = ANSWER_S) -> None:
        if not port.is_live:
            raise BadInput("a file takes no commands", port.name, "give the port of a device")
        self.encoder = CommandEncoder()
        self._port = port
        self._decoder = Decoder()
        self._listener = listener
        self._answer_s = answer_s
        self._port.write(b"\0")  # ends whatever the device has half received

    def command(self, what: str, build: Callable[..., bytes], *arguments: Any) -> Frames:
        """Frames that came up to the acknowledgement. Refused when the device says no, BadInput when it does not answer at all."""
        return self._exchange(what, build, arguments, lambda frames: frames)

    def identity(self) -> Identity:
        record: np.void = self._exchange("ping", self.encoder.ping, (), lambda frames: _last(frames.identity))
        return Identity.of(record)

    def status(self) -> np.void:
        """Record of the status frame."""
        return self._exchange("status", self.encoder.status, (), lambda frames: _last(frames.status))

    def calibration(self) -> bytes:
        """The stored calibration block."""
        return self._exchange("calibration read", self.encoder.calibration_read, (),
                              lambda frames: frames.calibration[-1].data if frames.calibration else None)

    def write_calibration(self, block: bytes, unique_id: int) -> None:
        """Unlock, write, commit, and compare what the device then has stored."""
        self.command("calibration unlock", self.encoder.calibration_unlock, unique_id)
        for at in range(0, len(block), CHUNK_BYTES):
            self.command("calibration write", self.encoder.calibration_write, at, block[at:at + CHUNK_BYTES])
        self._commit(block)
        if self.calibration() != block:
            raise WineglassError(f"{self._port.name}: the device reads back another calibration than was written")

    def _commit(self, block: bytes) -> None:
        """A repeated commit finds the calibration locked again: then the first one succeeded and its answer was lost."""
        try:
            self.command("calibration commit", self.encoder.calibration_commit, len(block))
        except Refused as refused:
            if refused.reason != Reason.LOCKED or self.calibration() != block:
                raise

    def _exchange(self, what: str, build: Callable[..., bytes], arguments: tuple, take: Callable[[Frames], T | None]) -> T:
        for _ in range(TRIES):
            sequence = self.encoder.sequence
            self._port.write(build(*arguments))
            found = self._await(what, sequence, take)
            if found is not None:
                return found
        raise BadInput(f"no answer to {what}", self._port.name, "check the port, its speed, and that the device runs")

    def _await(self, what: str, sequence: int, take: Callable[[Frames], T | None]) -> T | None:
        """What `take` finds among the frames of one answer; None when the answer, or a part of it, was lost."""
        deadline = time.monotonic() + self._answer_s
        found: T | None = None
        while time.monotonic() < deadline:
            data = self._port.read(_PATIENCE)
            if self._listener is not None and data:
                self._listener(data)
            frames = self._decoder.feed(data)
            taken = take(frames)
            found = found if taken is None else taken
            for ack in frames.ack:
                if ack["command_sequence"] == sequence:
                    if ack["reason"] != 0:
                        raise Refused(what, int(ack["reason"]))
                    return found
        return None


def _last(records: np.ndarray) -> np.void | None:
    return records[-1] if len(records) else None

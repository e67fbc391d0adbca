"""A script's commands to a live device at their times, by the device's own clock, each sent until it is answered."""

from __future__ import annotations

import time
from dataclasses import dataclass

from wineglass.bench_script import Script, time_of
from wineglass.commands_wire import CommandEncoder, Reason
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.link.ports import Port
from wineglass.link.session import reason_text
from wineglass.recording import RecordingWriter
from wineglass.scenario import Burst
from wineglass.schedule import Command
from wineglass.telemetry import Decoder, Frames, Identity

ANSWER_S = 1.0
TRIES = 5
PATIENCE_S = 5.0
"""of the device's clock, while a burst or a phase calibration keeps it busy"""
FIRST_SEQUENCE = 0x4000  # far from what the session before has used


@dataclass
class _Open:
    """A command on its way."""

    item: Command | Burst
    sequence: int
    sent_s: float
    """by this computer's clock"""
    first_sample: int
    tries: int = 1


class Player(Decoder):
    """The recording's decoder, which sends what is due and hears the answers."""

    def __init__(self, script: Script, device: Device, port: Port, writer: RecordingWriter, identity: Identity) -> None:
        super().__init__()
        if abs(identity.sample_rate_hz - device.electronics.sample_rate_hz) > 0.01 * device.electronics.sample_rate_hz:
            raise BadInput(f"the device samples at {identity.sample_rate_hz:g} Hz, {device.name} at {device.electronics.sample_rate_hz:g} Hz",
                           port.name, "give the description of this device: --device")
        self._device, self._port, self._writer = device, port, writer
        self._rate_hz = identity.sample_rate_hz
        self._items, self._segments = script.items(), sorted(script.segment, key=lambda segment: segment.begin_s)
        self._open: _Open | None = None
        self._encoder = CommandEncoder(FIRST_SEQUENCE)
        self._refused: list[str] = []
        self._answers: list[tuple[int, int, int]] = []
        self._name, self._began = script.name or "script", False

    def feed(self, data: bytes) -> Frames:
        frames = super().feed(data)
        self._answers += [(int(ack["command_sequence"]), int(ack["reason"]), int(ack["sample_counter"])) for ack in frames.ack]
        return frames

    def play(self, begin_sample: int, end_sample: int) -> None:
        """Sends what is due, one command at a time. begin_sample, end_sample: what has been recorded."""
        seconds = (end_sample - begin_sample) / self._rate_hz
        if not self._began:
            self._writer.event("script", self._name, sample=begin_sample)
            self._began = True
        while self._segments and self._segments[0].begin_s <= seconds:
            segment = self._segments.pop(0)
            self._writer.event("segment", segment.name, sample=begin_sample + round(segment.begin_s * self._rate_hz))
        self._hear(end_sample)
        if self._open is None and self._items and time_of(self._items[0]) <= seconds:
            self._open = _Open(self._items.pop(0), 0, 0.0, end_sample, 0)
            self._send(self._open)
        elif self._open is not None and time.monotonic() - self._open.sent_s > ANSWER_S:
            self._again(self._open)

    def complaints(self) -> list[str]:
        """What did not work, in words for the person at the bench."""
        waiting = ([self._open.item] if self._open is not None else []) + self._items
        left = [f"{len(waiting)} commands of the script were not played"] if waiting else []
        return [*self._refused, *left]

    def _hear(self, now_sample: int) -> None:
        answers, self._answers = self._answers, []
        for sequence, reason, sample in answers:
            command = self._open
            if command is None or sequence != command.sequence:
                continue
            if reason == Reason.BUSY and now_sample - command.first_sample < PATIENCE_S * self._rate_hz:
                self._send(command)
                continue
            self._open = None
            self._note(command.item, reason, sample)

    def _note(self, item: Command | Burst, reason: int, sample: int) -> None:
        text = _text(item)
        if reason == Reason.OK and not isinstance(item, Burst):
            self._writer.event("command", text, sample=sample)
        elif reason != Reason.OK:
            self._writer.event("refused", f"{text}: {reason_text(reason)}", sample=sample)
            self._refused.append(f"the device refused '{text}' at {time_of(item):g} s: {reason_text(reason)}")

    def _send(self, command: _Open) -> None:
        command.sequence, command.sent_s, command.tries = self._encoder.sequence, time.monotonic(), command.tries + 1
        item = command.item
        self._port.write(self._encoder.raw_burst(item.samples) if isinstance(item, Burst) else item.encode(self._encoder, self._device))

    def _again(self, command: _Open) -> None:
        if command.tries < TRIES:
            self._send(command)
            return
        self._open = None
        self._refused.append(f"no answer to '{_text(command.item)}' at {time_of(command.item):g} s")


def _text(item: Command | Burst) -> str:
    return f"burst samples={item.samples}" if isinstance(item, Burst) else item.note()

"""An emulated device at the end of a wire: codes go in stretch by stretch, its telemetry comes out of a socket, commands come in over it."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wineglass.emulation.compare import Stretch
from wineglass.emulation.device import Device
from wineglass.link.serve import Wire

_TURN_S = 0.02


@dataclass(frozen=True)
class Heard:
    """What a device did behind a wire."""

    stretches: list[Stretch]
    """as they were played, with the commands that came over the wire at their places"""
    dac: np.ndarray
    """(n, 2) int32, drive and rebalance"""
    telemetry: bytes


def play(device: Device, stretches: Sequence[Stretch], sample_rate_hz: float, wire: Wire | None = None,
         progress: Callable[[int], None] | None = None) -> Heard:
    """All the stretches, in the device's time when somebody listens, else at once. progress(samples since the last call)."""
    played, dac, telemetry = [], [], []
    begin, samples = time.monotonic(), 0
    for stretch in stretches:
        stretch = replace(stretch, commands=stretch.commands + (wire.receive() if wire else b""))
        if stretch.commands:
            device.command(stretch.commands)
        dac.append(device.run(stretch.adc, stretch.thermometer))
        telemetry.append(device.telemetry())
        played.append(stretch)
        samples += len(stretch.adc)
        if wire:
            wire.send(telemetry[-1])
            time.sleep(max(0.0, begin + samples / sample_rate_hz - time.monotonic()))
        if progress is not None:
            progress(len(stretch.adc))
    return Heard(played, np.concatenate(dac), b"".join(telemetry))


def play_to(listener: socket.socket, device: Device, stretches: Sequence[Stretch], sample_rate_hz: float,
            progress: Callable[[int], None] | None = None, gone: Callable[[], bool] = lambda: False) -> Heard:
    """The same behind a listening socket: the device is switched on when somebody connects, or at once when nobody will (`gone`)."""
    wire = Wire(listener)
    while not wire.connected and not gone():
        wire.accept(_TURN_S)
    try:
        return play(device, stretches, sample_rate_hz, wire, progress)
    finally:
        wire.close()

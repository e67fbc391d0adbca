"""A simulated device behind a socket: the twin in real time, its telemetry out, commands in. The same bytes as a device's wire.

The device is switched on when the first client connects. While nobody is connected its telemetry is lost, as on a wire."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wineglass.errors import BadInput
from wineglass.interrupt import interrupt_noted
from wineglass.link.ports import tcp_address
from wineglass.scenario import Run
from wineglass.simulation import start
from wineglass.twin import Twin

_TICK_S = 0.02
_SEND_BUFFER = 1 << 22


class Damage:
    """A bad wire: each byte is, with probability `rate`, replaced by another one, lost, or followed by one too many."""

    def __init__(self, rate: float, seed: int) -> None:
        self._rate, self._rng = rate, np.random.default_rng(seed)

    def __call__(self, data: bytes) -> bytes:
        if self._rate == 0 or not data:
            return data
        hit = np.flatnonzero(self._rng.random(len(data)) < self._rate)
        pieces, last = [], 0
        for at in hit.tolist():
            wrong = bytes([(data[at] + int(self._rng.integers(1, 256))) & 0xFF])
            kind = int(self._rng.integers(3))
            pieces += [data[last:at], (wrong, b"", data[at:at + 1] + wrong)[kind]]
            last = at + 1
        return b"".join([*pieces, data[last:]])


@dataclass(frozen=True)
class Served:
    """What a served device did."""

    simulated_s: float
    clients: int
    bytes_sent: int


@contextmanager
def listen_unix(path: Path) -> Iterator[socket.socket]:
    """A listening socket at the path, which disappears with it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        try:
            listener.bind(str(path))
        except OSError as error:
            raise BadInput(f"no socket can be made there ({error.strerror or error})", path, "remove it, or choose another path") from None
        try:
            listener.listen()
            yield listener
        finally:
            path.unlink(missing_ok=True)


@contextmanager
def listen_tcp(where: str) -> Iterator[socket.socket]:
    """A listening socket at HOST:PORT or PORT; port 0 takes a free one."""
    try:
        listener = socket.create_server(tcp_address(where))
    except OSError as error:
        raise BadInput(f"cannot listen ({error.strerror or error})", where, "choose another port") from None
    with listener:
        yield listener


def serve(run: Run, listener: socket.socket, speed: float, byte_errors: float = 0.0,
          progress: Callable[[int], None] | None = None) -> Served:
    """Until the scenario ends or Ctrl-C. speed: simulated over real time, 0: as fast as it goes."""
    damage, slow_hz = Damage(byte_errors, run.scenario.seed), run.device.slow_rate_hz
    with Twin(run) as twin, interrupt_noted() as interrupted:
        wire = Wire(listener)
        while not wire.connected and not interrupted():
            wire.accept(0.1)
        wire.send(damage(start(twin)))
        begin = time.monotonic()
        while twin.blocks_done < run.n_blocks and not interrupted():
            due = twin.blocks_done + max(1, round(0.1 * slow_hz)) if speed == 0 else round((time.monotonic() - begin) * speed * slow_hz)
            n = min(due, run.n_blocks) - twin.blocks_done
            wire.accept(0.0 if n > 0 else _TICK_S)
            twin.command(wire.receive())
            if n > 0:
                twin.step(min(n, round(slow_hz)))
                wire.send(damage(twin.telemetry()))
                if progress is not None:
                    progress(n)
        wire.close()
        return Served(twin.blocks_done / slow_hz, wire.clients, wire.bytes_sent)


class Wire:
    """One client at a time; a newer one takes over."""

    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self._client: socket.socket | None = None
        self.clients = self.bytes_sent = 0

    @property
    def connected(self) -> bool:
        return self._client is not None

    def accept(self, timeout_s: float) -> None:
        watched = [self._listener] if self._client is None else [self._listener, self._client]
        if self._listener in select.select(watched, [], [], timeout_s)[0]:
            self.close()
            self._client = self._listener.accept()[0]
            self._client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            self._client.settimeout(10.0)
            self.clients += 1

    def receive(self) -> bytes:
        if self._client is None or not select.select([self._client], [], [], 0.0)[0]:
            return b""
        try:
            data = self._client.recv(1 << 16)
        except OSError:
            data = b""
        if not data:
            self.close()
        return data

    def send(self, data: bytes) -> None:
        if self._client is None or not data:
            return
        try:
            self._client.sendall(data)
            self.bytes_sent += len(data)
        except OSError:
            self.close()

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

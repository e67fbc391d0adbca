"""Boots a board's whole image in emulation; its serial line is a unix socket, as a serial device would be for a real board."""

from __future__ import annotations

import socket
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType

from wineglass.emulation.machines import STM32F405, Machine
from wineglass.errors import WineglassError
from wineglass.link.ports import SocketPort

_PATIENCE_S = 20.0


class Boot:
    """The emulated board, from power-up: it waits for its serial line to be connected, so no byte is lost.

    with Boot(program) as board:
        board.send(command)
        received = board.receive(seconds)
    """

    def __init__(self, program: Path, machine: Machine = STM32F405, restart: bool = False) -> None:
        """With `restart` a reset starts the image again; without it ends the emulation."""
        self._folder = tempfile.TemporaryDirectory()
        path = f"{self._folder.name}/line"
        words = [word.replace("{program}", str(program)) for word in machine.emulator if not (restart and word == "-no-reboot")]
        self.process = subprocess.Popen([words[0], "-chardev", f"socket,id=line,path={path},server=on,wait=on", *words[1:]],
                                        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._line = self._connect(path)

    def _connect(self, path: str) -> socket.socket:
        line, end = socket.socket(socket.AF_UNIX), time.monotonic() + _PATIENCE_S
        while time.monotonic() < end and self.process.poll() is None:
            try:
                line.connect(path)
                line.settimeout(0.1)
                return line
            except OSError:
                time.sleep(0.01)
        self.close()
        raise WineglassError("the emulated board does not start")

    def port(self) -> SocketPort:
        """The serial line as a port to record from and to command."""
        return SocketPort("the serial line of the emulated board", self._line)

    def send(self, message: bytes) -> None:
        self._line.sendall(message)

    def receive(self, at_least: int, patience_s: float = _PATIENCE_S) -> bytes:
        """Bytes, until there are so many or the patience is over or the emulation has ended."""
        received, end = b"", time.monotonic() + patience_s
        while len(received) < at_least and time.monotonic() < end:
            try:
                part = self._line.recv(4096)
            except TimeoutError:
                continue
            except ConnectionResetError:
                break
            if not part:
                break
            received += part
        return received

    def close(self) -> None:
        if hasattr(self, "_line"):
            self._line.close()
        self.process.kill()
        self.process.wait()
        self._folder.cleanup()

    def __enter__(self) -> Boot:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

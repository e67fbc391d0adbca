"""Where the bytes of a device come from: a serial device, a TCP or unix socket, or a file of recorded telemetry.

    with open_port("/dev/ttyUSB0") as port:     # tcp://host:port, unix:/run/gyro.sock, telemetry.bin
        port.write(CommandEncoder().ping())
        data = port.read(0.1)                   # b"" when nothing came within 0.1 s; PortClosed at the end
"""

from __future__ import annotations

import select
import socket
import stat
from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType

from wineglass.errors import BadInput, WineglassError

BAUD = 921600
_CHUNK = 1 << 16
_CONNECT_S = 5.0
_FORMS = "give a serial device, tcp://HOST:PORT, a unix socket's path, or a file of telemetry bytes"


class PortClosed(WineglassError):
    """The other side is gone, or the file is at its end."""


class Port(ABC):
    is_live = True
    """False for a file: nobody answers, and nothing more comes later"""

    def __init__(self, name: str) -> None:
        self.name = name

    @abstractmethod
    def read(self, timeout_s: float) -> bytes:
        """What has come; b"" when nothing came within the time."""

    @abstractmethod
    def write(self, data: bytes) -> None: ...

    @abstractmethod
    def close(self) -> None: ...

    def __enter__(self) -> Port:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _gone(self, error: Exception | None = None) -> PortClosed:
        why = f" ({error})" if error is not None else ""
        return PortClosed(f"{self.name}: the other side closed the connection{why}")


def open_port(name: str, baud: int = BAUD) -> Port:
    """The port that the text names; BadInput when it cannot be opened."""
    if name.startswith("tcp://"):
        return _tcp(name)
    if name.startswith("unix:"):
        return _unix(name, name.removeprefix("unix:"))
    path = Path(name)
    try:
        mode = path.stat().st_mode
    except OSError:
        raise BadInput("no such port", name, _FORMS) from None
    if stat.S_ISSOCK(mode):
        return _unix(name, name)
    if stat.S_ISCHR(mode):
        return _serial(name, baud)
    if stat.S_ISREG(mode):
        return FilePort(name)
    raise BadInput("is no port", name, _FORMS)


class SocketPort(Port):
    def __init__(self, name: str, connection: socket.socket) -> None:
        super().__init__(name)
        self._socket = connection
        connection.settimeout(_CONNECT_S)

    def read(self, timeout_s: float) -> bytes:
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return b""
        try:
            data = self._socket.recv(_CHUNK)
        except OSError as error:
            raise self._gone(error) from None
        if not data:
            raise self._gone()
        return data

    def write(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise self._gone(error) from None

    def close(self) -> None:
        self._socket.close()


class SerialPort(Port):
    def __init__(self, name: str, baud: int) -> None:
        import serial

        super().__init__(name)
        try:
            self._serial = serial.Serial(name, baud, exclusive=True, write_timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            raise BadInput(f"cannot be opened ({_last_words(error)})", name, "check the cable, your rights and who else uses it") from None
        self._trouble = (serial.SerialException, OSError)

    def read(self, timeout_s: float) -> bytes:
        try:
            self._serial.timeout = timeout_s
            first = self._serial.read(1)
            return first + self._serial.read(self._serial.in_waiting) if first else b""
        except self._trouble as error:
            raise self._gone(error) from None

    def write(self, data: bytes) -> None:
        try:
            self._serial.write(data)
        except self._trouble as error:
            raise self._gone(error) from None

    def close(self) -> None:
        self._serial.close()


class FilePort(Port):
    """Telemetry bytes as they once came; commands go nowhere."""

    is_live = False

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._file = open(name, "rb")
        self.size_bytes = Path(name).stat().st_size

    def read(self, timeout_s: float) -> bytes:
        data = self._file.read(_CHUNK)
        if not data:
            raise PortClosed(f"{self.name}: end of the file")
        return data

    def write(self, data: bytes) -> None:
        raise BadInput("a file takes no commands", self.name, "give the port of a device")

    def close(self) -> None:
        self._file.close()


def tcp_address(name: str) -> tuple[str, int]:
    """Host and port number of tcp://HOST:PORT, or of HOST:PORT or PORT alone."""
    host, _, number = name.removeprefix("tcp://").rpartition(":")
    if not number.isdigit() or not 0 <= int(number) < 65536:
        raise BadInput("no port number", name, "write tcp://HOST:PORT")
    return host.strip("[]") or "localhost", int(number)


def _tcp(name: str) -> SocketPort:
    address = tcp_address(name)
    try:
        connection = socket.create_connection(address, timeout=_CONNECT_S)
    except OSError as error:
        raise BadInput(f"no connection ({_last_words(error)})", name, "check that the device is there") from None
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return SocketPort(name, connection)


def _unix(name: str, path: str) -> SocketPort:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.settimeout(_CONNECT_S)
        connection.connect(path)
    except OSError as error:
        connection.close()
        raise BadInput(f"no connection ({_last_words(error)})", name, "check that the device is there") from None
    return SocketPort(name, connection)


def _serial(name: str, baud: int) -> SerialPort:
    return SerialPort(name, baud)


def _last_words(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).lower()

"""Ctrl-C as a wish, not as an accident."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def interrupt_noted() -> Iterator[Callable[[], bool]]:
    """Ctrl-C (or SIGTERM) is noted instead of raised; yields a function that says whether it came. Outside the main thread nothing changes."""
    noted = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield noted.is_set
        return

    def note(number: int, frame: FrameType | None) -> None:
        noted.set()

    before: list[Any] = [signal.signal(number, note) for number in _SIGNALS]
    try:
        yield noted.is_set
    finally:
        for number, handler in zip(_SIGNALS, before, strict=True):
            signal.signal(number, handler)

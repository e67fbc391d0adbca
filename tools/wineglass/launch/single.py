"""One set-up at a time in one working tree."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wineglass.launch.notice import Notice, SetupError


@contextmanager
def only_one(root: Path, notice: Notice) -> Iterator[None]:
    """Holds the tree's set-up lock; the system releases it when the process ends in whatever way. Programs started
    meanwhile inherit it: if this process is killed, the next one waits for what they are still doing."""
    path = root / "build" / "setup.lock"
    try:
        path.parent.mkdir(exist_ok=True)
        stream = open(path, "a", encoding="ascii")
    except OSError as error:
        raise SetupError(f"cannot write {path} ({error.strerror}); make the working tree writable", 2) from error
    with stream:
        os.set_inheritable(stream.fileno(), True)
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            notice.say("waiting for the set-up that another process is doing")
            fcntl.flock(stream, fcntl.LOCK_EX)
        yield

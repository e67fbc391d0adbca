"""Errors that the user can do something about."""

from __future__ import annotations


class WineglassError(Exception):
    """One line for the user, no traceback. `exit_status` becomes the status of the process."""

    exit_status = 1


class BadInput(WineglassError):
    """The input is wrong: what is wrong, where it stands, and what to do about it.

    >>> str(BadInput("the rate has no unit", "sweep.csv, column 3", "add --unit gyro_a=rad/s"))
    'sweep.csv, column 3: the rate has no unit; add --unit gyro_a=rad/s'
    """

    exit_status = 2

    def __init__(self, what: str, where: object = "", todo: str = "") -> None:
        self.what = str(what)
        self.where = str(where)
        self.todo = str(todo)
        super().__init__(self.what, self.where, self.todo)

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        if self.todo:
            text = f"{text}; {self.todo}"
        return " ".join(text.split())

"""Builds each machine once; a machine whose compiler or emulator is absent is skipped."""

import pytest

from wineglass.commands_wire import CommandEncoder
from wineglass.emulation import codes
from wineglass.emulation.machines import M4

_built: set[str] = set()


def make_ready(machine):
    if machine.missing():
        pytest.skip(f"{' and '.join(machine.missing())} not installed")
    if machine.preset not in _built:
        machine.build()
        _built.add(machine.preset)
    return machine


@pytest.fixture
def m4():
    return make_ready(M4)


@pytest.fixture(scope="session")
def cold_start():
    """Power-up to lock and on, with all that a user might ask of a device in between."""
    send = CommandEncoder()
    return codes.record("cold-start", 1600, rebalance=True, commands={
        0: send.ping(), 700: send.status() + send.output_filter("0.1"), 800: send.compensation("static"),
        900: send.compensation("none") + b"\x05nonsense\x00", 1000: send.compensation("g2") + send.raw_burst(300),
        1100: send.loop("rebalance"), 1200: send.test_signal(0.1, 0.05, 20.0, 5000.0) + send.divisors(1, 3),
        1300: send.amplitude(0.5) + send.phase_set_point(0.2), 1350: send.drive(False), 1400: send.amplitude(1.5) + send.drive(True),
        1500: send.restart(),
    })

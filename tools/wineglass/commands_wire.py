"""Commands for the device, as frames. One encoder numbers the commands of one connection; the answer repeats the number."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum

from wineglass import wire
from wineglass.calibration_block import COMPENSATIONS, LOOPS, OUTPUT_FILTERS
from wineglass.errors import BadInput

CHUNK_BYTES = 256
PHASE_MEAN_TICKS = 50
"""slow ticks per mean of a phase calibration, firmware/application/phase_calibration.h"""


class Command(IntEnum):
    PING = 0x81
    STATUS = 0x82
    COMPENSATION = 0x83
    AMPLITUDE = 0x84
    PLL_GAINS = 0x85
    AGC_GAINS = 0x86
    OUTPUT_FILTER = 0x87
    DIVISORS = 0x88
    RAW_BURST = 0x89
    RESTART = 0x8A
    LOOP = 0x8B
    REBALANCE = 0x8C
    TEST_SIGNAL = 0x8D
    PHASE_SET_POINT = 0x8E
    PHASE_CALIBRATION = 0x8F
    CALIBRATION_UNLOCK = 0x90
    CALIBRATION_WRITE = 0x91
    CALIBRATION_COMMIT = 0x92
    CALIBRATION_READ = 0x93
    PHASES_STORE = 0x94
    DRIVE = 0x95


@dataclass(frozen=True)
class PhaseOrder:
    """What a phase calibration shall do. settle: after a step of the drive's set-point, and of the open secondary's test force."""

    settle_drive_s: float
    settle_demodulation_s: float
    measure_s: float = 1.0
    phase_rad: float = 0.2
    quadrature_fs: float = 0.05
    drive: bool = True
    demodulation: bool = True
    apply: bool = False
    """what is found stays in force until the next start"""


class Reason(IntEnum):
    """Answers to commands: the numbers of firmware/application/reason.h."""

    OK = 0
    UNKNOWN_COMMAND = 1
    FRAME_VERSION = 2
    LENGTH = 3
    OUT_OF_RANGE = 4
    LOCKED = 5
    WRONG_KEY = 6
    BUSY = 7
    NOTHING_STORED = 8
    STORE_FAILED = 9
    UNSTABLE = 10
    NOT_LOCKED = 11
    NO_RESULT = 12
    CALIBRATION_SIZE = 16
    CALIBRATION_MAGIC = 17
    CALIBRATION_VERSION = 18
    CALIBRATION_CRC = 19
    CALIBRATION_RANGE = 20
    CALIBRATION_CONFLICT = 21
    CALIBRATION_BOARD = 22
    CALIBRATION_UNSTABLE = 23
    SNAPSHOT_VERSION = 24
    SNAPSHOT_RANGE = 25
    SNAPSHOT_BOARD = 26


def unlock_key(unique_id: int) -> int:
    return zlib.crc32(struct.pack("<Q", unique_id))


class CommandEncoder:
    """Methods return the bytes to send. `sequence` is the number that the next command will carry.

    Fixed-point arguments are given in SI or as parts of full scale; what the firmware then finds out of range it refuses itself.
    """

    def __init__(self, first_sequence: int = 0):
        self.sequence = first_sequence

    def frame(self, command: int, payload: bytes = b"") -> bytes:
        data = wire.encode(command, self.sequence, payload)
        self.sequence = (self.sequence + 1) & 0xFFFF
        return data

    def ping(self) -> bytes:
        """Answered by an identity frame."""
        return self.frame(Command.PING)

    def status(self) -> bytes:
        return self.frame(Command.STATUS)

    def compensation(self, mode: str) -> bytes:
        """none, static or g2"""
        return self.frame(Command.COMPENSATION, _u32(_index(COMPENSATIONS, mode, "compensation")))

    def loop(self, mode: str) -> bytes:
        """open or rebalance"""
        return self.frame(Command.LOOP, _u32(_index(LOOPS, mode, "loop")))

    def output_filter(self, corner: str) -> bytes:
        """none, 0.01, 0.025, 0.05 or 0.1 of the slow tick's rate"""
        return self.frame(Command.OUTPUT_FILTER, _u32(_index(OUTPUT_FILTERS, corner, "output filter")))

    def amplitude(self, set_point_fs: float) -> bytes:
        return self.frame(Command.AMPLITUDE, _i32(set_point_fs, 30))

    def pll_gains(self, kp_per_s: float, ki_per_s2: float, sample_rate_hz: float, decimation: int) -> bytes:
        loop_rate_hz = sample_rate_hz / decimation
        return self.frame(Command.PLL_GAINS,
                          _i32(kp_per_s / sample_rate_hz, 32) + _i32(ki_per_s2 / (sample_rate_hz * loop_rate_hz), 32))

    def agc_gains(self, kp: float, ki_per_s: float, loop_rate_hz: float) -> bytes:
        return self.frame(Command.AGC_GAINS, _i32(kp, 16) + _i32(ki_per_s / loop_rate_hz, 24))

    def rebalance(self, kp: float, ki_per_s: float, loop_rate_hz: float, in_phase_limit_fs: float,
                  quadrature_limit_fs: float) -> bytes:
        payload = _i32(kp, 16) + _i32(ki_per_s / loop_rate_hz, 24) + _i32(in_phase_limit_fs, 31) + _i32(quadrature_limit_fs, 31)
        return self.frame(Command.REBALANCE, payload)

    def test_signal(self, in_phase_fs: float, quadrature_fs: float, frequency_hz: float, loop_rate_hz: float) -> bytes:
        """Force on the secondary axis, of DAC full scale; frequency 0: a constant; both forces 0: off."""
        return self.frame(Command.TEST_SIGNAL,
                          _i32(in_phase_fs, 31) + _i32(quadrature_fs, 31) + _u32(round(frequency_hz / loop_rate_hz * 2**32)))

    def phase_set_point(self, phase_deg: float) -> bytes:
        return self.frame(Command.PHASE_SET_POINT, _i32(phase_deg / 360.0, 32))

    def drive(self, on: bool) -> bytes:
        """Off: no force, the shell rings down; on: the amplitude loop goes on where it stopped."""
        return self.frame(Command.DRIVE, _u32(int(on)))

    def phase_calibration(self, order: PhaseOrder, slow_rate_hz: float) -> bytes:
        """Answered by a phases frame when it is done; the rate is invalid until then."""
        mean_s = PHASE_MEAN_TICKS / slow_rate_hz
        times = [max(1, round(seconds / mean_s)) for seconds in (order.settle_drive_s, order.settle_demodulation_s, order.measure_s)]
        if not (order.drive or order.demodulation):
            raise BadInput("nothing is to be calibrated", "phase calibration", "ask for drive, demodulation, or both")
        parts = order.drive * 1 + order.demodulation * 2 + order.apply * 4
        try:
            payload = struct.pack("<IHHHH", parts, *times, 0)
        except struct.error:
            raise BadInput(f"a step of a phase calibration lasts at most {65535 * mean_s:g} s", "command", "give shorter times") from None
        payload += _i32(order.phase_rad / (2.0 * math.pi), 32) + _i32(order.quadrature_fs, 31)
        return self.frame(Command.PHASE_CALIBRATION, payload)

    def phase_calibration_abort(self) -> bytes:
        return self.frame(Command.PHASE_CALIBRATION, bytes(20))

    def phases_store(self) -> bytes:
        """Add what the last phase calibration has found to the stored calibration; unlock it first."""
        return self.frame(Command.PHASES_STORE)

    def divisors(self, baseband: int, output: int) -> bytes:
        """Slow ticks per baseband and per output frame; 0 = none."""
        for name, value in (("baseband divisor", baseband), ("output divisor", output)):
            if not 0 <= value <= 65535:
                raise BadInput(f"{value} slow ticks per frame are impossible", name, "give 0 (off) to 65535")
        return self.frame(Command.DIVISORS, struct.pack("<HH", baseband, output))

    def raw_burst(self, samples: int) -> bytes:
        return self.frame(Command.RAW_BURST, _u32(samples))

    def restart(self) -> bytes:
        """Acquisition from cold."""
        return self.frame(Command.RESTART)

    def calibration_unlock(self, unique_id: int) -> bytes:
        return self.frame(Command.CALIBRATION_UNLOCK, _u32(unlock_key(unique_id)))

    def calibration_write(self, offset: int, data: bytes) -> bytes:
        return self.frame(Command.CALIBRATION_WRITE, struct.pack("<H", offset) + data)

    def calibration_commit(self, size: int) -> bytes:
        return self.frame(Command.CALIBRATION_COMMIT, _u32(size))

    def calibration_read(self) -> bytes:
        return self.frame(Command.CALIBRATION_READ)

    def calibration(self, block: bytes, unique_id: int) -> bytes:
        """Everything it takes to store and activate a block: unlock, write in chunks, commit."""
        parts = [self.calibration_unlock(unique_id)]
        parts += [self.calibration_write(at, block[at:at + CHUNK_BYTES]) for at in range(0, len(block), CHUNK_BYTES)]
        parts.append(self.calibration_commit(len(block)))
        return b"".join(parts)


def _index(choices: tuple[str, ...], choice: str, name: str) -> int:
    if choice not in choices:
        raise BadInput(f"{choice!r} is unknown", name, f"choose one of: {', '.join(choices)}")
    return choices.index(choice)


def _u32(value: int) -> bytes:
    if not 0 <= value < 2**32:
        raise BadInput(f"{value} does not fit 32 bit", "command", "give a smaller value")
    return struct.pack("<I", value)


def _i32(value: float, bits: int) -> bytes:
    """Fixed point, rounded half to even."""
    number = round(value * 2.0**bits)
    if not -(2**31) <= number < 2**31:
        raise BadInput(f"{value:g} does not fit the firmware's format", "command", f"stay within ±{2.0**(31 - bits):g}")
    return struct.pack("<i", number)

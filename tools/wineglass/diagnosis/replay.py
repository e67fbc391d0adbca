"""Replay: recorded codes through the recorded state must give the recorded forces and telemetry bit for bit. Where they do not, the gap lies in
the firmware, and everything else waits.

    replay = check(recording)
    replay.ok, replay.first_difference

Three looks, each as far as the recording allows: force codes and telemetry of every raw burst; the configuration in its snapshots against the
calibration block; and, raw or not, the recorded rate against what the calibration makes of the recorded baseband (output_check.py).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from wineglass.calibration_block import from_json, to_binary
from wineglass.diagnosis import configuration_check, replayed
from wineglass.diagnosis.configuration_check import Deviation
from wineglass.diagnosis.replayed import NotReplayable, Replayed
from wineglass.errors import BadInput
from wineglass.recording.reader import Recording, Tap
from wineglass.telemetry import Conversion, conversions, worst_status
from wineglass.wire import GOOD_STATUS

FIRST_DRIVE_SLOT, FIRST_REBALANCE_SLOT = 3, 4
"""sample of a loop tick at which a force computed in it goes out first: firmware/core/gyro_loop.c"""
SCATTERED = 0.005
"""share of differing samples below which the loops, which never forget, are not the cause"""
PUBLICATION_SLOT = 6
"""samples from the start of a slow period to its publication"""

_DAC = ("drive_dac_raw", "rebalance_dac_raw")
_BLAME = (
    ("baseband", ("primary_in_phase", "primary_quadrature"), "lock-in of the primary"),
    ("baseband", ("secondary_in_phase", "secondary_quadrature"), "decoupler or lock-in of the secondary"),
    ("baseband", ("drive_frequency", "drive_level", "amplitude_set_point"), "drive loop"),
    ("baseband", ("rebalance_in_phase", "rebalance_quadrature"), "rebalance"),
    ("output", ("temperature_measured",), "thermometer"),
    ("output", ("rate_uncompensated", "quadrature"), "rate"),
    ("output", ("rate", "angle"), "compensation"),
    ("baseband", ("status",), "monitors"),
)
"""in the order of the signal's way: the first that differs at an instant is the module"""

Stored = dict[tuple[str, str], np.ndarray]
"""codes that were read already, by tap and channel"""


@dataclass(frozen=True)
class Difference:
    """sample: on the common counter, the first one at which the difference can be seen"""

    burst: int
    sample: int
    module: str
    what: str


@dataclass(frozen=True)
class Replay:
    """ok: None when nothing could be checked. bursts: all there are; checked: numbers of those that were replayed."""

    ok: bool | None
    bursts: int
    checked: list[int]
    samples: int
    intervals: int
    """telemetry intervals that lay inside a burst and were compared, too"""
    first_difference: Difference | None
    differing_bursts: list[int]
    configuration: list[Deviation] = field(default_factory=list)
    """fields of the device's configuration that neither the calibration block nor a command explains"""
    commanded: list[Deviation] = field(default_factory=list)
    """fields that differ from the block and that commands can change"""
    not_checked: list[str] = field(default_factory=list)

    def sentence(self) -> str:
        if self.ok is None:
            return "nothing could be replayed: " + "; ".join(self.not_checked)
        if self.first_difference is not None:
            first = self.first_difference
            return f"burst {first.burst} differs at sample {first.sample} first, in the {first.module} ({first.what})"
        if self.configuration:
            return "the device does not compute with its calibration block: " + ", ".join(item.says() for item in self.configuration)
        return f"{self.samples} samples of {len(self.checked)} bursts and {self.intervals} telemetry intervals replay bit for bit"


def check(recording: Recording) -> Replay:
    """Every raw burst through this firmware."""
    if not recording.bursts:
        return Replay(None, 0, [], 0, 0, None, [], not_checked=["the recording has no raw burst"])
    block, notes = block_of(recording)
    checked, differences, samples, intervals = [], [], 0, 0
    deviations: dict[str, Deviation] = {}
    stored: Stored = {}
    refused: dict[str, list[int]] = {}
    for number, burst in enumerate(recording.bursts):
        try:
            again = replayed.run(burst, block)
        except NotReplayable as reason:
            refused.setdefault(str(reason), []).append(number)
            continue
        checked.append(number)
        samples += len(burst)
        compared = _Comparison(recording, number, burst, again, stored)
        intervals += compared.intervals
        differences += compared.first()
        if block:
            found = configuration_check.deviations(burst.state_snapshot, block, replayed.Converters.of(burst))
            deviations = {item.name: item for item in found} | deviations
    notes += [f"{_bursts(numbers)} cannot be replayed: {reason}" for reason, numbers in refused.items()]
    notes += [f"firmware version {recording.firmware_version} was recorded"] if recording.firmware_version and not checked else []
    wrong = [item for item in deviations.values() if not item.commandable]
    first = min(differences, key=lambda d: d.sample, default=None)
    ok = None if not checked else first is None and not wrong
    return Replay(ok, len(recording.bursts), checked, samples, intervals, first, sorted({d.burst for d in differences}), wrong,
                  [item for item in deviations.values() if item.commandable], notes)


def _bursts(numbers: list[int]) -> str:
    """'burst 3', or 'bursts 0 to 13' and the like."""
    if len(numbers) == 1:
        return f"burst {numbers[0]}"
    whole = numbers == list(range(numbers[0], numbers[-1] + 1))
    return f"bursts {numbers[0]} to {numbers[-1]}" if whole else "bursts " + ", ".join(map(str, numbers))


def block_of(recording: Recording) -> tuple[bytes, list[str]]:
    """The recorded calibration as the firmware loads it (empty: none), and what is wrong with it."""
    if recording.calibration_block:
        return recording.calibration_block, []
    if recording.calibration_json:
        try:
            return to_binary(from_json(recording.calibration_json)), []
        except BadInput as error:
            return b"", [f"the recorded calibration cannot be read ({error.what})"]
    return b"", ["the recording has no calibration block to hold the device's configuration against"]


class _Comparison:
    """A burst beside its replay."""

    def __init__(self, recording: Recording, number: int, burst: Tap, again: Replayed, stored: Stored):
        self._number, self._burst, self._again = number, burst, again
        self._slot0 = _slot_origin(again)
        self.intervals = 0
        self._found = self._forces()
        table = conversions(again.identity)
        records = {"baseband": again.frames.baseband, "output": again.frames.output}
        for tap in records:
            if tap in recording:
                self._telemetry(recording.tap(tap), records[tap], table[tap], stored)

    def first(self) -> list[Difference]:
        """The earliest difference; of those at one instant the one that comes first on the signal's way."""
        return sorted(self._found, key=lambda d: d.sample)[:1]

    def _forces(self) -> list[Difference]:
        """Forces that differ, the earliest of each kind."""
        found = []
        for column, channel in enumerate(_DAC):
            if channel not in self._burst:
                continue
            recorded = self._burst.codes(channel)
            wrong = np.flatnonzero(recorded != self._again.dac[:, column])
            if len(wrong):
                at = int(wrong[0])
                what = f"{channel} is {int(recorded[at])}, replayed {int(self._again.dac[at, column])}; {len(wrong)} of {len(recorded)} samples differ"
                module = self._module_of_force(column, wrong)
                found.append(Difference(self._number, self._burst.first_sample + at, module, what))
        return found

    def _module_of_force(self, column: int, wrong: np.ndarray) -> str:
        """Until the first new force goes out, oscillator and shaper alone make the codes; a lasting difference after that comes from the loop."""
        name, slot = (("drive", FIRST_DRIVE_SLOT), ("rebalance", FIRST_REBALANCE_SLOT))[column]
        new_force = (self._slot0 + slot - self._burst.first_sample) % self._again.identity.decimation
        if wrong[0] < new_force:
            return f"oscillator or DAC shaper of the {name}"
        alone = len(wrong) < SCATTERED * (len(self._burst) - wrong[0])
        loop = "drive loop" if column == 0 else "rebalance"
        return f"DAC shaper of the {name}" if alone else f"{loop} or what feeds it"

    def _telemetry(self, tap: Tap, records: np.ndarray, table: dict[str, Conversion], stored: Stored) -> None:
        """Means over the intervals that lie inside the burst."""
        period = self._again.identity.slow_period_samples
        ticks = round(tap.counter_rate_hz / tap.sample_rate_hz / period)
        if ticks < 1 or len(records) < ticks:
            return
        samples = ticks * period
        counters = records["sample_counter"].astype(np.int64)
        ends = tap.first_sample + samples // 2 + np.arange(len(tap), dtype=np.int64) * samples
        rows = np.flatnonzero((ends >= counters[ticks - 1]) & (ends <= counters[-1]) & ~tap.lost)
        last = np.searchsorted(counters, ends[rows])
        rows, last = rows[counters[last] == ends[rows]], last[counters[last] == ends[rows]]
        self.intervals += len(rows)
        for name, module in ((name, module) for of, names, module in _BLAME if of == tap.name for name in names):
            if name not in tap or name not in table or len(rows) == 0:
                continue
            expected = np.array([_mean(records[at - ticks + 1:at + 1], table[name], name) for at in last], dtype=object)
            wrong = np.flatnonzero(_differ(tap, name, rows, expected, table[name], stored))
            if len(wrong):
                at = int(wrong[0])
                what = f"{name} of the interval is {tap[name][rows[at]]:.9g}, replayed {_value(expected[at], table[name]):.9g}"
                self._found.append(Difference(self._number, int(ends[rows[at]]), module, what))


def _slot_origin(again: Replayed) -> int:
    """A sample with which a loop tick begins."""
    ticks = again.frames.output["sample_counter"]
    return int(ticks[0]) - PUBLICATION_SLOT if len(ticks) else again.first_sample - PUBLICATION_SLOT


def _mean(records: np.ndarray, conversion: Conversion, name: str) -> int:
    """As the firmware takes it: mean, rounded half up; the angle as it stands at the end; good status bits only if always set."""
    if name == "status":
        words, good = worst_status(records), np.uint32(GOOD_STATUS)
        return int(np.bitwise_and.reduce(words) & good | np.bitwise_or.reduce(words) & ~good)
    values = [int(value) for value in records[conversion.field]]
    if name == "angle":
        return values[-1] - 2**64 if values[-1] >= 2**63 else values[-1]
    return (2 * sum(values) + len(values)) // (2 * len(values))


def _value(code: int, conversion: Conversion) -> float:
    return code * conversion.scale + conversion.offset


def _differ(tap: Tap, name: str, rows: np.ndarray, expected: np.ndarray, conversion: Conversion, cache: Stored) -> np.ndarray:
    """Bit for bit where the recording holds the device's integers, else to the rounding of what it holds; (n,) bool."""
    if (tap.name, name) not in cache:
        cache[tap.name, name] = tap.codes(name)
    stored = cache[tap.name, name]
    if stored.dtype.kind in "iu":
        return np.array([int(stored[row]) != code for row, code in zip(rows, expected, strict=True)])
    values = np.array([_value(code, conversion) for code in expected])
    step = conversion.scale + np.finfo(stored.dtype).eps * np.abs(values)
    return np.abs(tap[name][rows] - values) > step

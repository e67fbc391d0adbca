"""The same codes through every machine: the same DAC codes, the same telemetry bytes, the same state, to the last bit."""

import dataclasses
import struct

import numpy as np
import pytest
from conftest import make_ready

from wineglass import scenario
from wineglass.emulation import fields, loop
from wineglass.emulation.compare import Stretch, compare
from wineglass.emulation.device import THERMOMETER_SILENT, Board, HostDevice, StreamDevice
from wineglass.emulation.machines import MACHINES
from wineglass.errors import WineglassError

SEED = 20250611


@pytest.fixture(params=MACHINES, ids=lambda machine: machine.preset)
def machine(request):
    return make_ready(request.param)


def hostile_stretches(adc_bits: int) -> list[Stretch]:
    """Codes no resonator sends: noise at every level, steps between the limits, silence; the thermometer too."""
    rng = np.random.default_rng(SEED)
    full = 2 ** (adc_bits - 1)
    stretches = []
    for index in range(60):
        level = 2.0 ** rng.integers(1, adc_bits)
        adc = np.rint(rng.uniform(-level, level, (250, 2)))
        if index % 5 == 0:
            adc = rng.choice([-full, full - 1, 0], (250, 2))
        thermometer = [THERMOMETER_SILENT, 2**31 - 1, -(2**31) + 1, int(rng.integers(-20_000, 20_000))][rng.integers(0, 4)]
        stretches.append(Stretch(np.clip(adc, -full, full - 1).astype(np.int32), thermometer))
    return stretches


def test_replay_is_what_the_twin_did(cold_start):
    device = HostDevice(cold_start.board, cold_start.block)
    dac, telemetry = [], b""
    for stretch in cold_start.stretches:
        if stretch.commands:
            device.command(stretch.commands)
        dac.append(device.run(stretch.adc, stretch.thermometer))
        telemetry += device.telemetry()
    assert np.array_equal(np.concatenate(dac), cold_start.dac)
    assert telemetry == cold_start.telemetry and len(telemetry) > 20_000


def test_cold_start_with_commands(machine, cold_start):
    difference, telemetry_bytes = compare(lambda: HostDevice(cold_start.board, cold_start.block),
                                          lambda: StreamDevice(machine, cold_start.board, cold_start.block), cold_start.stretches)
    assert difference is None, f"{machine.preset}: {difference}"
    assert telemetry_bytes == len(cold_start.telemetry)


@pytest.mark.parametrize("board", [Board(), Board(adc_bits=24, dac_bits=24), Board(adc_bits=32, dac_bits=8, serial=2**63 + 5)],
                         ids=lambda board: f"{board.adc_bits}-{board.dac_bits}-bit")
def test_hostile_codes(machine, board):
    difference, _ = compare(lambda: HostDevice(board), lambda: StreamDevice(machine, board), hostile_stretches(board.adc_bits))
    assert difference is None, f"{machine.preset}: {difference}"


def test_processor_in_the_loop(m4):
    """The M4 closes the loop around the plant and locks, and does so as the host does."""
    run = scenario.prepare(scenario.load("cold-start"))
    thermometer = round((run.initial_degc - run.device.electronics.thermometer.zero_degc) / run.device.electronics.thermometer.lsb_degc)
    closed = []
    for device in (StreamDevice(m4, loop.board_of(run)), HostDevice(loop.board_of(run))):
        closed.append(loop.close_loop(device, run, 15_000, thermometer))
        closed.append(device.telemetry())
        device.close()
    assert np.array_equal(closed[0], closed[2]) and closed[1] == closed[3]
    amplitude = np.abs(closed[0][-1000:, 0]).max() / 2**15
    assert amplitude > 0.02, "the resonator does not ring"


# ---- what is wrong is found ------------------------------------------------------------------------------------------------


class Tampered(HostDevice):
    """Reads one primary code wrong, once."""

    def __init__(self, board, block, sample):
        super().__init__(board, block)
        self.left = sample

    def run(self, adc, thermometer=THERMOMETER_SILENT):
        adc = adc.copy()
        if 0 <= self.left < len(adc):
            adc[self.left, 0] ^= 4
        self.left -= len(adc)
        return super().run(adc, thermometer)


@pytest.mark.parametrize("sample", [0, 12_345, 12_349, 12_350])
def test_first_wrong_sample_is_named(cold_start, sample):
    difference, _ = compare(lambda: HostDevice(cold_start.board, cold_start.block),
                            lambda: Tampered(cold_start.board, cold_start.block, sample), cold_start.stretches[:600])
    assert difference is not None and difference.sample == sample and difference.what == "primary_lockin"


def test_a_wrong_table_entry_on_the_target_is_named(m4, cold_start, tmp_path):
    """One bit of the sine table in the M4's image is flipped: lock-in and force see it in the same sample, and the lock-in stands first in the chain."""
    image = bytearray(m4.program().read_bytes())
    table = image.find(struct.pack("<4i", 2**30, 0, 1072448455, 52686014))
    assert table > 0
    image[table + 8 * 17 + 1] ^= 0x10
    broken = tmp_path / "broken"
    broken.write_bytes(image)
    other = dataclasses.replace(m4, emulator=tuple(word.replace("{program}", str(broken)) for word in m4.emulator))
    difference, _ = compare(lambda: HostDevice(cold_start.board, cold_start.block),
                            lambda: StreamDevice(other, cold_start.board, cold_start.block), cold_start.stretches[:600])
    assert difference is not None and difference.what == "primary_lockin" and difference.sample > 0


def test_fields_cover_the_snapshot(cold_start):
    snapshot = HostDevice(cold_start.board, cold_start.block).snapshot()
    last = fields.fields()[-1]
    assert last.offset + last.size == len(snapshot)
    changed = bytearray(snapshot)
    changed[last.offset] ^= 1
    assert fields.differing(snapshot, bytes(changed)) == [last]


def test_a_request_that_breaks_the_rules_ends_the_server(m4):
    device = StreamDevice(m4, Board())
    with pytest.raises(WineglassError, match="ended with status 2"):
        device._ask(99, b"")
    device.close()


def test_a_bad_calibration_block_is_refused(m4):
    with pytest.raises(WineglassError, match="refused"):
        StreamDevice(m4, Board(adc_bits=7))

"""The image for the board: sizes, stack, seal, and a boot of the real thing where clocks, DMA, flash and codec are missing."""

import contextlib
import io
import runpy
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from conftest import make_ready

from wineglass.commands_wire import CommandEncoder, Reason
from wineglass.cost import image
from wineglass.emulation.boot import Boot
from wineglass.emulation.device import Board, HostDevice
from wineglass.emulation.machines import STM32F405
from wineglass.telemetry import Decoder, Identity, merge
from wineglass.wire import Part

ROOT = Path(__file__).resolve().parents[2]
FLASH_START, STORE_START = 0x08000000, 0x0800C000
MISSING = {Part.CRYSTAL, Part.CORE_CLOCK, Part.SAMPLE_CLOCK, Part.CONVERTERS, Part.THERMOMETER, Part.STORE, Part.WATCHDOG, Part.UNIQUE_ID}


@pytest.fixture(scope="module")
def program() -> Path:
    make_ready(STM32F405)
    return image.program()


def parts(mask) -> set[Part]:
    return {part for part in Part if int(mask) & part}


def until(board: Boot, decoder: Decoder, enough, patience: int = 100):
    """Frames until `enough(frames)`."""
    frames = decoder.feed(b"")
    for _ in range(patience):
        frames = merge([frames, decoder.feed(board.receive(1, 1.0))])
        if enough(frames):
            return frames
    raise AssertionError(f"not enough came: {decoder.statistics}")


# ---- what it takes ---------------------------------------------------------------------------------------------------------


def test_bars(program):
    found = image.measure()
    assert found.flash_bytes <= image.FLASH_BAR_BYTES and found.memory_bytes <= image.MEMORY_BAR_BYTES, found
    assert found.stack_bytes <= found.stack_reserved_bytes, found.paths
    assert found.sample_path_forbidden == []


def test_all_forms_hold_the_same_sealed_program(program):
    binary = program.with_suffix(".bin").read_bytes()
    assert zlib.crc32(binary[:-4]) == struct.unpack("<I", binary[-4:])[0]
    assert hex_bytes(program.with_suffix(".hex")) == {FLASH_START + at: value for at, value in enumerate(binary)}
    assert FLASH_START + len(binary) <= STORE_START
    assert program.with_suffix(".map").is_file() and ".text" in program.with_suffix(".size").read_text()


def hex_bytes(path: Path) -> dict[int, int]:
    """Address -> byte, of an Intel HEX file."""
    found, base = {}, 0
    for line in path.read_text().split():
        record = bytes.fromhex(line[1:])
        assert sum(record) & 0xFF == 0
        count, address, kind, data = record[0], int.from_bytes(record[1:3], "big"), record[3], record[4:-1]
        assert len(data) == count
        if kind == 4:
            base = int.from_bytes(data, "big") << 16
        elif kind == 0:
            found |= {base + address + at: value for at, value in enumerate(data)}
    return found


THERMOMETER = ["thermometer_code_at_reference=3200", "thermometer_degc_per_lsb=0.0078125"]


@pytest.mark.parametrize("rate, arguments", [
    (50000, ["sample_rate_hz=50000.0"]), (48000, ["sample_rate_hz=47991.071"]), (96000, ["sample_rate_hz=95982.142", "decimation=20"]),
])
def test_compiled_in_calibrations_are_the_generated_ones(rate, arguments, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["default_calibration.py", *arguments, *THERMOMETER])
    with contextlib.redirect_stdout(io.StringIO()) as text:
        runpy.run_path(str(ROOT / "tools/tables/default_calibration.py"), run_name="__main__")
    assert text.getvalue() == (ROOT / f"hal/stm32f405/calibration_{rate}.c").read_text()


@pytest.mark.parametrize("rate", [48000, 96000])
def test_other_sample_rates_boot(program, rate):
    """The sample rate that the clocks give and that of the compiled-in block agree, else there would be no identity."""
    with Boot(program.with_stem(f"{program.stem}_{rate}")) as board:
        frames = until(board, Decoder(), lambda frames: len(frames.identity))
    assert Identity.of(frames.identity[0]).sample_rate_hz == pytest.approx(rate, rel=2e-4)


def test_bringup_image_boots(program):
    """The same application with the internal converters: it says how many bits they have."""
    bringup = program.with_stem(f"{program.stem}_bringup")
    with Boot(bringup) as board:
        frames = until(board, decoder := Decoder(), lambda frames: len(frames.output) >= 2)
    identity = Identity.of(frames.identity[0])
    assert (identity.sample_rate_hz, identity.adc_bits, identity.dac_bits) == (50_000, 12, 12)
    assert parts(frames.self_test["failed"][0]) == MISSING and decoder.statistics.bad_crc == 0
    assert zlib.crc32((binary := bringup.with_suffix(".bin").read_bytes())[:-4]) == struct.unpack("<I", binary[-4:])[0]


# ---- boot ------------------------------------------------------------------------------------------------------------------


def test_boot_reports_what_is_missing(program):
    """No clock becomes ready here: the time-outs end, the processor stays on its internal oscillator and says so."""
    decoder = Decoder()
    with Boot(program) as board:
        frames = until(board, decoder, lambda frames: len(frames.output) >= 3)
    test, identity = frames.self_test[0], Identity.of(frames.identity[0])
    assert parts(test["failed"]) == MISSING
    assert parts(test["checked"]) == set(Part) - {Part.PICKOFFS}, "no codes, nothing to say about them"
    assert (test["core_clock_hz"], test["fault_address"], test["samples_lost"]) == (16_000_000, 0, 0)
    assert (identity.sample_rate_hz, identity.adc_bits, identity.dac_bits, identity.unique_id) == (50_000, 24, 24, 0)
    assert (identity.calibration_source, identity.calibration_valid, identity.device_name) == (0, False, "uncalibrated")
    assert decoder.statistics.bad_packets == decoder.statistics.bad_crc == decoder.statistics.lost_frames == 0


def test_telemetry_of_silence_is_the_hosts(program):
    """Without a codec the sample path runs on silence: the frames are those of the host on the same codes."""
    with Boot(program) as board:
        frames = until(board, Decoder(), lambda frames: len(frames.baseband) >= 12)
    host = HostDevice(Board(50_000_000, 24, 24, serial=0))
    host.run(np.zeros((int(frames.baseband["sample_counter"][-1]) + 1000, 2), np.int32))
    expected = Decoder().feed(host.telemetry())
    host.close()
    for found, wanted in ((frames.baseband, expected.baseband), (frames.output, expected.output)):
        names = [name for name in found.dtype.names if name != "sequence"]
        assert len(found) > 5 and np.array_equal(found[names], wanted[names][: len(found)])


def test_commands_are_answered(program):
    send = CommandEncoder()
    with Boot(program) as board:
        until(board, decoder := Decoder(), lambda frames: len(frames.self_test))
        board.send(send.ping() + b"\x05nonsense\x00" + send.status() + send.compensation("static"))
        frames = until(board, decoder, lambda frames: len(frames.ack) >= 3 and len(frames.status))
    assert frames.ack["reason"].tolist() == [Reason.OK] * 3
    assert len(frames.identity) == len(frames.self_test) == 1 and frames.status["receive_errors"][0] == 1
    assert frames.status["time_us"][0] > 0


def test_a_flash_that_takes_nothing_refuses_a_calibration(program):
    """The emulated flash cannot be written: the device notices when it reads back, says so and goes on with what it has."""
    send = CommandEncoder()
    block = block_of_the_board()
    messages = [send.calibration_unlock(0), send.calibration_write(0, block[:200]), send.calibration_write(200, block[200:]),
                send.calibration_commit(len(block))]
    with Boot(program) as board:
        until(board, decoder := Decoder(), lambda frames: len(frames.self_test))
        for message in messages:
            board.send(message)
            last = until(board, decoder, lambda frames: len(frames.ack)).ack[-1]
        frames = until(board, decoder, lambda frames: len(frames.output) >= 2)
    assert last["reason"] == Reason.STORE_FAILED and len(frames.identity) == 0


def block_of_the_board() -> bytes:
    text = (ROOT / "hal/stm32f405/calibration_50000.c").read_text()
    return bytes(int(word, 16) for word in text.split("{")[1].split("}")[0].replace(",", " ").split())


# ---- what goes wrong is seen ------------------------------------------------------------------------------------------------


def patched(program: Path, where: Path, symbol: str, code: bytes) -> tuple[Path, int]:
    """Copy of the image with other code at the beginning of a function; its address."""
    listing = subprocess.run(["arm-none-eabi-nm", str(program)], capture_output=True, text=True, check=True).stdout
    address = next(int(line.split()[0], 16) for line in listing.splitlines() if line.split()[-1] == symbol)
    binary = bytearray(program.with_suffix(".bin").read_bytes())
    binary[address - FLASH_START : address - FLASH_START + len(code)] = code
    image_file = bytearray(program.read_bytes())
    original = program.with_suffix(".bin").read_bytes()[address - FLASH_START : address - FLASH_START + 64]
    at = image_file.find(original)
    assert at > 0 and image_file.find(original, at + 1) < 0
    image_file[at : at + len(code)] = code
    target = where / "patched.elf"
    target.write_bytes(image_file)
    return target, address


def reports_of_two_runs(program: Path):
    with Boot(program, restart=True) as board:
        return until(board, Decoder(), lambda frames: len(frames.self_test) >= 2).self_test


def test_a_changed_program_is_noticed(program, tmp_path):
    broken, _ = patched(program, tmp_path, "oscillator_table", b"\x01")
    with Boot(broken) as board:
        frames = until(board, Decoder(), lambda frames: len(frames.self_test))
    assert parts(frames.self_test["failed"][0]) == MISSING | {Part.IMAGE}


def test_a_fault_is_reported_by_the_next_run(program, tmp_path):
    undefined = b"\x00\xde"
    broken, address = patched(program, tmp_path, "application_poll", undefined)
    first, second = reports_of_two_runs(broken)[:2]
    assert first["fault_address"] == 0 and Part.LAST_RUN not in parts(first["failed"])
    assert second["fault_address"] == address and Part.LAST_RUN in parts(second["failed"])


def test_a_stack_that_overflows_is_a_fault_not_a_change_of_data(program, tmp_path):
    push_for_ever = b"\xff\xb4\xfd\xe7"  # push {r0-r7}; branch back
    broken, _ = patched(program, tmp_path, "application_poll", push_for_ever)
    second = reports_of_two_runs(broken)[1]
    assert Part.LAST_RUN in parts(second["failed"])
    assert 0x20000000 - 256 <= second["fault_address"] < 0x20000000 + 16

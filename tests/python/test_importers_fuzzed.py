"""Whatever stands in a file or comes over a wire: it is taken, or refused in one line (BadInput). Nothing else is raised, nothing half written."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from host_device import Device
from wineglass import calibration_block, scenario
from wineglass import device as devices
from wineglass.commands_wire import CommandEncoder
from wineglass.errors import BadInput
from wineglass.importers.csv import ImportOptions, import_csv
from wineglass.link.live import LiveOptions, record
from wineglass.link.ports import FilePort
from wineglass.recording import Recording, RecordingMeta, RecordingWriter, TapFormat, float_format

ROOT = Path(__file__).resolve().parents[2]
JSON = (ROOT / "tests/golden/calibration_block.json").read_bytes()
DEVICE = (ROOT / "devices/metal.toml").read_bytes()
SCENARIO = (ROOT / "scenarios/cold-start.toml").read_bytes()
CSV = b"time [s],gyro [deg/s],temperature [degC]\n" + b"".join(b"%d.%02d,0.5,2%d.0\n" % (i // 100, i % 100, i % 10) for i in range(200))

fuzzed = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
PIECES = [b"", b"\0", b"\xff\xfe", b"nan", b"inf", b"-1", b"1e400", b"9" * 400, b"[", b"{", b"]", b'"', b"\n", b",", b"=", b";", b"\xc3", b"true", b"[[a]]\n"]


@st.composite
def mutations(draw, text):
    """A few places where something is cut out and something else put in."""
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(text)))
        cut = draw(st.sampled_from([0, 1, 2, 5, 20, len(text)]))
        put = draw(st.one_of(st.sampled_from(PIECES), st.binary(max_size=8)))
        text = text[:at] + put + text[at + cut:]
    return text


def taken_or_refused(action):
    try:
        return action()
    except BadInput as refusal:
        assert len(str(refusal).splitlines()) == 1 and refusal.what
        return None


@fuzzed
@given(mutations(JSON))
def test_calibration_json(tmp_path, text):
    path = tmp_path / "calibration.json"
    path.write_bytes(text)
    calibration = taken_or_refused(lambda: calibration_block.read_json(path))
    if calibration is not None:
        taken_or_refused(lambda: calibration_block.to_binary(calibration))


def test_a_calibration_block_that_asks_for_an_endless_chirp_is_refused_without_computing_its_length():
    block = bytearray(calibration_block.to_binary(calibration_block.read_json(ROOT / "tests/golden/calibration_block.json")))
    names = [name for name, _ in calibration_block.LAYOUT]
    before = struct.calcsize("<" + "".join(code for _, code in calibration_block.LAYOUT[: names.index("chirp_ticks_log2")]))
    struct.pack_into("<I", block, before, 0x7FFFFFFF)
    struct.pack_into("<I", block, len(block) - 4, zlib.crc32(bytes(block[:-4])))
    with pytest.raises(BadInput, match="chirp"):
        calibration_block.from_binary(bytes(block))


@fuzzed
@given(st.data())
def test_calibration_block(data):
    block = bytearray(calibration_block.to_binary(calibration_block.read_json(ROOT / "tests/golden/calibration_block.json")))
    for _ in range(data.draw(st.integers(1, 4))):
        struct.pack_into("<I", block, 4 * data.draw(st.integers(2, len(block) // 4 - 2)), data.draw(st.sampled_from(
            [0, 1, 5, 6, 7, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF]) | st.integers(0, 2**32 - 1)))
    if data.draw(st.booleans()):
        struct.pack_into("<I", block, len(block) - 4, zlib.crc32(bytes(block[:-4])))
    calibration = taken_or_refused(lambda: calibration_block.from_binary(bytes(block)))
    if calibration is not None:
        taken_or_refused(lambda: calibration_block.to_binary(calibration))


def test_calibration_block_with_one_word_changed():
    """Every word, at the ends of its range, under a right check sum."""
    whole = calibration_block.to_binary(calibration_block.read_json(ROOT / "tests/golden/calibration_block.json"))
    for place in range(8, len(whole) - 4, 4):
        for word in (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF):
            block = bytearray(whole)
            struct.pack_into("<I", block, place, word)
            struct.pack_into("<I", block, len(block) - 4, zlib.crc32(bytes(block[:-4])))
            calibration = taken_or_refused(lambda: calibration_block.from_binary(bytes(block)))
            if calibration is not None:
                taken_or_refused(lambda: calibration_block.to_binary(calibration))


@fuzzed
@given(mutations(DEVICE))
def test_device_description(tmp_path, text):
    path = tmp_path / "device.toml"
    path.write_bytes(text)
    taken_or_refused(lambda: devices.load(path))


@fuzzed
@given(mutations(SCENARIO))
def test_scenario(tmp_path, text):
    path = tmp_path / "scenario.toml"
    path.write_bytes(text)
    found = taken_or_refused(lambda: scenario.load(path))
    if found is not None:
        taken_or_refused(lambda: scenario.prepare(found))


@fuzzed
@given(mutations(CSV))
def test_csv(tmp_path, text):
    (tmp_path / "table.csv").write_bytes(text)
    target = tmp_path / "table.h5"
    target.unlink(missing_ok=True)
    done = taken_or_refused(lambda: import_csv(tmp_path / "table.csv", target, ImportOptions({}, {})))
    assert sorted(path.name for path in tmp_path.iterdir()) == (["table.csv", "table.h5"] if done else ["table.csv"])
    if done:
        with Recording.open(target) as recording:
            assert recording.taps


@pytest.fixture(scope="module")
def recording_bytes(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "run.h5"
    with RecordingWriter(path, RecordingMeta(50000.0, taps={"output": TapFormat(100.0, {"rate": float_format()})})) as writer:
        writer.append("output", {"rate": np.arange(50.0)}, 0)
        writer.event("here", "there", sample=3)
    return path.read_bytes()


@fuzzed
@given(st.data())
def test_recording(tmp_path, recording_bytes, data):
    size = data.draw(st.integers(0, len(recording_bytes)))
    (tmp_path / "run.h5").write_bytes(recording_bytes[:size])
    if size < len(recording_bytes):
        assert taken_or_refused(lambda: Recording.open(tmp_path / "run.h5")) is None


@pytest.fixture(scope="module")
def telemetry_bytes():
    device, commands = Device(), CommandEncoder()
    device.send(commands.divisors(1, 2) + commands.raw_burst(300) + commands.status())
    device.ring(2500)
    device.send(commands.ping() + commands.divisors(2, 2))
    device.ring(2500)
    return device.telemetry()


@settings(fuzzed, max_examples=20)
@given(st.data())
def test_telemetry_into_a_recording(tmp_path, telemetry_bytes, data):
    """Pieces of the stream, lost, doubled, in another order and damaged."""
    borders = sorted(data.draw(st.lists(st.integers(0, len(telemetry_bytes)), max_size=6)))
    pieces = [telemetry_bytes[a:b] for a, b in zip([0, *borders], [*borders, len(telemetry_bytes)], strict=True)]
    pieces = data.draw(st.lists(st.sampled_from(pieces), min_size=1, max_size=8)) if data.draw(st.booleans()) else pieces
    stream = data.draw(mutations(b"".join(pieces)))
    (tmp_path / "telemetry.bin").write_bytes(stream)
    target = tmp_path / "run.h5"
    target.unlink(missing_ok=True)
    with FilePort(str(tmp_path / "telemetry.bin")) as port:
        done = taken_or_refused(lambda: record(port, target, LiveOptions()))
    assert target.exists() == (done is not None) and not (tmp_path / "run.h5.part").exists()
    if done is not None:
        with Recording.open(target) as recording:
            for name in ("baseband", "output"):
                if name in recording:
                    assert recording.tap(name).length == len(recording.tap(name).lost) < 10000

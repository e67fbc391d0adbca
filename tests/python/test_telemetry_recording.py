"""Telemetry into a recording: every integer arrives, with its scale, at its place on the sample counter."""

import numpy as np
import pytest

from host_device import Device
from wineglass import telemetry
from wineglass.commands_wire import CommandEncoder
from wineglass.recording import Recording, RecordingMeta, RecordingWriter
from wineglass.telemetry import Decoder
from wineglass.telemetry_recording import TelemetryRecorder, telemetry_to_recording


@pytest.fixture
def device():
    return Device()


def record(path, data):
    with RecordingWriter(path, RecordingMeta(counter_rate_hz=50000.0)) as writer:
        recorder = telemetry_to_recording(data, writer)
    return recorder


def test_integers_and_scales_arrive(device, tmp_path):
    device.send(CommandEncoder().divisors(4, 2))
    device.ring(50000)
    data = device.telemetry()
    recorder = record(tmp_path / "run.h5", data)
    frames = Decoder().feed(data)
    recording = Recording.open(tmp_path / "run.h5")
    baseband, output = recording.tap("baseband"), recording.tap("output")
    assert baseband.sample_rate_hz == 250.0 and output.sample_rate_hz == 500.0
    kept = frames.baseband[frames.baseband["sample_counter"] >= 100]
    assert np.array_equal(baseband.codes("primary_in_phase"), kept["primary_i"])
    assert np.array_equal(baseband.codes("drive_frequency"), kept["freq"])
    assert np.array_equal(baseband.codes("status"), telemetry.worst_status(kept))
    assert np.allclose(baseband["drive_frequency"], kept["freq"].astype(float) * 50000.0 / 2.0**64, rtol=1e-15)
    assert np.array_equal(output.codes("rate"), frames.output["rate"][-len(output.codes("rate")):])
    assert recorder.ignored_frames == len(frames.baseband) - len(kept) + len(frames.output) - len(output.codes("rate"))
    assert recorder.ignored_frames <= 2


def test_samples_stand_at_the_middle_of_their_interval(device, tmp_path):
    device.send(CommandEncoder().divisors(10, 10))
    device.ring(20000)
    data = device.telemetry()
    record(tmp_path / "run.h5", data)
    first = Decoder().feed(data).baseband[0]
    assert Recording.open(tmp_path / "run.h5").tap("baseband").first_sample == int(first["sample_counter"]) - 250


def test_lost_frames_become_lost_samples(device, tmp_path):
    device.send(CommandEncoder().divisors(10, 0))
    device.ring(100000)
    packets = device.telemetry().split(b"\0")
    record(tmp_path / "run.h5", b"\0".join(packets[:50] + packets[53:]))
    tap = Recording.open(tmp_path / "run.h5").tap("baseband")
    assert tap.length == 200 and int(np.count_nonzero(tap.lost)) == 3


def test_bursts_arrive_with_their_snapshot(device, tmp_path):
    encoder = CommandEncoder()
    device.ring(5000)
    device.send(encoder.raw_burst(700))
    device.ring(2000)
    device.send(encoder.raw_burst(300))
    device.ring(2000)
    data = device.telemetry()
    record(tmp_path / "run.h5", data)
    bursts = Recording.open(tmp_path / "run.h5").bursts
    assert [burst.length for burst in bursts] == [700, 300]
    frames = Decoder().feed(data)
    chunks = [telemetry.raw_samples(chunk) for chunk in frames.raw]
    codes = np.concatenate([chunk.codes for chunk in chunks])
    for number, name in enumerate(("primary_adc_raw", "secondary_adc_raw", "drive_dac_raw", "rebalance_dac_raw")):
        assert np.array_equal(np.concatenate([burst.codes(name) for burst in bursts]), codes[:, number])
    assembler = telemetry.SnapshotAssembler()
    assembler.feed(frames.snapshot)
    for burst in bursts:
        assert bytes(burst.state_snapshot) == assembler.take(burst.first_sample)
        assert set(burst.codes("thermometer_raw")) == {-(2**31)}


def test_feeding_piece_by_piece_is_the_same(device, tmp_path):
    device.send(CommandEncoder().divisors(5, 5) + CommandEncoder().raw_burst(200))
    device.ring(50000)
    data = device.telemetry()
    record(tmp_path / "whole.h5", data)
    with RecordingWriter(tmp_path / "parts.h5", RecordingMeta(counter_rate_hz=50000.0)) as writer:
        recorder = TelemetryRecorder(writer)
        for at in range(0, len(data), 333):
            recorder.feed(data[at:at + 333])
    whole, parts = Recording.open(tmp_path / "whole.h5"), Recording.open(tmp_path / "parts.h5")
    for tap in ("baseband", "output"):
        assert whole.tap(tap).channels == parts.tap(tap).channels
        for name in whole.tap(tap).channels:
            assert np.array_equal(whole.tap(tap).codes(name), parts.tap(tap).codes(name))
    assert [burst.length for burst in whole.bursts] == [burst.length for burst in parts.bursts]


def test_frames_before_the_identity_wait_for_it(device, tmp_path):
    device.send(CommandEncoder().divisors(10, 10))
    device.ring(10000)
    device.send(CommandEncoder().ping())
    device.ring(10000)
    data = device.telemetry()
    whole = record(tmp_path / "whole.h5", data)
    cut = data[data.index(b"\0") + 1:]
    late = record(tmp_path / "late.h5", cut)
    assert late.identity == whole.identity
    assert Recording.open(tmp_path / "late.h5").tap("output").length == Recording.open(tmp_path / "whole.h5").tap("output").length


def test_a_change_of_rate_keeps_the_first_one(device, tmp_path):
    encoder = CommandEncoder()
    device.send(encoder.divisors(10, 10))
    device.ring(10000)
    device.send(encoder.divisors(20, 10))
    device.ring(10000)
    recorder = record(tmp_path / "run.h5", device.telemetry())
    assert recorder.ignored_frames >= 9
    assert Recording.open(tmp_path / "run.h5").tap("baseband").sample_rate_hz == 100.0

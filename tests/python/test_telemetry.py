"""The decoder of telemetry: any chunking, any damage; its frames against a plain second decoder; the device's own bytes."""

import os
import random
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import wineglass
from hypothesis import given, settings
from hypothesis import strategies as st

from host_device import Device
from wineglass import calibration_block, telemetry, wire
from wineglass.commands_wire import Command, CommandEncoder, Reason, unlock_key
from wineglass.errors import BadInput
from wineglass.native import ffi, library, pointer
from wineglass.telemetry import Decoder, FrameType

ROOT = Path(__file__).resolve().parents[2]
SEED = int(os.environ.get("WINEGLASS_SEED", "20240501"))


@pytest.fixture
def rng():
    print(f"WINEGLASS_SEED={SEED}")
    return random.Random(SEED)


# ---- a second decoder, straight from the description -----------------------------------------------------------------------


def unstuff(packet):
    plain, at = bytearray(), 0
    while at < len(packet):
        code = packet[at]
        block = packet[at + 1:at + code]
        if len(block) != code - 1:
            return None
        plain += block
        at += code
        if code < 255 and at < len(packet):
            plain.append(0)
    return bytes(plain)


def decode_plainly(data):
    """Sound frames as (header fields, payload), in order."""
    frames = []
    for packet in data.split(b"\0")[:-1]:
        plain = unstuff(packet) if 0 < len(packet) <= wire.MAX_ENCODED else None
        if plain and len(plain) >= 16 and zlib.crc32(plain[:-4]) == struct.unpack("<I", plain[-4:])[0]:
            frames.append((wire.HEADER.unpack(plain[:12]), plain[12:-4]))
    return frames


def as_plain(frames):
    """Everything in Frames as the second decoder gives it, by type."""
    found = {}
    for kind in FrameType:
        entries = getattr(frames, kind.name.lower())
        if kind in wire.OPEN_ENDED:
            found[kind] = [entry.record.tobytes() + entry.data for entry in entries]
        else:
            found[kind] = [entry.tobytes() for entry in entries]
    return found


def expect_same(frames, plain):
    expected = {kind: [] for kind in FrameType}
    for header, payload in plain:
        expected[FrameType(header[1])].append(wire.HEADER.pack(*header) + payload)
    assert as_plain(frames) == expected


@pytest.fixture(scope="module")
def stream():
    """Telemetry of one second with every frame type in it."""
    device = Device()
    commands = CommandEncoder()
    device.send(commands.divisors(1, 2) + commands.raw_burst(1000) + commands.status())
    device.ring(25000)
    device.send(commands.calibration(golden_block(), 99) + commands.calibration_read())
    library().wg_device_sync(device.handle, 12345)
    device.ring(25000)
    return device.telemetry()


def golden_block():
    return calibration_block.to_binary(calibration_block.read_json(ROOT / "tests/golden/calibration_block.json"))


# ---- wire ----------------------------------------------------------------------------------------------------------------


@given(st.binary(max_size=700))
def test_cobs_encoder_against_the_plain_decoder(data):
    encoded = wire.cobs_encode(data)
    assert b"\0" not in encoded and len(encoded) <= len(data) + len(data) // 254 + 1
    assert unstuff(encoded) == data


def test_cobs_long_runs():
    for size in range(250, 515):
        for data in (b"\x01" * size, b"\x01" * size + b"\0", b"\0" + b"\x01" * size):
            assert unstuff(wire.cobs_encode(data)) == data


def test_crc_of_the_firmware_is_zlib_s(rng):
    for _ in range(200):
        data = rng.randbytes(rng.randrange(600))
        assert library().wg_crc32(data, len(data)) == zlib.crc32(data)


# ---- decoder -------------------------------------------------------------------------------------------------------------


def test_device_stream_holds_every_frame_type(stream):
    decoder = Decoder()
    frames = decoder.feed(stream)
    expect_same(frames, decode_plainly(stream))
    for kind in set(FrameType) - {FrameType.SELF_TEST, FrameType.PHASES}:  # from boards, and from a locked loop after half a minute
        assert len(getattr(frames, kind.name.lower())) > 0, kind
    statistics = decoder.statistics
    assert (statistics.bad_crc, statistics.bad_packets, statistics.unknown, statistics.lost_frames) == (0, 0, 0, 0)
    assert statistics.frames == len(frames)


def test_chunking_changes_nothing(stream, rng):
    whole = as_plain(Decoder().feed(stream))
    for sizes in ((1, 2), (1, 100), (1000, 5000)):
        part = stream[:4000 * sizes[1]][:60000]
        expected = as_plain(Decoder().feed(part))
        decoder, parts, at = Decoder(), [], 0
        while at < len(part):
            n = rng.randint(*sizes)
            parts.append(decoder.feed(part[at:at + n]))
            at += n
        assert as_plain(telemetry.merge(parts)) == expected
        assert decoder.statistics.lost_frames == 0
    assert sum(map(len, whole.values())) > 1000


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_damage_costs_what_it_hits_and_nothing_else(stream, seed):
    """Bytes changed, lost and added anywhere: exactly the frames that the plain decoder still finds come out."""
    rng = random.Random(seed)
    data = bytearray(stream[:40000])
    for _ in range(rng.randrange(1, 60)):
        at, kind = rng.randrange(len(data)), rng.randrange(3)
        if kind == 0:
            data[at] = rng.randrange(256)
        elif kind == 1:
            del data[at:at + rng.randrange(1, 300)]
        else:
            data[at:at] = rng.randbytes(rng.randrange(1, 1500))
    decoder, parts, at = Decoder(), [], 0
    while at < len(data):
        n = rng.randrange(1, 20000)
        parts.append(decoder.feed(bytes(data[at:at + n])))
        at += n
    frames = telemetry.merge(parts)
    plain = [entry for entry in decode_plainly(bytes(data)) if entry[0][1] in set(FrameType) and entry[0][0] == 1]
    expect_same(frames, plain)
    assert decoder.statistics.bad_crc + decoder.statistics.bad_packets > 0 or len(plain) > 0


def test_lost_frames_are_counted_from_the_numbers(stream):
    packets = stream.split(b"\0")
    kept = packets[:100] + packets[103:500] + packets[501:]
    decoder = Decoder()
    decoder.feed(b"\0".join(kept))
    assert decoder.statistics.lost_frames == 4
    assert decoder.gaps == [telemetry.Gap(100, 3), telemetry.Gap(497, 1)]
    assert decoder.statistics.restarts == 0


def test_numbering_wraps_without_a_gap():
    data = b"".join(wire.encode(FrameType.ACK, n, b"\x81\0\0\0") for n in range(65500, 65600))
    decoder = Decoder()
    assert len(decoder.feed(data).ack) == 100
    assert decoder.statistics.lost_frames == 0


def test_a_restart_is_no_loss():
    device = Device()
    device.ring(20000)
    assert library().wg_device_power_cycle(device.handle) == 0
    device.ring(20000)
    decoder = Decoder()
    decoder.feed(device.telemetry())
    assert (decoder.statistics.restarts, decoder.statistics.lost_frames) == (1, 0)


def test_unknown_and_wrong_frames_are_counted():
    decoder = Decoder()
    data = wire.encode(77, 0) + wire.encode(FrameType.ACK, 1, b"123") + wire.encode(FrameType.ACK, 2, b"1234", version=2)
    assert len(decoder.feed(data)) == 0
    assert decoder.statistics.unknown == 3 and decoder.statistics.frames == 3


def test_noise_without_a_delimiter_is_not_collected(rng):
    decoder = Decoder()
    for _ in range(100):
        decoder.feed(bytes(rng.randrange(1, 256) for _ in range(1000)))
    assert len(decoder._rest) <= wire.MAX_ENCODED
    good = wire.encode(FrameType.ACK, 0, b"1234")
    assert len(decoder.feed(b"\0" + good).ack) == 1
    assert decoder.statistics.bad_packets == 1


def test_empty_feeds():
    decoder = Decoder()
    assert len(decoder.feed(b"")) == 0 and len(decoder.feed(b"\0\0\0")) == 0
    assert decoder.statistics == telemetry.Statistics()


# ---- meaning -------------------------------------------------------------------------------------------------------------


def test_identity_in_si():
    device = Device(serial=0x1122334455667788)
    identity = telemetry.Identity.of(Decoder().feed(device.telemetry()).identity[0])
    assert identity.unique_id == 0x1122334455667788 and identity.sample_rate_hz == 50000.0
    assert (identity.adc_bits, identity.dac_bits, identity.slow_period_samples) == (16, 16, 50)
    assert identity.reference_temperature_degc == 25.0 and identity.device_name == "uncalibrated"
    assert not identity.calibration_valid and identity.firmware_version == wineglass.__version__


def test_baseband_in_si():
    """A tone on the primary at a known frequency: amplitude, frequency word and interval come out in SI."""
    device = Device()
    device.send(CommandEncoder().divisors(10, 10))
    device.ring(100_000)
    decoder = Decoder()
    frames = decoder.feed(device.telemetry())
    identity = telemetry.Identity.of(frames.identity[0])
    table = telemetry.conversions(identity)["baseband"]
    last = frames.baseband[-20:]
    amplitude = np.hypot(telemetry.si(last, table["primary_in_phase"]), telemetry.si(last, table["primary_quadrature"]))
    assert amplitude == pytest.approx(20000 / 32768, rel=1e-3)
    assert np.all(np.abs(telemetry.si(last, table["drive_frequency"]) - 5000.0) < 61.0)
    assert set(frames.baseband["interval_samples"]) == {500}
    assert np.all(np.diff(frames.baseband["sample_counter"].astype(np.int64)) == 500)


def test_worst_status_keeps_what_was_always_well_and_what_ever_happened():
    records = np.zeros(1, telemetry.DTYPES[FrameType.BASEBAND])
    records["status_or"] = wire.Status.LOCKED | wire.Status.RATE_VALID | wire.Status.OVERFLOW
    records["status_and"] = wire.Status.LOCKED
    assert telemetry.worst_status(records)[0] == wire.Status.LOCKED | wire.Status.OVERFLOW


def constants(header, prefix):
    """Enumerators and their values, as the C source writes them."""
    text = (ROOT / "firmware" / header).read_text(encoding="utf-8")
    return {name: eval(value.replace("u", "")) for name, value in re.findall(rf"\b{prefix}(\w+) = ([0-9a-fA-Fxu< ]+?)\s*[,}}/\n]", text)}


@pytest.mark.parametrize(("enumeration", "header", "prefix"), [
    (wire.Status, "core/gyro.h", "GYRO_STATUS_"), (Reason, "application/reason.h", "REASON_"),
    (Command, "application/commands.h", "COMMAND_"), (FrameType, "application/sender.h", "FRAME_"),
    (wire.Part, "../hal/hal.h", "HAL_PART_"),
])
def test_numbers_are_those_of_the_firmware(enumeration, header, prefix):
    assert constants(header, prefix) == {member.name: member.value for member in enumeration}


def test_bursts_carry_the_codes_and_replay(rng):
    device = Device()
    device.ring(12_345)
    device.telemetry()
    device.send(CommandEncoder().raw_burst(2500))
    adc = np.array([[rng.randrange(-20000, 20000), rng.randrange(-500, 500)] for _ in range(5000)], np.int32)
    dac = device.run(adc)
    frames = Decoder().feed(device.telemetry())
    samples = [telemetry.raw_samples(chunk) for chunk in frames.raw]
    codes = np.concatenate([part.codes for part in samples])
    start = samples[0].first_sample
    assert len(codes) == 2500 and samples[0].first and samples[-1].last and not samples[-1].cut
    assert np.array_equal(codes[:, :2], adc[start - 12_345:start - 12_345 + 2500])
    assert np.array_equal(codes[:, 2:], dac[start - 12_345:start - 12_345 + 2500])
    assembler = telemetry.SnapshotAssembler()
    assembler.feed(frames.snapshot)
    snapshot = assembler.take(start)
    assert assembler.take(start) is None
    other = Device()
    assert library().wg_device_restore(other.handle, snapshot, len(snapshot)) == 0
    assert np.array_equal(other.run(codes[:, :2]), codes[:, 2:])


def test_incomplete_snapshots_are_not_handed_out(stream):
    frames = Decoder().feed(stream)
    assembler = telemetry.SnapshotAssembler()
    assembler.feed(frames.snapshot[:1] + frames.snapshot[2:])
    assert assembler.take(int(frames.snapshot[0].record["burst_sample"])) is None


# ---- commands ------------------------------------------------------------------------------------------------------------


def acknowledged(device, data):
    device.telemetry()
    device.send(data)
    device.ring(200)
    return [(Command(a["command"]), Reason(a["reason"]), int(a["command_sequence"])) for a in Decoder().feed(device.telemetry()).ack]


def test_every_command_is_understood():
    device, encoder = Device(golden_block(), serial=3), CommandEncoder(1000)
    calls = [
        encoder.ping, encoder.status, lambda: encoder.compensation("static"), lambda: encoder.loop("rebalance"),
        lambda: encoder.output_filter("0.1"), lambda: encoder.amplitude(0.5), lambda: encoder.pll_gains(200.0, 2e4, 50e3, 10),
        lambda: encoder.agc_gains(5.0, 20.0, 5e3), lambda: encoder.rebalance(10.0, 100.0, 5e3, 0.6, 0.6),
        lambda: encoder.test_signal(0.01, -0.01, 10.0, 5e3), lambda: encoder.phase_set_point(-1.5), lambda: encoder.divisors(2, 3),
        encoder.restart, lambda: encoder.raw_burst(10), encoder.calibration_read, lambda: encoder.calibration_unlock(3),
    ]
    for number, call in enumerate(calls):
        (command, reason, sequence), = acknowledged(device, call())
        assert (reason, sequence) == (Reason.OK, 1000 + number), command
    answers = acknowledged(device, encoder.calibration(golden_block(), 3))
    assert [reason for _, reason, _ in answers] == [Reason.OK] * 4
    signals = ffi.new("struct wg_device_signals *")
    library().wg_device_get_signals(device.handle, signals)
    assert signals.amplitude_set_point_q30 == round(0.9 * 2**30)


def test_settings_arrive_with_their_value():
    device, encoder = Device(), CommandEncoder()
    acknowledged(device, encoder.amplitude(0.7))
    device.ring(200)
    signals = ffi.new("struct wg_device_signals *")
    library().wg_device_get_signals(device.handle, signals)
    assert signals.amplitude_set_point_q30 == round(0.7 * 2**30)
    device.send(encoder.status())
    device.ring(200)
    assert Decoder().feed(device.telemetry()).status["commands_accepted"][-1] == 1


def test_refusals_of_the_device_have_a_reason():
    device, encoder = Device(), CommandEncoder()
    assert acknowledged(device, encoder.amplitude(0.001))[0][1] == Reason.OUT_OF_RANGE
    assert acknowledged(device, encoder.calibration_commit(392))[0][1] == Reason.LOCKED
    assert acknowledged(device, encoder.calibration_unlock(1))[0][1] == Reason.WRONG_KEY
    assert acknowledged(device, encoder.calibration_read())[0][1] == Reason.NOTHING_STORED
    assert acknowledged(device, wire.encode(0x81, 5, b"x"))[0][1:] == (Reason.LENGTH, 5)


def test_unlock_key_is_the_documented_one():
    assert unlock_key(0x0123456789ABCDEF) == zlib.crc32(bytes.fromhex("efcdab8967452301"))


@pytest.mark.parametrize("call", [
    lambda e: e.compensation("g3"), lambda e: e.loop("closed"), lambda e: e.output_filter("0.3"), lambda e: e.amplitude(3.0),
    lambda e: e.divisors(70000, 1), lambda e: e.raw_burst(-1),
])
def test_impossible_commands_are_refused_before_sending(call):
    with pytest.raises(BadInput):
        call(CommandEncoder())


def test_kernels_refuse_what_they_cannot_do():
    none = ffi.NULL
    assert library().wg_thermal_polynomial_eval(ffi.new("int32_t[6]"), 6, none, none, 0) == -1
    assert library().wg_lockin_run(1, 0, 0, none, none, none, 0) == -1
    assert library().wg_decoupler_run(ffi.new("int64_t[6]"), 2**63, 1, 0, none, none, 0) == -1


def test_thermal_polynomial_kernel_against_numpy(rng):
    from numpy.polynomial import polynomial

    coefficients = np.array([rng.uniform(-0.1, 0.1) for _ in range(6)])
    coef = np.round(coefficients * 2**31).astype(np.int32)
    shift = np.linspace(-100.0, 100.0, 1001)
    shift_q20 = np.round(shift * 2**20).astype(np.int32)
    out = np.empty(1001, np.int32)
    for order in range(6):
        assert library().wg_thermal_polynomial_eval(pointer(coef, "int32_t"), order, pointer(shift_q20, "int32_t"),
                                                    pointer(out, "int32_t"), 1001) == 0
        exact = polynomial.polyval(shift_q20 / 2**20 / 128, (coef / 2**31)[:order + 1])
        assert np.max(np.abs(out / 2**31 - exact)) < 8 / 2**31


def test_lockin_kernel_finds_amplitude_and_phase():
    n, f = 4000, 0.1
    t = np.arange(1, n + 1)
    pickoff = np.round(0.5 * np.cos(2 * np.pi * f * t + 0.7) * 2**31).astype(np.int32)
    i, q = np.empty(n // 10, np.int32), np.empty(n // 10, np.int32)
    count = library().wg_lockin_run(10, 0, round(f * 2**64), pointer(pickoff, "int32_t"), pointer(i, "int32_t"), pointer(q, "int32_t"), n)
    assert count == n // 10
    z = (i[10:] + 1j * q[10:]) / 2**30
    assert np.max(np.abs(z - 0.5 * np.exp(0.7j))) < 1e-5

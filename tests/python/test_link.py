"""A device at the end of a wire: ports, commands with answers, live recording through damage, restarts and Ctrl-C."""

import json
import os
import pty
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from pathlib import Path

import numpy as np
import pytest

from host_device import Device
from wineglass import calibration_block, cli, scenario
from wineglass.commands_wire import CommandEncoder, Reason
from wineglass.errors import BadInput, WineglassError
from wineglass.link import serve as link_serve
from wineglass.link.live import LiveOptions, record
from wineglass.link.ports import FilePort, PortClosed, open_port, tcp_address
from wineglass.link.session import Refused, Session
from wineglass.recording import Recording
from wineglass.simulation import simulate
from wineglass.twin import Twin, block_for

TOOLS = Path(__file__).resolve().parents[2] / "tools"


def prepared(duration_s=6.0, name="cold-start"):
    return scenario.prepare(scenario.load(name).changed({"duration_s": duration_s, "recording": {"baseband_hz": 100.0, "output_hz": 50.0, "bursts": []}}))


class Served:
    """A served twin in a thread."""

    def __init__(self, path, run, speed=0.0, byte_errors=0.0):
        self.path, self.done = path, None
        self._context = link_serve.listen_unix(path)
        listener = self._context.__enter__()

        def work():
            self.done = link_serve.serve(run, listener, speed, byte_errors)

        self._thread = threading.Thread(target=work, daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        self._thread.join(60.0 if kind is None else 0.0)
        self._context.__exit__(None, None, None)
        assert kind is not None or self.done is not None


class Loop:
    """A host device as a port: what is written is executed at once, reading runs it on; `damage` is what the wire does both ways."""

    is_live = True
    name = "loop"

    def __init__(self, device, damage=lambda data: data, samples=5000):
        self.device, self.damage, self.samples = device, damage, samples

    def write(self, data):
        self.device.send(self.damage(data))

    def read(self, timeout_s):
        self.device.ring(self.samples)
        return self.damage(self.device.telemetry())

    def close(self):
        pass


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    path = tmp_path_factory.mktemp("simulated") / "run.h5"
    simulate(prepared(), path)
    return Recording.open(path)


def expect_equal_where_known(recorded, simulated):
    for name in ("baseband", "output"):
        ours, theirs = recorded.tap(name), simulated.tap(name)
        offset = round((ours.first_sample - theirs.first_sample) / ours.counter_rate_hz * ours.sample_rate_hz)
        assert offset >= 0 and ours.channels == theirs.channels
        for channel in ours.channels:
            here = ours.codes(channel)
            there = theirs.codes(channel)[offset:offset + len(here)]
            kept = ours.lost[:len(there)] == 0
            assert np.array_equal(here[:len(there)][kept], there[kept]), channel


# ---- recording -----------------------------------------------------------------------------------------------------------


def test_a_recorded_socket_equals_the_simulation(simulated, tmp_path):
    with Served(tmp_path / "gyro.sock", prepared(), speed=3.0) as served, open_port(str(served.path)) as port:
        done = record(port, tmp_path / "run.h5", LiveOptions())
    recorded = Recording.open(tmp_path / "run.h5")
    assert done.ended == "the connection was closed" and done.lost_frames == 0 and done.warnings == []
    assert recorded.tap("baseband").length == simulated.tap("baseband").length
    assert not np.any(recorded.tap("baseband").lost)
    assert recorded.calibration_block == simulated.calibration_block and recorded.firmware_version == simulated.firmware_version
    expect_equal_where_known(recorded, simulated)


def test_damaged_and_lost_bytes_become_masked_samples(simulated, tmp_path):
    with Served(tmp_path / "gyro.sock", prepared(), speed=3.0, byte_errors=1e-3) as served, open_port(str(served.path)) as port:
        done = record(port, tmp_path / "run.h5", LiveOptions())
    recorded = Recording.open(tmp_path / "run.h5")
    lost = {name: int(recorded.tap(name).lost.sum()) for name in ("baseband", "output")}
    assert done.damaged_packets > 10 and done.lost_frames > 10 and lost["baseband"] > 10
    assert sum(lost.values()) <= done.lost_frames  # those before the first sample and behind the last one have no place
    assert {name: tap["lost"] for name, tap in done.taps.items()} == lost
    assert lost["baseband"] < 0.4 * recorded.tap("baseband").length
    expect_equal_where_known(recorded, simulated)


def test_frame_rates_and_bursts_on_demand(tmp_path):
    port = Loop(Device())
    done = record(port, tmp_path / "run.h5", LiveOptions(seconds=1.0, baseband_hz=250.0, output_hz=0.0, burst_samples=700))
    recorded = Recording.open(tmp_path / "run.h5")
    assert recorded.tap("baseband").sample_rate_hz == 250.0 and "output" not in recorded
    assert [burst.length for burst in recorded.bursts] == [700] and len(recorded.bursts[0].state_snapshot) > 500
    assert done.ended == "time is over" and 1.0 <= recorded.tap("baseband").duration_s < 1.3
    with pytest.raises(BadInput, match="whole fraction"):
        record(port, tmp_path / "no.h5", LiveOptions(baseband_hz=333.0))
    with pytest.raises(BadInput, match="no measurements"):
        record(Loop(Device()), tmp_path / "no.h5", LiveOptions(seconds=0.0, baseband_hz=0.0, output_hz=0.0))
    assert not list(tmp_path.glob("no.h5*"))


def test_a_file_of_telemetry(tmp_path):
    device = Device()
    device.ring(100000)
    (tmp_path / "telemetry.bin").write_bytes(device.telemetry()[5:-7])  # begins and ends within a frame: no identity
    with FilePort(str(tmp_path / "telemetry.bin")) as port, pytest.raises(BadInput, match="no identity"):
        record(port, tmp_path / "run.h5", LiveOptions())
    device.send(CommandEncoder().ping())
    device.ring(100000)
    (tmp_path / "telemetry.bin").write_bytes(device.telemetry()[:-7])
    with FilePort(str(tmp_path / "telemetry.bin")) as port:
        done = record(port, tmp_path / "run.h5", LiveOptions())
        with pytest.raises(BadInput, match="takes no commands"):
            Session(port)
    assert done.ended == "end of the file" and done.taps["baseband"]["samples"] >= 199


def test_a_device_that_starts_anew_ends_the_recording(tmp_path):
    device = Device()
    device.ring(50000)
    first = device.telemetry()
    again = Device()
    again.ring(100000)
    (tmp_path / "telemetry.bin").write_bytes(first + again.telemetry())
    with FilePort(str(tmp_path / "telemetry.bin")) as port:
        done = record(port, tmp_path / "run.h5", LiveOptions())
    recorded = Recording.open(tmp_path / "run.h5")
    assert done.ended == "the device was started anew" and recorded.tap("baseband").duration_s < 1.1
    assert [event.value for event in recorded.events if event.kind == "recording_ended"] == [done.ended]


def test_an_interval_of_another_length_or_place_does_not_disturb(tmp_path):
    """Frame rates changed by somebody else while recording: the recording keeps its own."""
    device = Device()
    encoder = CommandEncoder()
    for divisors in ((10, 10), (7, 3), (10, 10), (0, 10), (10, 10)):
        device.send(encoder.divisors(*divisors))
        device.ring(20000 + 50 * divisors[0])
    (tmp_path / "telemetry.bin").write_bytes(device.telemetry())
    with FilePort(str(tmp_path / "telemetry.bin")) as port:
        done = record(port, tmp_path / "run.h5", LiveOptions())
    assert done.ended == "end of the file" and done.ignored_frames > 100
    assert Recording.open(tmp_path / "run.h5").tap("output").sample_rate_hz == 100.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_with_a_valid_file(tmp_path, number):
    output = tmp_path / "run.h5"
    with Served(tmp_path / "gyro.sock", prepared(30.0), speed=15.0) as served:
        command = [sys.executable, "-P", "-m", "wineglass", "record", "--port", str(served.path), "-o", str(output), "--json"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(TOOLS)})
        deadline = time.monotonic() + 30.0
        while not (tmp_path / "run.h5.part").exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(0.5)
        process.send_signal(number)
        out, err = process.communicate(timeout=30.0)
    assert process.returncode == 0, err
    assert b'"ended": "interrupted"' in out
    assert Recording.open(output).tap("baseband").length > 0 and not (tmp_path / "run.h5.part").exists()


# ---- commands ------------------------------------------------------------------------------------------------------------


def test_identity_status_and_settings():
    session = Session(Loop(Device(serial=0x1234)))
    identity = session.identity()
    assert identity.unique_id == 0x1234 and identity.sample_rate_hz == 50000.0
    session.command("compensation", session.encoder.compensation, "static")
    session.command("filter", session.encoder.output_filter, "0.05")
    status = session.status()
    assert status["compensation"] == 1 and status["output_filter"] == 3 and status["commands_refused"] == 0


@pytest.mark.parametrize("method, argument, reason", [
    ("amplitude", 1.5, Reason.OUT_OF_RANGE), ("phase_set_point", 90.0, Reason.OUT_OF_RANGE), ("loop", "rebalance", Reason.OUT_OF_RANGE),
    ("raw_burst", 0, Reason.OUT_OF_RANGE), ("calibration_unlock", 7, Reason.WRONG_KEY), ("calibration_commit", 392, Reason.LOCKED)])
def test_refusals_say_why_and_are_counted(method, argument, reason):
    session = Session(Loop(Device()))
    with pytest.raises(Refused) as refused:
        session.command(method, getattr(session.encoder, method), argument)
    assert refused.value.reason == reason and f"reason {int(reason)}" in str(refused.value)
    assert session.status()["commands_refused"] == 1


def test_calibration_is_written_verified_and_read_back():
    block = block_for(prepared())
    session = Session(Loop(Device(serial=77)))
    with pytest.raises(Refused) as refused:
        session.calibration()
    assert refused.value.reason == Reason.NOTHING_STORED
    session.write_calibration(block, 77)
    assert session.calibration() == block
    assert session.identity().calibration_crc == calibration_block.unpack(block)["crc"]
    damaged = block[:100] + bytes([block[100] ^ 1]) + block[101:]
    with pytest.raises(Refused) as refused:
        session.write_calibration(damaged, 77)
    assert refused.value.reason == Reason.CALIBRATION_CRC and session.calibration() == block


def test_commands_get_through_a_bad_wire():
    block = block_for(prepared())
    for seed in range(8):
        damage = link_serve.Damage(1e-3, seed)
        port = Loop(Device(serial=5), damage, samples=500)
        session = Session(port, answer_s=0.1)
        session.write_calibration(block, 5)
        session.command("compensation", session.encoder.compensation, "g2")
        assert session.status()["compensation"] == 2


def test_a_silent_port_is_named():
    class Silent(Loop):
        def read(self, timeout_s):
            return b""

    with pytest.raises(BadInput, match="no answer to ping"):
        Session(Silent(Device()), answer_s=0.01).identity()


def test_another_calibration_than_was_written_is_noticed(monkeypatch):
    session = Session(Loop(Device(serial=5)))
    monkeypatch.setattr(session, "calibration", lambda: b"something else")
    with pytest.raises(WineglassError, match="reads back another calibration"):
        session.write_calibration(block_for(prepared()), 5)


# ---- ports ---------------------------------------------------------------------------------------------------------------


def exchange_over(port, other_end):
    port.write(b"to the device")
    assert other_end.recv(100) == b"to the device"
    other_end.sendall(b"from the device")
    assert port.read(5.0) == b"from the device" and port.read(0.0) == b""
    other_end.close()
    with pytest.raises(PortClosed, match="closed the connection"):
        port.read(5.0)
    port.close()


def test_tcp_and_unix_ports(tmp_path):
    with link_serve.listen_tcp("0") as listener:
        port = open_port("tcp://127.0.0.1:%d" % listener.getsockname()[1])
        exchange_over(port, listener.accept()[0])
    for name in (str(tmp_path / "a.sock"), f"unix:{tmp_path / 'b.sock'}"):
        with link_serve.listen_unix(tmp_path / name.rpartition("/")[2]) as listener:
            port = open_port(name)
            exchange_over(port, listener.accept()[0])
    assert list(tmp_path.iterdir()) == []


def test_a_serial_device():
    ours, theirs = pty.openpty()
    tty.setraw(ours)
    with open_port(os.ttyname(theirs), 115200) as port:
        port.write(b"\x00\x11\x13\xff")
        assert os.read(ours, 100) == b"\x00\x11\x13\xff"
        os.write(ours, b"\x03\x0a\x0d\x00")
        assert port.read(5.0) == b"\x03\x0a\x0d\x00" and port.read(0.0) == b""
        os.close(ours)
        os.close(theirs)
        with pytest.raises(PortClosed):
            port.read(0.5)
            port.read(0.5)


@pytest.mark.parametrize("name", ["/dev/no-such-tty", "tcp://127.0.0.1:1", "tcp://nowhere", "unix:/no/such.sock", "/dev/null", "/tmp"])
def test_ports_that_are_none(name):
    with pytest.raises(BadInput) as refusal:
        open_port(name)
    assert name in str(refusal.value) and refusal.value.todo


def test_a_socket_that_nobody_listens_to(tmp_path):
    with socket.socket(socket.AF_UNIX) as orphan:
        orphan.bind(str(tmp_path / "gone.sock"))
    with pytest.raises(BadInput, match="no connection"):
        open_port(str(tmp_path / "gone.sock"))
    with pytest.raises(BadInput, match="no socket can be made"), link_serve.listen_unix(tmp_path / "gone.sock"):
        pass


def test_tcp_addresses():
    assert tcp_address("tcp://host:5000") == ("host", 5000) and tcp_address("5000") == ("localhost", 5000)
    assert tcp_address("[::1]:7") == ("::1", 7)


# ---- the served twin -----------------------------------------------------------------------------------------------------


def test_damage_hits_as_often_as_asked_for():
    data = bytes(range(256)) * 4000
    assert link_serve.Damage(0.0, 1)(data) == data
    damaged = link_serve.Damage(1e-3, 1)(data)
    assert damaged != data and abs(len(damaged) - len(data)) < 5 * np.sqrt(1e-3 * len(data))


def test_commands_reach_the_served_device(tmp_path):
    with Served(tmp_path / "gyro.sock", prepared(3.0), speed=3.0) as served:
        with open_port(str(served.path)) as port:
            session = Session(port)
            session.command("amplitude", session.encoder.amplitude, 0.5)
            assert session.identity().device_name == prepared().device.name
        with open_port(str(served.path)) as port:  # somebody else, later
            assert Session(port).status()["commands_accepted"] >= 2
    assert served.done.clients == 2 and served.done.simulated_s == 3.0


def test_the_served_bytes_are_the_twin_s(tmp_path):
    run = prepared(1.0)
    received = b""
    with Served(tmp_path / "gyro.sock", run, speed=3.0) as served, open_port(str(served.path)) as port:
        try:
            while True:
                received += port.read(1.0)
        except PortClosed:
            pass
    with Twin(run) as twin:
        encoder = CommandEncoder()
        twin.command(encoder.divisors(run.divisor(100.0), run.divisor(50.0)))
        twin.poll()
        twin.step(run.n_blocks)
        assert received == twin.telemetry()


# ---- the command line ----------------------------------------------------------------------------------------------------


def test_device_and_record_from_the_command_line(tmp_path, capfd):
    socket_path = tmp_path / "gyro.sock"
    with Served(socket_path, prepared(12.0), speed=4.0):
        assert cli.main(["device", "--port", str(socket_path), "--compensation", "static", "--output-hz", "100", "--json"]) == 0
        told = json.loads(capfd.readouterr().out)
        assert told["status"]["compensation"] == "static" and told["status"]["output_hz"] == 100.0 and told["refused"] == []
        kept = tmp_path / "kept.json"
        assert cli.main(["device", "--port", str(socket_path), "--phase", "90", "--filter", "0.1", "--read-calibration", str(kept), "--json"]) == 1
        output = capfd.readouterr()
        assert "phase: the device refused it (" in output.err and "reason 4)" in output.err
        assert json.loads(output.out)["status"]["output_filter"] == "0.1"
        assert cli.main(["device", "--port", str(socket_path), "--write-calibration", str(kept), "--read-calibration", str(tmp_path / "kept.bin")]) == 0
        assert (tmp_path / "kept.bin").read_bytes() == calibration_block.to_binary(calibration_block.read_json(kept)) == block_for(prepared())
        assert "commands accepted" in capfd.readouterr().out
        assert cli.main(["record", "--port", str(socket_path), "-o", str(tmp_path / "run.h5"), "--seconds", "0.5", "--device", "metal"]) == 0
        assert "time is over" in capfd.readouterr().out
    assert Recording.open(tmp_path / "run.h5").device_toml


@pytest.mark.parametrize("words", [
    ["record", "--port", "/no/such", "-o", "x.h5"], ["device", "--port", "/no/such"], ["serve", "cold-start", "--tcp", "what"],
    ["serve", "cold-start", "--tcp", "0", "--speed", "-1"], ["fuzz", "--seconds", "0"], ["fuzz", "--only", "nothing"],
    ["device", "--port", "/no/such", "--write-calibration", "/no/such.json"]])
def test_bad_words_are_one_line_and_status_2(words, capfd):
    assert cli.main(words) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1

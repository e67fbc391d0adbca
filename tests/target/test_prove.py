"""The proof that target and host do the same: it holds, and it fails where it must."""

import dataclasses
import json
import struct

import h5py
import pytest
from conftest import make_ready

from wineglass import cli
from wineglass.emulation import machines, proof
from wineglass.emulation.machines import M4, STM32F405
from wineglass.recording import Recording
from wineglass.recording.difference import compare


@pytest.fixture(scope="module")
def proved(tmp_path_factory):
    """One run of the whole command, and what it said."""
    make_ready(M4), make_ready(STM32F405)
    folder = tmp_path_factory.mktemp("prove")
    lock_step = proof.lock_step(M4, 1.2, folder)
    board = proof.board(STM32F405.program("wineglass_stm32f405.elf"), folder)
    return folder, lock_step, board


def test_the_processor_does_what_the_host_does(proved):
    folder, found, _ = proved
    assert found.difference == ""
    assert found.compared["DAC codes"] == 2 * 60_000 and found.compared["telemetry bytes"] > 100_000
    assert found.compared["samples of baseband"] >= 1190 and found.compared["samples of raw burst 0"] == proof.BURST_SAMPLES
    with Recording.open(folder / "mps2-an386.h5") as recorded:
        assert abs(recorded.tap("baseband")["primary_in_phase"][-1]) > 0.5, "it rings"
        assert abs(recorded.tap("baseband")["rebalance_quadrature"][-1]) > 0.0, "the rebalance loop is closed"


def test_the_boards_image_does_what_the_host_does(proved):
    _, _, found = proved
    assert found.difference == ""
    assert found.compared["samples of baseband"] >= proof.BOARD_SAMPLES // 50 and found.compared["bytes of state"] > 900


def test_a_wrong_bit_in_the_target_is_named(m4, tmp_path, monkeypatch, capsys):
    """One bit of the sine table in the M4's image: exit status 1, the first sample and the first module in the chain."""
    image = bytearray(m4.program().read_bytes())
    image[image.find(struct.pack("<4i", 2**30, 0, 1072448455, 52686014)) + 8 * 17 + 1] ^= 0x10
    broken = tmp_path / "broken"
    broken.write_bytes(image)
    other = dataclasses.replace(m4, emulator=tuple(word.replace("{program}", str(broken)) for word in m4.emulator))
    monkeypatch.setattr(machines, "BOARDS", (other,))
    monkeypatch.setattr(proof, "board", lambda *_: proof.Proof("the image", "", ""))
    assert cli.main(["--json", "prove", "--seconds", "0.3", "-o", str(tmp_path / "out")]) == 1
    said = json.loads(capsys.readouterr().out)
    assert not said["equal"] and "primary_lockin differs" in said["proofs"][0]["difference"]
    assert int(said["proofs"][0]["difference"].split(":")[0].removeprefix("sample ")) < 15_000


@pytest.mark.parametrize("where", ["baseband/status", "output/rate", "raw/burst_0000/drive_dac_raw"])
def test_recordings_that_differ_in_one_code(proved, tmp_path, where):
    folder, _, _ = proved
    changed = tmp_path / "changed.h5"
    changed.write_bytes((folder / "mps2-an386.h5").read_bytes())
    with h5py.File(changed, "r+") as file:
        name = next(name for name in file["raw"]) if where.startswith("raw") else ""
        dataset = file[where.replace("burst_0000", name)]
        dataset[7] = dataset[7] ^ 1
    with Recording.open(folder / "mps2-an386.h5") as one, Recording.open(changed) as other:
        found = compare(one, other).difference
        tap = one.bursts[0] if where.startswith("raw") else one.taps[where.split("/")[0]]
        step = tap.counter_rate_hz / tap.sample_rate_hz
    assert found is not None and found.channel == where.rpartition("/")[2] and found.sample == tap.first_sample + 7 * step


def test_what_is_missing_is_said_in_one_line(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert cli.main(["prove", "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1 and "qemu-system-arm" in said.err and "gcc-arm-none-eabi" in said.err
    assert not (tmp_path / "out").exists()

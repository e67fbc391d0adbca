"""docs/guides/port-to-your-board.md, followed from nothing: its code is taken from the page, built and booted."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from wineglass.commands_wire import CommandEncoder, Reason
from wineglass.emulation.boot import Boot
from wineglass.emulation.machines import Machine
from wineglass.telemetry import Decoder, Identity, merge

ROOT = Path(__file__).resolve().parents[2]
GUIDE = (ROOT / "docs/guides/port-to-your-board.md").read_text(encoding="utf-8")
BOARD = Machine("myboard", "Cortex-M3", "arm-none-eabi-gcc",
                ("qemu-system-arm", "-M", "lm3s6965evb", "-display", "none", "-monitor", "none", "-no-reboot", "-serial", "chardev:line",
                 "-kernel", "{program}"), ())


def test_the_port_of_the_guide_runs(tmp_path):
    if BOARD.missing():
        pytest.skip(f"{' and '.join(BOARD.missing())} not installed")
    follow(tmp_path)
    decoder, send = Decoder(), CommandEncoder()
    with Boot(tmp_path / "build/myboard/bin/wineglass_myboard", BOARD) as board:
        frames = decoder.feed(b"")
        board.send(send.ping() + send.calibration_unlock(42))
        for _ in range(100):
            frames = merge([frames, decoder.feed(board.receive(1, 1.0))])
            if len(frames.output) >= 3 and len(frames.ack) >= 2:
                break
    assert Identity.of(frames.identity[0]).unique_id == 42 and len(frames.identity) == 2
    assert frames.ack["reason"].tolist() == [Reason.OK] * 2 and len(frames.output) >= 3
    assert decoder.statistics.bad_crc == decoder.statistics.bad_packets == decoder.statistics.lost_frames == 0


def follow(tree: Path) -> None:
    """What a reader does: the files of the page, then its commands."""
    for name in ("firmware", "hal", "cmake"):
        shutil.copytree(ROOT / name, tree / name)
    shutil.copy(ROOT / "CMakeLists.txt", tree)
    files = re.findall(r"^`(hal/myboard/[\w.]+)`.*?^```\w+\n(.*?)^```", GUIDE, re.MULTILINE | re.DOTALL)
    assert len(files) == 4
    for name, text in files:
        (tree / name).parent.mkdir(exist_ok=True)
        (tree / name).write_text(text)
    commands = re.search(r"^    cmake -S .*?\n\n", GUIDE, re.MULTILINE | re.DOTALL)
    subprocess.run(["sh", "-e", "-c", commands[0]], cwd=tree, check=True, stdout=subprocess.DEVNULL)

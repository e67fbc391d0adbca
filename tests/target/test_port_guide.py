"""docs/guides/port-to-your-board.md, followed from nothing: its code is taken from the page, built and booted."""

import os
import re
import shutil
import subprocess
import sys
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
    copy(tmp_path)
    build(tmp_path)
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


def test_another_sample_rate(tmp_path):
    """As the page says: a block made for it, named among the sources."""
    if BOARD.missing():
        pytest.skip(f"{' and '.join(BOARD.missing())} not installed")
    assert "tools/tables/default_calibration.py sample_rate_hz=48000.0 > hal/myboard/calibration.c" in GUIDE
    copy(tmp_path)
    made = subprocess.run([sys.executable, ROOT / "tools/tables/default_calibration.py", "sample_rate_hz=48000.0"], check=True, capture_output=True,
                          env=os.environ | {"PYTHONPATH": str(ROOT / "tools")})
    (tmp_path / "hal/myboard/calibration.c").write_bytes(made.stdout)
    change(tmp_path / "hal/myboard/CMakeLists.txt", "startup.c)", "startup.c calibration.c)")
    change(tmp_path / "hal/myboard/main.c", ".sample_rate_millihz = 50000000", ".sample_rate_millihz = 48000000")
    build(tmp_path)
    with Boot(tmp_path / "build/myboard/bin/wineglass_myboard", BOARD) as board:
        frames = Decoder().feed(board.receive(200))
    assert Identity.of(frames.identity[0]).sample_rate_hz == 48_000


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def copy(tree: Path) -> None:
    """The files of the page, in a tree as the reader has it."""
    for name in ("firmware", "hal", "cmake"):
        shutil.copytree(ROOT / name, tree / name)
    shutil.copy(ROOT / "CMakeLists.txt", tree)
    files = re.findall(r"^`(hal/myboard/[\w.]+)`.*?^```\w+\n(.*?)^```", GUIDE, re.MULTILINE | re.DOTALL)
    assert len(files) == 4
    for name, text in files:
        (tree / name).parent.mkdir(exist_ok=True)
        (tree / name).write_text(text)


def build(tree: Path) -> None:
    """The page's commands."""
    commands = re.search(r"^    cmake -S .*?\n\n", GUIDE, re.MULTILINE | re.DOTALL)
    subprocess.run(["sh", "-e", "-c", commands[0]], cwd=tree, check=True, stdout=subprocess.DEVNULL)

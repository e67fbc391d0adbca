"""`wineglass flash` without a board: what is refused before one is touched, and the exact command line of either tool."""

import json
import os
import zlib

import pytest

from wineglass import flash
from wineglass.cli import main
from wineglass.errors import BadInput


@pytest.fixture
def image(tmp_path):
    return sealed(tmp_path / "an image.bin", 1000)


def sealed(path, size):
    content = bytes(at * 7 & 0xFF for at in range(size - 4))
    path.write_bytes(content + zlib.crc32(content).to_bytes(4, "little"))
    return path


def fake_tool(folder, name, status):
    """A program that notes its arguments."""
    script = folder / name
    script.write_text(f'#!/bin/sh\nfor word; do printf "%s\\n" "$word"; done > "{folder}/said"\nexit {status}\n')
    script.chmod(0o755)


def said(folder):
    return (folder / "said").read_text().splitlines()


def test_openocd_is_called_with_verification(image, tmp_path, monkeypatch, capsys):
    fake_tool(tmp_path, "openocd", 0)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert main(["flash", "--image", str(image)]) == 0
    assert said(tmp_path) == ["-f", "interface/stlink.cfg", "-f", "target/stm32f4x.cfg", "-c",
                              f"program {{{image}}} verify reset exit 0x08000000"]
    assert "written and verified" in capsys.readouterr().out


def test_stm32flash_erases_the_program_only(image, tmp_path, monkeypatch):
    fake_tool(tmp_path, "stm32flash", 0)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert main(["flash", "--image", str(image), "--port", "/dev/ttyUSB7"]) == 0
    assert said(tmp_path) == ["-b", "115200", "-S", "0x08000000:1000", "-w", str(image), "-v", "-g", "0x0", "/dev/ttyUSB7"]


def test_a_tool_that_fails_is_no_success(image, tmp_path, monkeypatch, capsys):
    fake_tool(tmp_path, "openocd", 3)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert main(["flash", "--image", str(image)]) == 1
    assert "openocd ended with status 3" in capsys.readouterr().err


def test_dry_run_needs_no_tool(image, monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["flash", "--image", str(image), "--dry-run", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["written"] is False and answer["bytes"] == 1000 and answer["command"][0] == "openocd"


def test_without_the_tool_there_is_one_line(image, monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["flash", "--image", str(image)]) == 1
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("damage, text", [
    (lambda content: content[:-1], "seal"), (lambda content: content[:10] + b"?" + content[11:], "seal"),
    (lambda content: content * 60, "at most"), (lambda content: b"", "at most"),
])
def test_damaged_images_are_refused(image, damage, text):
    image.write_bytes(damage(image.read_bytes()))
    with pytest.raises(BadInput, match=text):
        flash.check(image)


def test_the_largest_image_fits(tmp_path):
    assert flash.check(sealed(tmp_path / "full.bin", flash.PROGRAM_BYTES)) == flash.PROGRAM_BYTES
    with pytest.raises(BadInput, match="not there"):
        flash.check(tmp_path / "none.bin")


@pytest.mark.parametrize("tool, port", [("stm32flash", None), ("openocd", "/dev/ttyS0")])
def test_tool_and_port_must_agree(tool, port):
    with pytest.raises(BadInput, match="--port"):
        flash.choose(tool, port)


def test_bringup_has_one_rate(capsys):
    assert main(["flash", "--dry-run", "--no-build", "--bringup", "--rate", "96000"]) == 2
    assert "50000" in capsys.readouterr().err

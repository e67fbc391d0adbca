"""docs/SPEC.md says what the programs do: its tables of bytes against the structures of the tools."""

import re
import struct
from pathlib import Path

import pytest

from wineglass import calibration_block, wire
from wineglass.commands_wire import Command, Reason

TEXT = (Path(__file__).resolve().parents[2] / "docs/SPEC.md").read_text(encoding="utf-8")


def section(title):
    match = re.search(rf"^#+ {re.escape(title)}$(.*?)(?=^#+ |\Z)", TEXT, re.MULTILINE | re.DOTALL)
    assert match, title
    return match[1]


def rows(title):
    """Table rows whose first cell is a number: (number, second cell, third cell)."""
    found = []
    for line in section(title).splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and len(cells) >= 3 and cells[0].isdigit():
            found.append((int(cells[0]), cells[1], cells[2]))
    return found


SIZES = {"u8": 1, "u16": 2, "u32": 4, "u64": 8, "i32": 4, "i64": 8}


def size_of(kind):
    if match := re.fullmatch(r"(\w+) ×(\d)", kind):
        return SIZES[match[1]] * int(match[2])
    if match := re.fullmatch(r"(\d+) bytes", kind):
        return int(match[1])
    return sum(SIZES[part] for part in kind.split(", "))


@pytest.mark.parametrize(("title", "kind"), [
    ("1 identity", wire.FrameType.IDENTITY), ("2 status", wire.FrameType.STATUS), ("3 baseband", wire.FrameType.BASEBAND),
    ("4 output", wire.FrameType.OUTPUT), ("7 acknowledgement", wire.FrameType.ACK),
    ("9 self-test", wire.FrameType.SELF_TEST), ("10 sync", wire.FrameType.SYNC), ("11 phases", wire.FrameType.PHASES),
])
def test_frames_have_no_holes_and_their_size(title, kind):
    at = 0
    dtype = wire.DTYPES[kind]
    starts = {dtype.fields[name][1] - wire.HEADER.size for name in dtype.names}
    for offset, field_type, _ in rows(title):
        assert offset == at and offset in starts
        at += size_of(field_type)
    assert at == dtype.itemsize - wire.HEADER.size


@pytest.mark.parametrize(("title", "kind"), [("5 raw", wire.FrameType.RAW), ("6 snapshot", wire.FrameType.SNAPSHOT)])
def test_open_ended_frames_begin_with_their_record(title, kind):
    *fixed, last = rows(title)
    at = 0
    for offset, field_type, _ in fixed:
        assert offset == at
        at += size_of(field_type)
    assert last[0] == at == wire.DTYPES[kind].itemsize - wire.HEADER.size


def test_calibration_block():
    offsets, at = {}, 0
    for name, code in calibration_block.LAYOUT:
        offsets[name] = at
        at += struct.calcsize("<" + code)
    listed = rows("Calibration block")
    end = 0
    for offset, kind, name in listed:
        assert offset == end, name
        assert offset == offsets[name.split(" ")[0]]
        end += size_of(kind)
    assert end == at == calibration_block.SIZE


def test_commands_and_reasons():
    text = section("Commands")
    assert {int(number, 16) for number in re.findall(r"^\| (0x\w\w) \|", text, re.MULTILINE)} == set(Command)
    numbers = {int(n) for line in text.splitlines() for n in re.findall(r"\| (\d+) \| [^|0-9]", line) if "0x" not in line}
    assert numbers == set(Reason)


def test_status_bits():
    assert [bit for bit, *_ in re.findall(r"^\| (\d+) \|(.*)\|$", section("Status word"), re.MULTILINE)] == [
        str(bit.bit_length() - 1) for bit in wire.Status]


def test_parts_of_a_board():
    assert sorted(map(int, re.findall(r"\| bit (\d+) \|", section("9 self-test")))) == [part.bit_length() - 1 for part in wire.Part]

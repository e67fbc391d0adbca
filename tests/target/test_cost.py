"""What the firmware costs stays within its bars, and the counting itself can be trusted."""

import subprocess

import pytest

from wineglass.cost import golden, rows, stack
from wineglass.emulation.machines import STM32F405
from wineglass.errors import BadInput, WineglassError

GRAPH = '''graph: { title: "a.c"
node: { title: "outer" label: "outer\\na.c:1:1\\n40 bytes (static)" }
node: { title: "a.c:inner" label: "inner\\na.c:2:1\\n24 bytes (static)" }
node: { title: "leaf" label: "leaf\\na.c:3:1\\n8 bytes (static)" }
edge: { sourcename: "outer" targetname: "a.c:inner" label: "a.c:9:9" }
edge: { sourcename: "outer" targetname: "leaf" label: "a.c:9:9" }
edge: { sourcename: "a.c:inner" targetname: "leaf" label: "a.c:9:9" }
}'''


def test_bars(m4):
    """Every bar holds but those on the list of open ones, and that list is no longer than it must be."""
    from wineglass.cost import measure

    figures = golden.figures(measure.measure())
    above = {name for name, bar in golden.BARS.items() if figures[name] > bar}
    assert above <= set(rows.NOT_YET), f"above their bars: {golden.missed(figures)}"
    assert above >= set(rows.NOT_YET), f"reached, take them off rows.NOT_YET: {sorted(set(rows.NOT_YET) - above)}"


def test_open_bars_are_bars():
    assert set(rows.NOT_YET) <= set(golden.BARS)


def test_deepest_path(tmp_path):
    (tmp_path / "a.ci").write_text(GRAPH)
    worst = stack.worst(stack.read(tmp_path.glob("*.ci")), "outer")
    assert worst == stack.Worst(72, ("outer", "inner", "leaf"))


@pytest.mark.parametrize("change, text", [
    (('targetname: "leaf" label', 'targetname: "outer" label'), "recursion"),
    (('targetname: "leaf" label', 'targetname: "__indirect_call" label'), "pointer"),
    (("24 bytes (static)", "24 bytes (dynamic)"), "no fixed size"),
    (("24 bytes (static)", "no size"), "not known"),
])
def test_stacks_without_a_bound_are_refused(tmp_path, change, text):
    (tmp_path / "a.ci").write_text(GRAPH.replace(*change))
    with pytest.raises(WineglassError, match=text):
        stack.worst(stack.read(tmp_path.glob("*.ci")), "outer")


def test_the_image_is_counted_too(m4):
    """Flash and memory of the file that is flashed, by another way than the counting: the length of the .bin, and the linker's symbols."""
    from wineglass.cost import image

    STM32F405.build(emulated=False)
    found, program = image.measure(), image.program()
    assert found.flash_bytes == program.with_suffix(".bin").stat().st_size
    addresses = dict(reversed(line.split()[::2]) for line in subprocess.run(["arm-none-eabi-nm", str(program)], capture_output=True, text=True,
                                                                            check=True).stdout.splitlines() if len(line.split()) == 3)
    assert abs(int(addresses["bss_end"], 16) - 0x20000000 - found.memory_bytes) <= 64
    assert found.stack_bytes > max(path.bytes for path in found.paths)


def test_counts_of_another_commit(tmp_path, monkeypatch):
    """A history of two commits: the last one's counts while something is changed, else those of the one before it."""
    def git(*words):
        subprocess.run(["git", "-c", "user.name=a", "-c", "user.email=a@b", *words], cwd=tmp_path, check=True, capture_output=True)

    monkeypatch.setattr(golden, "FILE", tmp_path / "tests/golden/cost.json")
    assert golden.load() == ("the file", {}), "no history, no file"
    git("init")
    (tmp_path / "firmware").mkdir()
    (tmp_path / "tests").mkdir()
    for count in (10, 7):
        (tmp_path / "firmware/a.c").write_text(f"{count}")
        golden.save({"a, mean": count})
        git("add", "-A")
        git("commit", "-m", "x")
    assert golden.load() == ("HEAD~", {"a, mean": 10})
    (tmp_path / "firmware/a.c").write_text("changed")
    assert golden.load() == ("HEAD", {"a, mean": 7})
    assert golden.load("HEAD~1")[1] == {"a, mean": 10}
    with pytest.raises(BadInput, match="no counts"):
        golden.load("HEAD~7")

"""What the firmware costs stays within its bars, and the counting itself can be trusted."""

import pytest

from wineglass.cost import golden, rows, stack
from wineglass.errors import WineglassError

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

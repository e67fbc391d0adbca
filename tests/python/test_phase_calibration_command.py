"""`wineglass phase-calibration`: from the command line to a calibration that is right."""

import json

import pytest

from wineglass import calibration_block as cb
from wineglass import cli, paths
from wineglass.errors import BadInput
from wineglass.phases import Found, Outcome, PhaseResult, with_phases

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")


def command(*arguments: object) -> int:
    return cli.main(["phase-calibration", *map(str, arguments)])


def test_a_delay_that_the_calibration_does_not_know_becomes_the_drive_phase(tmp_path, capsys):
    path = tmp_path / "out.json"
    assert command("metal", "--temperatures=-20,60", "--drive-only", "--set", "electronics.adc.delay_samples=0.016", "-o", path, "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    found = cb.read_json(path)
    assert found.drive_phase_rad == answer["drive_phase_rad"] and found.sequence == 2
    assert found.drive_phase_rad[0] == pytest.approx(0.016 * 0.2 * 3.14159, abs=1e-4)
    assert abs(found.drive_phase_rad[1]) * 80 < 1e-4
    assert not any(found.demodulation_phase_rad)


@pytest.mark.parametrize(("arguments", "part"), [
    (["metal", "--temperatures=hot"], "no list of temperatures"), (["metal", "--order=6"], "order 6"), (["metal", "-o", "out.txt"], ".json or .bin"),
    (["brass"], "brass"),
])
def test_bad_input_is_one_line(arguments, part, capsys):
    assert command(*arguments) == 2
    error = capsys.readouterr().err
    assert part in error and error.count("\n") == 1


def test_a_calibration_that_was_not_done_is_no_result():
    good = PhaseResult(Outcome.DONE, 1, 0.0, Found(0.0, 0.0, 0.001), Found(0.0, 0.0, 0.0))
    bad = PhaseResult(Outcome.DISTURBED, 1, 10.0, Found(0.0, 0.0, 0.002), Found(0.0, 0.0, 0.0))
    golden = cb.read_json(paths.repository_root() / "tests/golden/calibration_block.json")
    assert with_phases(golden, [good], 3).drive_phase_rad == [0.001]
    with pytest.raises(BadInput, match="not every"):
        with_phases(golden, [good, bad], 1)

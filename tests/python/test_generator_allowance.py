"""The oracle beyond tolerances: what a healthy unit could do is no gap, what it could not is one. References: the units themselves, run as such."""

import generator_case as cases
import numpy as np
import pytest

from wineglass import device as devices
from wineglass.blind import generator
from wineglass.blind.generator import Applied, allowance, making, unit
from wineglass.blind.generator.allowance import Runs
from wineglass.blind.generator.oracle import measured


@pytest.fixture(scope="module")
def allowed():
    case = cases.case("open")

    def run(quiet, fields=None):
        return allowance.run(allowance.alike(case, quiet, fields), cases.block)

    plain = Runs(run(True), run(False))
    moves = {one.name: (one.by, Runs(run(True, one.fields))) for one in allowance.moved(case)}
    moves |= {one.name: (one.by, Runs(plain.quiet, run(False, one.fields))) for one in allowance.louder(case)}
    return case, allowance.gathered(plain, moves)


def graded(allowed, *effects):
    case, found = allowed
    return allowance.graded(generator.Case(case.scenario, effects), cases.block, found)


@pytest.mark.parametrize("id, variant, strength", [
    ("frequency_temperature", "slope", 0.25), ("cross_damping", "constant", 4.0), ("cross_stiffness", "constant", 0.1), ("thermometer_error", "offset", 0.1),
    ("clock_error", "constant", 20.0), ("clock_error", "constant", 400.0), ("coriolis_gain", "constant", -0.01)])
def test_one_standard_deviation_of_a_tolerance_is_no_gap(allowed, id, variant, strength):
    total, each = graded(allowed, Applied(id, variant, strength))
    assert total.snr < 4.0 and each == [total], f"{total.snr:.1f} in {total.channel}"


@pytest.mark.parametrize("id, variant, strength", [
    ("cross_damping", "constant", 60.0), ("thermometer_lag", "one_pole", 1.0), ("frequency_temperature", "slope", 3.0), ("excess_noise", "white", 3.0),
    ("drive_phase", "delay", 3.0), ("vibration", "rocking", 0.3)])
def test_what_no_healthy_unit_does_is_a_gap(allowed, id, variant, strength):
    total, _ = graded(allowed, Applied(id, variant, strength))
    assert total.snr > 8.0, f"{total.snr:.1f} in {total.channel}"


def test_two_effects_are_graded_one_beside_the_other(allowed):
    lag, clock = Applied("thermometer_lag", "one_pole", 1.0), Applied("clock_error", "constant", 20.0)
    total, each = graded(allowed, lag, clock)
    alone, _ = graded(allowed, lag)
    assert each[0].snr == pytest.approx(alone.snr) == pytest.approx(total.snr, rel=0.05) and each[1].snr < 4.0


@pytest.mark.parametrize("effects", [(), (Applied("firmware_mismatch", "scaled_output", 0.01), Applied("rate_reference", "scale", 0.03))])
def test_the_oracle_looks_at_what_the_recording_holds(tmp_path, effects):
    case = generator.Case(cases.case("open").scenario, effects)
    generator.make(case, tmp_path / "case.h5", cases.block(case))
    file, memory = measured(tmp_path / "case.h5"), making.looked_at(case, cases.block(case))
    assert list(file.values) == list(memory.values) and len(file.values) > 10
    assert all(np.array_equal(file.values[name], memory.values[name], equal_nan=True) for name in file.values)
    assert file.per_mean == memory.per_mean and file.floor == memory.floor


def test_moved_units_are_those_of_the_tolerances(allowed):
    case, found = allowed
    described = devices.load(case.scenario.device)
    assert len(found.names) == sum(np.size(one.absolute) if one.absolute is not None else 1 for one in described.tolerance.values())
    off = {"resonator.cross_damping_rad_s[1]": 2.0, "resonator.angular_gain": 1.0, "resonator.q": -1.0}
    fields = unit.at(described, off)
    assert fields["resonator.cross_damping_rad_s"][1] == pytest.approx(described.resonator.cross_damping_rad_s[1] + 2 * 5e-7)
    assert fields["resonator.q"] == pytest.approx(9000.0) and fields["resonator.angular_gain"] == 2.0  # no shell has more


def test_kept_and_loaded_it_says_the_same(allowed, tmp_path):
    _, found = allowed
    allowance.save(found, tmp_path)
    again = allowance.load(tmp_path)
    assert again.names == found.names and np.array_equal(again.moves, found.moves)
    assert again.whitening.places == found.whitening.places and again.whitening.plain.noisy.floor == found.whitening.plain.noisy.floor

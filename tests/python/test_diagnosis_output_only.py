"""A described device's output without baseband: judged against its envelope twin, within its tolerances. Recordings are the full twin's, firmware in the loop.

The seeds are fixed here; `WINEGLASS_SEED` adds to them.
"""

import os

import h5py
import numpy as np
import pytest

from wineglass import effects, protocols, scenario
from wineglass.cli import main
from wineglass.diagnosis.evidence import from_recording
from wineglass.diagnosis.rate_level import analyse
from wineglass.diagnosis.unit import Unit
from wineglass.diagnosis.verdict import diagnose
from wineglass.effects import Setting
from wineglass.simulation import simulate

SEED = int(os.environ.get("WINEGLASS_SEED", "0"))


def recorded(folder, protocol, loop, chosen=(), seed=1, other_unit=False):
    """Output and references of a metal-fast, nothing else."""
    print(f"seed {SEED + seed}")
    run = scenario.prepare(protocols.scenario(protocol, device="metal-fast", loop=loop, seed=SEED + seed))
    if other_unit:
        unit = Unit.of(run.device)
        truth = unit.at(np.random.default_rng([SEED + seed, 3]).standard_normal(len(unit.uncertain))).device
        run = scenario.Run(run.scenario, run.device, truth)
    simulate(run, folder / "all.h5", effects=list(chosen))
    with h5py.File(folder / "all.h5") as source, h5py.File(folder / "output.h5", "w") as target:
        target.attrs.update(source.attrs)
        for name in source:
            if name not in ("raw", "baseband"):
                source.copy(name, target)
    return folder / "output.h5"


def answer(path):
    evidence = from_recording(path)
    found = diagnose(evidence, analyse(evidence))
    print(found.verdict, found.alternatives, {"+".join(h.ids): round(h.probability, 2) for h in found.hypotheses[:6]})
    return found


def named(found):
    return [set(ids) for ids in found.alternatives] or [{e.id for e in found.effects}]


@pytest.mark.parametrize("protocol, loop, other_unit", [("full", "open", True), ("thermal", "rebalance", False)])
def test_a_healthy_unit_is_no_gap(tmp_path, protocol, loop, other_unit):
    """With test forces, ring-downs, steps of rate and amplitude, and nobody who says when the loop was locked."""
    assert answer(recorded(tmp_path, protocol, loop, other_unit=other_unit)).verdict == "no_gap"


def test_a_drift_is_named_alone_and_its_size_is_right(tmp_path):
    found = answer(recorded(tmp_path, "full", "open", [Setting("ageing", {"linear_rad_s_per_h": 2e-3})], seed=2))
    assert found.verdict == "attributed" and named(found) == [{"ageing"}]
    assert found.shrink.all.fraction > 0.9 and "envelope twin" in " ".join(found.notes)


def test_a_gradient_has_the_twins_size(tmp_path):
    found = answer(recorded(tmp_path, "thermal", "open", [effects.typical("thermal_gradient", 2.0)], seed=3))
    assert {"thermal_gradient"} in named(found)
    size = next(e for e in found.effects if e.id == "thermal_gradient").parameters[0]
    assert size.name == "bias_rad_s_per_degc_s" and size.value == pytest.approx(2e-3, rel=0.05)


def test_what_looks_alike_without_baseband_is_listed(tmp_path):
    """An offset of the bias over temperature has many possible places; a noisier rate, several reasons. Never one name for them."""
    found = answer(recorded(tmp_path, "full", "rebalance", [effects.typical("cross_damping", 5.0)], seed=4))
    assert found.verdict in ("ambiguous", "unknown") and any({"cross_damping"} <= {i for i in h.ids} for h in found.hypotheses)
    noisy = answer(recorded(tmp_path, "thermal", "open", [effects.typical("excess_noise", 3.0)], seed=5))
    assert noisy.verdict == "ambiguous" and {"excess_noise"} in named(noisy) and {"clock_jitter"} in named(noisy)
    assert noisy.next_experiment is not None and "baseband" in noisy.next_experiment.run


def test_coarse_readings_are_named_where_the_description_says_how_fine_they_should_be(tmp_path):
    found = answer(recorded(tmp_path, "thermal", "open", [Setting("thermometer_quantisation", {"step_degc": 1.0})], seed=6))
    assert {"thermometer_quantisation"} in named(found)
    step = next(e for e in found.effects if e.id == "thermometer_quantisation").parameters[0]
    assert step.value == pytest.approx(1.0, rel=0.02)


def test_a_late_thermometer_does_not_spoil_the_rate(tmp_path):
    """The firmware's scale factor goes by the thermometer: what that does to the rate is the thermometer's doing."""
    found = answer(recorded(tmp_path, "thermal", "rebalance", [Setting("thermometer_lag", {"lag_s": 6.0})], seed=7))
    assert {"thermometer_lag"} in named(found)
    lag = next(e for e in found.effects if e.id == "thermometer_lag").parameters[0]
    assert lag.value == pytest.approx(6.0, rel=0.1)


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("healthy"), "operating", "open", seed=8)


def put(path, change):
    with h5py.File(path, "r+") as file:
        change(file)


def attribute(channel, name, change_value):
    def change(file):
        file[channel].attrs[name] = change_value(file[channel].attrs[name])
    return change


@pytest.mark.parametrize("change, says", [
    (attribute("output/temperature_measured", "offset", lambda kelvin: kelvin + 273.15), "check its unit"),
    (attribute("output/rate_uncompensated", "unit", lambda unit: "furlong/s"), "is unknown"),
    (lambda file: (file.__delitem__("output/rate"), file.__delitem__("output/rate_uncompensated")), "holds no rate"),
    (lambda file: file.__delitem__("output/temperature_measured"), "no temperature_measured"),
    (lambda file: file["events"].__setitem__(-1, (0, *list(file["events"][-1])[1:])), "events"),
])
def test_bad_recordings_are_one_line_and_nothing_is_written(healthy, tmp_path, capsys, change, says):
    bad = tmp_path / "bad.h5"
    bad.write_bytes(healthy.read_bytes())
    put(bad, change)
    status = main(["diagnose", str(bad), "--json", str(tmp_path / "o.json"), "--report", str(tmp_path / "o.html")])
    err = capsys.readouterr().err.splitlines()
    assert status == 2 and len(err) == 1 and says in err[0], err
    assert [p.name for p in tmp_path.iterdir()] == ["bad.h5"]


def test_another_device_is_refused(healthy, capsys):
    assert main(["diagnose", str(healthy), "--device", "silica-fast"]) == 2
    assert "of metal-fast, not of silica-fast" in capsys.readouterr().err


def test_lost_samples_are_counted_and_the_rest_is_judged(healthy, tmp_path):
    path = tmp_path / "lost.h5"
    path.write_bytes(healthy.read_bytes())
    put(path, lambda file: file["output/lost"].__setitem__(slice(2000, 2400), 1))
    found = answer(path)
    assert found.verdict in ("no_gap", "insufficient") and any("400 of" in note and "lost" in note for note in found.notes)

"""Scenarios: what ships, profiles against closed forms, refusals as one line."""

import numpy as np
import pytest

from wineglass import device as devices
from wineglass import profiles, scenario
from wineglass.errors import BadInput

SHIPPED = ["cold-start", "paper-fig2", "paper-fig5", "paper-fig5-metal", "rate-steps", "rebalance-steps", "thermal-sweep"]
RAD = np.pi / 180


def parsed(**fields) -> scenario.Scenario:
    return scenario.parse(fields, "case")


def refusal(call) -> str:
    with pytest.raises(BadInput) as caught:
        call()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenarios_prepare_and_read_back(name):
    assert name in scenario.names()
    loaded = scenario.load(name)
    assert loaded.name == name and loaded.description
    scenario.prepare(loaded)
    again = scenario.parse(scenario.toml_text.loads(loaded.to_toml(), "again"), "again")
    assert again == loaded


def test_empty_scenario_is_the_default_device_at_rest():
    run = scenario.prepare(parsed())
    assert run.device == devices.load("metal") and run.n_blocks == 10_000
    rate, slope = run.rate_rad_s(0, 5)
    assert not rate.any() and not slope.any() and (run.temperature_degc(0, 5) == 25).all()


def test_fig5_temperature_is_the_paper_s():
    run = scenario.prepare(scenario.load("paper-fig5"))
    end_s = np.arange(1, run.n_blocks + 1) * 1e-3 - 20e-6  # the last sample of a block; the first one of all is at 0
    assert np.allclose(run.temperature_degc(0, run.n_blocks), 25 + 50 * np.sin(2 * np.pi * end_s), atol=1e-9)
    assert run.scenario.temperature.acts_on == "shell"


def test_fig2_ends_with_its_profile():
    fig2 = scenario.load("paper-fig2")
    degc = fig2.temperature.at(np.linspace(0, fig2.duration_s, 4401))
    assert (degc.max(), degc.min(), degc[-1]) == (60, -40, 20)
    assert fig2.temperature.end_s < fig2.duration_s


def test_rate_sine_and_chirp_slopes_are_derivatives():
    t = np.linspace(0.05, 3.9, 1000)
    h = 1e-6
    sine = profiles.SineRate(amplitude_deg_s=30.0, frequency_hz=2.5, phase_deg=20.0, mean_deg_s=4.0)
    chirp = profiles.ChirpRate(amplitude_deg_s=10.0, start_hz=1.0, end_hz=20.0, duration_s=4.0)
    for profile in (sine, chirp):
        numeric = (profile.at(t + h) - profile.at(t - h)) / (2 * h)
        assert np.allclose(profile.slope_over(t - h, t + h), numeric, rtol=1e-6, atol=1e-6)
    assert np.allclose(sine.at(t), RAD * (4 + 30 * np.sin(2 * np.pi * 2.5 * t + 20 * RAD)))
    assert chirp.at(np.array([-1.0, 4.5])).tolist() == [0, 0]


def test_chirp_counts_its_cycles():
    chirp = profiles.ChirpRate(amplitude_deg_s=1.0, start_hz=2.0, end_hz=8.0, duration_s=10.0, begin_s=1.0)
    t = np.linspace(0, 12, 120_001)
    crossings = np.count_nonzero(np.diff(np.signbit(chirp.at(t[(t > 1.001) & (t < 10.999)]))))
    assert crossings in (98, 99, 100)  # (2 + 8)/2 Hz for 10 s are 50 cycles


@pytest.mark.parametrize("profile", [
    profiles.StepRate(times_s=[1.0, 2.0], values_deg_s=[5.0, -20.0], edge_s=0.0137),
    profiles.TableRate(times_s=[0.3, 1.1111, 2.7], values_deg_s=[1.0, 9.0, -3.0]),
])
def test_angular_acceleration_adds_up_to_the_change_of_rate(profile):
    edges = np.arange(0, 4001) * 1e-3
    slope = profile.slope_over(edges[:-1], edges[1:])
    assert np.sum(slope) * 1e-3 == pytest.approx(float(profile.at(edges[-1:])[0] - profile.at(edges[:1])[0]), abs=1e-12)


def test_steps_stand_at_their_values_between_edges():
    steps = profiles.StepRate(times_s=[1.0, 2.0], values_deg_s=[5.0, -20.0], start_deg_s=1.0, edge_s=0.1)
    at = steps.at(np.array([0.0, 1.0, 1.05, 1.1, 1.9, 2.0, 2.1, 9.0])) / RAD
    assert at == pytest.approx([1, 1, 3, 5, 5, 5, -20, -20])


def test_ramps_by_time_and_by_speed():
    ramps = profiles.RampTemperature(start_degc=20.0, ramps=[
        profiles.Ramp(duration_s=10.0), profiles.Ramp(to_degc=60.0, speed_degc_per_min=30.0), profiles.Ramp(to_degc=0.0, duration_s=5.0)])
    assert ramps.end_s == 95
    assert ramps.at(np.array([0.0, 10.0, 50.0, 90.0, 92.5, 95.0, 1e3])) == pytest.approx([20, 20, 40, 60, 30, 0, 0])


def test_csv_profile(tmp_path):
    (tmp_path / "chamber.csv").write_text("time[min],chamber[K]\n10,293.15\n11,303.15\n13,273.15\n")
    profile = {"kind": "csv", "path": "chamber.csv", "temperature_column": "chamber"}
    loaded = scenario.parse({"temperature": profile}, "case", tmp_path)
    assert loaded.temperature.at(np.array([0.0, 30.0, 60.0, 180.0, 1e4])) == pytest.approx([20, 25, 30, 0, 0])


@pytest.mark.parametrize(("table", "part"), [
    ("time[s],temperature[degC]\n0,20\n0,21\n", "line 3"),
    ("time,temperature[degC]\n0,20\n", "unit of time"),
    ("time[s],temperature[rad/s]\n0,20\n", "unit of temperature"),
    ("time[s],shell[degC]\n0,20\n", "no column 'temperature'"),
    ("time[s],temperature[degC]\n0,nan\n", "nan"),
    ("time[s],temperature[degC]\n0,2000\n", "200 degC"),
])
def test_csv_profile_refusals(tmp_path, table, part):
    (tmp_path / "chamber.csv").write_text(table)
    assert part in refusal(lambda: scenario.parse({"temperature": {"kind": "csv", "path": "chamber.csv"}}, "case", tmp_path))


@pytest.mark.parametrize(("fields", "part"), [
    ({"duration": 5}, "duration_s"),
    ({"duration_s": -5}, "duration_s"),
    ({"duration_s": float("inf")}, "duration_s"),
    ({"seed": -1}, "seed"),
    ({"temperature": {"kind": "sinus"}}, "kind"),
    ({"temperature": {"kind": "sine", "amplitude_degc": 5}}, "period_s"),
    ({"temperature": {"kind": "sine", "amplitude_degc": 5, "period_s": 1, "frequency_hz": 1}}, "frequency_hz"),
    ({"temperature": {"kind": "ramps", "ramps": []}}, "ramps"),
    ({"temperature": {"kind": "ramps", "ramps": [{"to_degc": 5}]}}, "speed_degc_per_min"),
    ({"temperature": {"kind": "ramps", "ramps": [{"speed_degc_per_min": 5}]}}, "duration_s"),
    ({"rate": {"kind": "steps", "times_s": [2, 1], "values_deg_s": [1, 2]}}, "increase"),
    ({"rate": {"kind": "steps", "times_s": [1, 1.01], "values_deg_s": [1, 2]}}, "edge_s"),
    ({"rate": {"kind": "table", "times_s": [1], "values_deg_s": [1, 2]}}, "same length"),
    ({"rate": {"kind": "table", "times_s": [], "values_deg_s": []}}, "at least one"),
    ({"rate": {"value_rad_s": 1}}, "value_rad_s"),
    ({"mode": {"compensation": "G2"}}, "g2"),
    ({"recording": {"bursts": [{"time_s": 1, "samples": 0}]}}, "samples"),
    ({"device": 5}, "device"),
])
def test_refusals_name_the_field(fields, part):
    text = refusal(lambda: parsed(**fields))
    assert text.startswith("case") and part in text, text


@pytest.mark.parametrize(("fields", "part"), [
    ({"recording": {"output_hz": 300}}, "does not divide"),
    ({"recording": {"output_hz": 2000}}, "does not divide"),
    ({"mode": {"output_filter_hz": 30}}, "10, 25, 50, 100"),
    ({"duration_s": 2, "recording": {"bursts": [{"time_s": 2, "samples": 5}]}}, "after the end"),
    ({"device": "brass"}, "brass"),
    ({"override": {"resonator.q": -5}}, "override, resonator.q"),
    ({"plant": {"override": {"resonator.qq": 5}}}, "plant.override, resonator.qq"),
])
def test_refusals_that_need_the_device(fields, part):
    assert part in refusal(lambda: scenario.prepare(parsed(**fields)))


def test_override_changes_description_and_truth_plant_override_truth_only():
    run = scenario.prepare(parsed(override={"resonator.split_hz": 0.005}, plant={"cross_damping": False, "override": {"resonator.q": 11e3}}))
    assert (run.device.resonator.split_hz, run.truth.resonator.split_hz) == (0.005, 0.005)
    assert (run.device.resonator.q, run.truth.resonator.q) == (1e4, 1.1e4)
    assert run.device.resonator.cross_damping_rad_s[0] > 0 and run.truth.resonator.cross_damping_rad_s == [0.0]


def test_settings_from_the_command_line():
    mine, devices_ = scenario.split_settings(["rate.value_deg_s=5", "mode.compensation=none", "resonator.split_hz=0.01"])
    assert mine == {"rate.value_deg_s": 5, "mode.compensation": "none"} and devices_ == {"resonator.split_hz": 0.01}
    assert parsed().changed(mine).mode.compensation == "none"
    assert "nonsense" in refusal(lambda: scenario.split_settings(["nonsense=5"]))
    assert "KEY=VALUE" in refusal(lambda: scenario.split_settings(["seed"]))

"""The twin from Python: it locks, measures rate with the right sign and size, and repeats itself to the last bit."""

import numpy as np
import pytest

from wineglass import paths, scenario
from wineglass.errors import BadInput

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

LOCKED, RATE_VALID = 1 << 0, 1 << 8


def prepared(**fields) -> scenario.Run:
    return scenario.prepare(scenario.parse({"duration_s": 2.0, **fields}, "case"))


def make(run, **options):
    from wineglass.twin import Twin

    return Twin(run, **options)


def test_cold_start_of_the_default_device_locks_on_the_resonance():
    with make(prepared(plant={"override": {"resonator.frequency_hz": 5025.0}}), amplitudes=True) as twin:
        block = twin.step(2000)
        truth, status = twin.truth(), twin.signals()["status"]
    assert status & LOCKED and status & RATE_VALID
    assert truth.oscillator_hz == pytest.approx(truth.resonance_hz, abs=0.02)
    assert np.abs(block.primary[-100:]) == pytest.approx(0.9, rel=0.001)
    assert np.degrees(np.angle(block.primary[-100:])) == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("rate_deg_s", [3.0, -3.0])
def test_measured_rate_has_the_sign_and_size_of_the_true_one(rate_deg_s):
    run = prepared(device="paper", duration_s=10.0, rate={"value_deg_s": rate_deg_s})
    with make(run) as twin:
        twin.step(9990)
        measured = [(twin.step(1), twin.signals()["rate_rad_s_q28"] / 2**28)[1] for _ in range(10)]
    assert np.degrees(np.mean(measured)) == pytest.approx(rate_deg_s, abs=1e-3)


def test_cross_damping_looks_like_a_positive_rate_until_compensated():
    def output(compensation: str) -> float:
        with make(prepared(device="paper", duration_s=8.0, mode={"compensation": compensation, "output_filter_hz": 10.0})) as twin:
            twin.step(8000)
            return twin.signals()["rate_rad_s_q28"] / 2**28

    assert output("none") == pytest.approx(1.0792e-3, abs=5e-6)
    assert output("static") == pytest.approx(0, abs=5e-6)
    assert output("g2") == pytest.approx(0, abs=5e-6)


def test_same_seed_same_bytes_other_seed_other_noise():
    def codes(seed: int) -> np.ndarray:
        with make(prepared(), seed=seed, codes=True) as twin:
            return twin.step(50).codes

    assert np.array_equal(codes(7), codes(7))
    assert not np.array_equal(codes(7), codes(8))
    assert codes(7).shape == (2500, 4)


def test_splitting_a_run_changes_nothing():
    def run(pieces: list[int]) -> tuple[bytes, list[float]]:
        temperature = {"kind": "sine", "amplitude_degc": 10, "period_s": 0.7, "acts_on": "shell"}
        rate = {"kind": "sine", "amplitude_deg_s": 5, "frequency_hz": 3}
        with make(prepared(temperature=temperature, rate=rate)) as twin:
            shell = np.concatenate([twin.step(n).shell_degc for n in pieces])
            return twin.telemetry(), list(shell)

    assert run([600]) == run([1, 7, 192, 400])


def test_chunks_end_with_the_scenario():
    with make(prepared(duration_s=5.5)) as twin:
        lengths = [len(block.shell_degc) for block in twin.chunks()]
        assert sum(lengths) == 5500 == twin.blocks_done and twin.samples_done == 275_000
        assert twin.truth().time_s == pytest.approx(5.5)


def test_imposed_shell_follows_at_once_chamber_does_not():
    temperature = {"kind": "sine", "amplitude_degc": 40, "period_s": 4.0}
    with make(prepared(temperature={**temperature, "acts_on": "shell"})) as twin:
        block = twin.step(1000)
        assert np.allclose(block.shell_degc, block.chamber_degc, atol=1e-9)
        assert block.shell_degc[-1] == pytest.approx(65.0)
    with make(prepared(temperature=temperature)) as twin:
        assert twin.step(1000).shell_degc[-1] == pytest.approx(25 + 40 * 2 / np.pi / 60, rel=0.02)  # 60 s of lag


def test_thermometer_code_carries_lsb_and_offset():
    with make(prepared(temperature={"value_degc": 31.0004})) as twin:
        block = twin.step(200)
    steps = block.thermometer_degc * 128
    assert np.allclose(steps, np.round(steps))
    assert block.thermometer_degc.mean() == pytest.approx(31.0, abs=0.01)


def test_firmware_default_calibration_runs_and_says_that_it_is_none():
    with make(prepared(calibration="none")) as twin:
        twin.step(1500)
        assert not twin.signals()["status"] & (1 << 5)


def test_wrong_calibration_is_refused_with_the_firmware_s_reason():
    from wineglass.twin import calibration_for
    from wineglass.calibration_block import to_binary

    run = prepared()
    block = bytearray(to_binary(calibration_for(run)))
    block[40] ^= 1
    with pytest.raises(BadInput, match="refuses the calibration"):
        make(run, calibration_block=bytes(block))


def test_calibration_from_a_file_takes_the_scenario_s_mode(tmp_path):
    from wineglass.calibration_block import to_json
    from wineglass.twin import calibration_for

    path = tmp_path / "unit.json"
    path.write_text(to_json(calibration_for(prepared()).with_changes(bias_rad_s=[2e-3])))
    taken = calibration_for(prepared(calibration=str(path), mode={"compensation": "static"}))
    assert (taken.bias_rad_s, taken.compensation) == ([2e-3], "static")
    with pytest.raises(BadInput, match="missing.json"):
        calibration_for(prepared(calibration=str(tmp_path / "missing.json")))


def test_a_shell_that_cannot_be_is_refused():
    run = prepared(temperature={"kind": "constant", "value_degc": 190.0}, override={"resonator.q_slope_per_degc": -0.008})
    with pytest.raises(BadInput), make(run) as twin:
        twin.step(10)


def test_a_closed_twin_says_so():
    twin = make(prepared())
    twin.close()
    twin.close()
    with pytest.raises(ValueError, match="closed"):
        twin.step(1)

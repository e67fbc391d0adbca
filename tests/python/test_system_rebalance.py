"""Force-to-rebalance on the digital twin, as a specification in physical units. The numbers stand in docs/NUMBERS.md. Device `metal`.

"Quiet" switches noise and quantisers of the converters off, so that short runs show what is systematic."""

from dataclasses import replace

import numpy as np
import pytest

from wineglass import nominal, paths, phases, rebalance, scenario
from wineglass.calibration_block import from_binary, to_binary
from wineglass.commands_wire import CommandEncoder, Reason
from wineglass.phases_order import order_for
from wineglass.telemetry import Decoder
from wineglass.wire import Status

pytestmark = pytest.mark.skipif(not (paths.build_folder() / "lib").is_dir(), reason="the C library is not built")

DEG_H = 3600 * 180 / np.pi
DEG_S = 180 / np.pi
QUIET = {"electronics.adc.bits": 32, "electronics.adc.snr_db": 0.0, "electronics.dac.bits": 32}
NO_BIAS = {"resonator.cross_damping_rad_s": [0.0]}
LATE_SAMPLES = 34  # middle of a block -> mean rate read at its end, beyond the loop's own answer: docs/SPEC.md, latency


class Bench:
    """A twin in force-to-rebalance on a rate table and in a chamber, read once per slow tick."""

    def __init__(self, override=None, *, device="metal", loop="rebalance", compensation="static", truth=None, degc=25.0, settle_s=2.5,
                 calibration=None, **changes):
        from wineglass.twin import Twin

        fields = {"device": device, "mode": {"loop": loop, "compensation": compensation, "output_filter_hz": 0.0},
                  "temperature": {"acts_on": "shell", "value_degc": degc}}
        dotted = {"override": override or {}, "plant.override": truth or {}}
        self.run = scenario.prepare(scenario.parse(fields, "case").changed(dotted))
        self.calibration = (calibration or nominal.calibration(self.run)).with_changes(loop=loop, **changes)
        self.twin = Twin(self.run, calibration_block=to_binary(self.calibration))
        self.encoder = CommandEncoder()
        self.rate_before = 0.0
        self.turn(0.0, settle_s)

    def turn(self, rate_rad_s, seconds):
        """The rate table's rate from now on."""
        self.listen(np.full(round(1000 * seconds), rate_rad_s), every=False)

    def listen(self, rate_rad_s, every=True):
        """One rate per slow tick; dict of what the firmware publishes then, (n,) float64 each; status int."""
        before = np.concatenate([[self.rate_before], rate_rad_s[:-1]])
        slope, degc = (rate_rad_s - before) * 1000.0, np.full(len(rate_rad_s), self.run.initial_degc)
        self.rate_before = rate_rad_s[-1] if len(rate_rad_s) else self.rate_before
        if not every:
            self.twin.step_with(rate_rad_s, slope * 0.0, degc)
            return {}
        found = []
        for i in range(len(rate_rad_s)):
            self.twin.step_with(rate_rad_s[i:i + 1], slope[i:i + 1], degc[i:i + 1])
            found.append(self.twin.signals())
        scales = {"rate_rad_s_q28": 2.0**-28, "quadrature_rad_s_q28": 2.0**-28, "rebalance_in_phase_q31": 2.0**-31,
                  "rebalance_quadrature_q31": 2.0**-31, "secondary_i_q30": 2.0**-30, "secondary_q_q30": 2.0**-30}
        heard = {name.rsplit("_q", 1)[0]: np.array([item[name] for item in found]) * scale for name, scale in scales.items()}
        return heard | {"status": np.array([item["status"] for item in found])}

    def mean(self, rate_rad_s=0.0, seconds=1.0, what="rate_rad_s"):
        return float(np.mean(self.listen(np.full(round(1000 * seconds), rate_rad_s))[what]))

    def command(self, data):
        self.twin.command(data)
        self.twin.poll()

    def calibrate_phases(self, **changes):
        return phases.calibrate(self.twin, order_for(self.run.device, apply=True, **changes), self.encoder)


# ---- response ------------------------------------------------------------------------------------------------------------


def response(bench, frequencies_hz, amplitude_rad_s=0.35):
    """Delivered rate over true rate at the middle of each slow tick, complex (n,)."""
    t = np.arange(1000) / 1000.0
    gains = []
    for frequency in frequencies_hz:
        rate = amplitude_rad_s * np.sin(2 * np.pi * frequency * t)
        bench.listen(rate[:200])
        heard = bench.listen(amplitude_rad_s * np.sin(2 * np.pi * frequency * (t + 0.2)))["rate_rad_s"]
        line = np.exp(-2j * np.pi * frequency * t)
        gains.append(np.sum(heard * line) / np.sum(amplitude_rad_s * np.sin(2 * np.pi * frequency * (t + 0.2)) * line))
    return np.array(gains)


def test_rate_bandwidth_is_100_hz_and_phase_margin_60_degrees():
    bench = Bench(QUIET | NO_BIAS)
    assert bench.run.device.resonator.q == 1e4
    frequency = np.array([1.0, 20.0, 50.0, 80.0, 100.0, 110.0, 120.0, 130.0])
    gain = response(bench, frequency)
    assert abs(gain[0]) == pytest.approx(1.0, abs=1e-3)
    bandwidth_hz = np.interp(-np.sqrt(0.5), -np.abs(gain), frequency)
    assert bandwidth_hz >= 100.0
    # The loop itself: without the mean over a slow tick and the way to the reader; then L = T / (1 - T).
    angle = np.pi * frequency / bench.calibration.loop_rate_hz
    mean = np.sin(5 * angle) / (5 * np.sin(angle))
    closed = gain / mean * np.exp(2j * np.pi * frequency * LATE_SAMPLES / 50e3)
    loop = closed / (1.0 - closed)
    crossover = np.interp(0.0, -np.log(np.abs(loop)), frequency)
    margin = 180.0 + np.degrees(np.interp(crossover, frequency, np.unwrap(np.angle(loop))))
    assert margin >= 60.0
    designed = rebalance.margins(rebalance.loop_of(bench.calibration))
    assert crossover == pytest.approx(designed.crossover_hz, rel=0.03) and margin == pytest.approx(designed.phase_deg, abs=3.0)


@pytest.mark.parametrize("step_deg_s", [1.0, 100.0, -200.0])
def test_rate_step_overshoots_by_less_than_15_percent(step_deg_s):
    bench = Bench(QUIET | NO_BIAS)
    heard = bench.listen(np.full(150, step_deg_s / DEG_S))["rate_rad_s"] * DEG_S / step_deg_s
    assert heard.max() <= 1.15
    assert np.all(np.abs(heard[20:] - 1.0) < 1e-3)  # and it is there within 20 ms


# ---- range and scale -----------------------------------------------------------------------------------------------------


def test_range_of_200_deg_s_without_saturation_and_20_ppm_of_nonlinearity():
    bench = Bench(QUIET | NO_BIAS)
    rates = np.array([-200.0, -140.0, -80.0, -20.0, 20.0, 80.0, 140.0, 200.0])
    measured = []
    for rate in rates:
        bench.turn(rate / DEG_S, 0.3)
        heard = bench.listen(np.full(300, rate / DEG_S))
        assert np.all(heard["status"] & Status.RATE_VALID) and not np.any(heard["status"] & Status.REBALANCE_SATURATED)
        measured.append(heard["rate_rad_s"].mean() * DEG_S)
    residual = measured - np.polyval(np.polyfit(rates, measured, 1), rates)
    assert np.max(np.abs(residual)) / 200.0 <= 20e-6
    assert np.polyfit(rates, measured, 1)[0] == pytest.approx(1.0, abs=1e-4)


def test_scale_factor_holds_over_temperature_10_times_better_than_open_loop_without_its_polynomial():
    def scale(degc, loop, **changes):
        bench = Bench(QUIET | NO_BIAS, loop=loop, degc=degc, settle_s=2.5 if loop == "rebalance" else 9.0, **changes)
        zero = bench.mean(0.0, 0.1)
        bench.turn(5 / DEG_S, 5.0 if loop == "rebalance" else 7.0)  # where 1/tau(T) is not Ki/Kp, 3e-4 of a step comes with tau
        return (bench.mean(5 / DEG_S, 0.1) - zero) * DEG_S / 5

    nominal_open = Bench(QUIET | NO_BIAS, loop="open", settle_s=0.01).calibration
    constant = {"scale_rad_s_per_ratio": nominal_open.scale_rad_s_per_ratio[:1]}
    constant_force = {"rebalance_scale_rad_s_per_ratio": nominal_open.rebalance_scale_rad_s_per_ratio[:1]}
    temperatures = (-40.0, 85.0)
    open_loop = np.ptp([scale(t, "open", **constant) for t in temperatures])
    closed = np.ptp([scale(t, "rebalance", **constant_force) for t in temperatures])
    corrected = np.ptp([scale(t, "rebalance") for t in temperatures])
    assert open_loop > 0.2  # it follows Q(T)
    assert closed * 10 <= open_loop  # it follows 1/f(T) only, ...
    assert corrected < 5e-5  # ... which the polynomial takes out


# ---- converters ----------------------------------------------------------------------------------------------------------

AT_A_TENTH = QUIET | NO_BIAS | {"resonator.split_hz": 0.0, "resonator.quadrature_rad_s": 0.01}  # drive at fs/10: rounding repeats


def test_rounding_to_16_bits_leaves_no_bias():
    rates = np.linspace(0.0, 0.05, 9) / DEG_S

    def measured(bits):
        bench = Bench(AT_A_TENTH | {"electronics.dac.bits": bits})
        assert bench.twin.truth().oscillator_hz == pytest.approx(5000.0, abs=1e-3)
        found = []
        for rate in rates:
            bench.turn(rate, 0.3)
            heard = bench.listen(np.full(300, rate))
            found.append((heard["rate_rad_s"].mean(), heard["rebalance_in_phase"].mean(), heard["rebalance_quadrature"].mean()))
        return np.array(found)

    shaped, exact = measured(16), measured(32)
    assert np.max(np.abs(shaped[:, 0] - exact[:, 0])) * DEG_H <= 0.1
    assert 5.0 < worst_of_plain_rounding(exact[:, 1] + 1j * exact[:, 2]) * DEG_H < 15.0  # what the shaping is for


def worst_of_plain_rounding(forces):
    """Largest bias [rad/s] of these forces [FS] rounded to the nearest 16-bit code, over all phases against the sample clock."""
    full_rad_s = 2.6 * 2 * np.pi * 5000 / 1e4 * np.sinc(0.1) / 2  # rate per full force: F / (g w)
    phase = 2 * np.pi * (np.arange(10) / 10 + np.linspace(0, 0.1, 200)[:, None])
    worst = 0.0
    for force in forces:
        wanted = np.real(force * np.exp(1j * phase))
        error = np.round(wanted * 2**15) / 2**15 - wanted
        worst = max(worst, np.max(np.abs(np.real(2 * np.mean(error * np.exp(-1j * phase), axis=1)))))
    return worst * full_rad_s


def test_quadrature_is_nulled():
    bench = Bench(NO_BIAS | {"resonator.quadrature_rad_s": 0.05}, settle_s=3.0)
    heard = bench.listen(np.zeros(1000))
    assert heard["quadrature_rad_s"].mean() * DEG_S > 1.0  # there is some, and the force says how much
    per_rad_s = 0.9 * bench.run.device.resonator.angular_gain / (2 * 1.5708)  # open loop: amplitude a rate of 1 rad/s would make
    left_rad_s = heard["secondary_q"].mean() / per_rad_s
    assert abs(left_rad_s) * DEG_S <= 0.01


# ---- limits and modes ----------------------------------------------------------------------------------------------------


def test_a_rate_beyond_the_range_is_flagged_and_leaves_no_tail():
    bench = Bench(QUIET | NO_BIAS)
    bench.turn(300 / DEG_S, 0.5)
    beyond = bench.listen(np.full(200, 300 / DEG_S))
    assert np.all(beyond["status"] & Status.REBALANCE_SATURATED) and not np.any(beyond["status"] & Status.RATE_VALID)
    back = bench.listen(np.full(1000, 50 / DEG_S))
    error = np.abs(back["rate_rad_s"] * DEG_S - 50.0)
    assert error[200:].max() < 0.05 * 250  # the secondary that ran away has been caught
    assert error[400:].max() < 0.01
    valid = (back["status"] & Status.RATE_VALID) != 0
    assert error[valid].max() < 0.01
    assert np.all(valid[600:])


def test_cold_start_ends_in_rebalance():
    bench = Bench(settle_s=0.0)
    heard = bench.listen(np.full(2000, 10 / DEG_S))
    valid = (heard["status"] & Status.RATE_VALID) != 0
    assert np.all(valid[1500:]) and np.all((heard["status"][1500:] & Status.REBALANCE_ACTIVE) != 0)
    assert heard["rate_rad_s"][-300:].mean() * DEG_S == pytest.approx(10.0, abs=0.02)
    assert np.max(np.abs(heard["rate_rad_s"][valid])) * DEG_S < 12.0  # never valid while it swings


def test_loops_open_and_close_while_it_runs():
    bench = Bench(QUIET | NO_BIAS | {"resonator.split_hz": 0.0})
    bench.turn(3 / DEG_S, 0.3)
    assert bench.mean(3 / DEG_S, 0.2) * DEG_S == pytest.approx(3.0, rel=1e-4)
    bench.command(bench.encoder.loop("open"))
    bench.turn(3 / DEG_S, 8.0)
    assert bench.mean(3 / DEG_S, 0.2) * DEG_S == pytest.approx(3.0, rel=1e-4)
    bench.command(bench.encoder.loop("rebalance"))
    bench.turn(3 / DEG_S, 0.3)
    assert bench.mean(3 / DEG_S, 0.2) * DEG_S == pytest.approx(3.0, rel=1e-4)


def test_silica_which_cannot_be_used_open_loop_measures_rate():
    bench = Bench(NO_BIAS, device="silica", settle_s=45.0)
    zero = bench.mean(0.0, 2.0)
    bench.turn(1 / DEG_S, 0.5)
    heard = bench.listen(np.full(2000, 1 / DEG_S))
    assert np.all(heard["status"] & Status.RATE_VALID)
    assert (heard["rate_rad_s"].mean() - zero) * DEG_S == pytest.approx(1.0, abs=0.01)


def test_a_test_force_weighs_the_scale_factor():
    """Self-test without a rate table: the loop answers a known force with its opposite."""
    bench = Bench()
    bench.command(bench.encoder.test_signal(0.1, 0.05, 0.0, 5e3))
    bench.turn(0.0, 0.2)
    on = bench.listen(np.zeros(500))
    bench.command(bench.encoder.test_signal(0.0, 0.0, 0.0, 5e3))
    bench.turn(0.0, 0.2)
    off = bench.listen(np.zeros(500))
    assert np.all(on["status"] & Status.TEST_ACTIVE) and not np.any(on["status"] & Status.RATE_VALID)
    assert off["rebalance_in_phase"].mean() - on["rebalance_in_phase"].mean() == pytest.approx(0.1, abs=2e-4)
    assert off["rebalance_quadrature"].mean() - on["rebalance_quadrature"].mean() == pytest.approx(0.05, abs=2e-4)


# ---- outputs -------------------------------------------------------------------------------------------------------------


def test_angle_survives_lost_frames_and_counts_with_the_sample_counter():
    bench = Bench(QUIET | NO_BIAS)
    decoder = Decoder()
    bench.command(bench.encoder.divisors(0, 7))
    bench.turn(20 / DEG_S, 0.3)
    decoder.feed(bench.twin.telemetry())
    bench.turn(20 / DEG_S, 2.0)
    frames = decoder.feed(bench.twin.telemetry()).output
    few = frames[::23]  # as if the link had lost all others
    elapsed_s = np.diff(few["sample_counter"].astype(np.int64)) / 50e3
    turned = np.diff(few["angle"].view(np.int64)) * 2.0**-28 * 1e-3
    assert turned * DEG_S == pytest.approx(20.0 * elapsed_s, rel=1e-5)


def test_latency_is_the_documented_one():
    """docs/SPEC.md, latency: 70 samples from rate to force, 20 to the middle of the mean; the output read at a block's end belongs to the loop
    ticks up to 49 samples before, the rate to the block's middle."""
    bench = Bench(QUIET | NO_BIAS)
    crossover = 2 * np.pi * rebalance.margins(rebalance.loop_of(bench.calibration)).crossover_hz
    delay_samples = -np.angle(response(bench, [2.0])[0]) / (2 * np.pi * 2.0) * 50e3
    assert delay_samples == pytest.approx(50e3 / crossover - 10 + 20 + 49 - 25, abs=1.0)


@pytest.mark.parametrize(("choice", "ticks"), [(1, 33.6), (2, 13.4), (3, 6.7), (4, 3.3)])
def test_output_filter_delays_are_the_documented_ones(choice, ticks):
    from wineglass.native import library, pointer

    step, answer = np.full(2000, 2**28, np.int32), np.empty(2000, np.int32)
    library().wg_output_filter_run(choice, 0, pointer(step, "int32_t"), pointer(answer, "int32_t"), len(step))
    assert np.sum(1.0 - answer / 2**28) == pytest.approx(ticks, abs=0.1)


def test_sync_pulses_are_stamped_with_sample_and_fraction():
    bench = Bench(settle_s=0.1)
    bench.twin.telemetry()
    decoder = Decoder()
    stamps = []
    for pulse, fraction in enumerate((0.0, 0.25, 0.999)):
        bench.turn(0.0, 0.010)
        bench.twin.sync(fraction)
        stamps.append((bench.twin.samples_done, fraction, pulse + 1))
    bench.turn(0.0, 0.010)
    found = [(int(f["sample_counter"]), f["since_sample_q16"] / 65536, int(f["number"])) for f in decoder.feed(bench.twin.telemetry()).sync]
    assert [(a, n) for a, _, n in found] == [(a, n) for a, _, n in stamps]
    assert [f for _, f, _ in found] == pytest.approx([f for _, f, _ in stamps], abs=1 / 65536)


# ---- phase self-calibration ----------------------------------------------------------------------------------------------

SPLIT = {"resonator.split_hz": 0.1}
ERROR_RAD = 0.01


def test_drive_phase_calibration_in_rebalance():
    """10 mrad of actuation lag that the calibration does not know; the bias that the quadrature of 0.1 Hz of split makes of it."""
    def bias(**changes):
        bench = Bench(SPLIT | NO_BIAS, **changes)
        before = bench.mean(0.0, 1.5)
        result = bench.calibrate_phases(demodulation=False)
        assert result.outcome is phases.Outcome.DONE
        bench.turn(0.0, 0.3)
        return before, bench.mean(0.0, 1.5), result

    before, after, result = bias(drive_phase_rad=[-ERROR_RAD])
    assert abs(before) * DEG_H > 300
    assert result.drive.correction_rad == pytest.approx(ERROR_RAD, abs=1e-4)
    assert result.drive.uncertainty_rad < 1e-4
    assert abs(after) * 20 <= abs(before)


def test_demodulation_phase_calibration_open_loop():
    """10 mrad of delay in the secondary's channel; the bias that it makes of 0.1 Hz of split."""
    delay = ERROR_RAD / (2 * np.pi * 0.1)

    def bias(truth):
        bench = Bench(SPLIT | NO_BIAS, loop="open", truth=truth, settle_s=8.0)
        before = bench.mean(0.0, 1.0)
        result = bench.calibrate_phases()
        assert result.outcome is phases.Outcome.DONE
        return before, bench.mean(0.0, 1.0), result

    before, after, late = bias({"electronics.adc.secondary_delay_samples": delay})
    healthy_before, healthy_after, healthy = bias({})
    assert late.demodulation.correction_rad - healthy.demodulation.correction_rad == pytest.approx(ERROR_RAD, abs=1e-4)
    assert abs(before - healthy_before) * DEG_H > 100  # what the delay alone makes
    assert abs(after - healthy_after) * 20 <= abs(before - healthy_before)
    assert abs(after) * 20 <= abs(before)  # the split's own turning of the phase goes with it


def test_rate_is_invalid_while_phases_are_calibrated_and_everything_comes_back():
    bench = Bench()
    bench.command(bench.encoder.phase_calibration(order_for(bench.run.device, demodulation=False, settle_drive_s=0.5, measure_s=0.2), 1000.0))
    bench.turn(0.0, 0.05)
    during = bench.listen(np.zeros(2500))
    assert not np.any(during["status"] & Status.RATE_VALID)
    bench.turn(0.0, 2.0)
    after = bench.listen(np.full(300, 0.0))
    assert np.all(after["status"] & Status.RATE_VALID) and not np.any(after["status"] & Status.TEST_ACTIVE)
    assert np.all(after["status"] & Status.REBALANCE_ACTIVE)


def test_found_phases_are_stored_once():
    bench = Bench(drive_phase_rad=[-ERROR_RAD])
    decoder = Decoder()

    def reasons(*data):
        bench.command(b"".join(data))
        frames = decoder.feed(bench.twin.telemetry())
        return [Reason(int(ack["reason"])) for ack in frames.ack], frames

    encoder = bench.encoder
    decoder.feed(bench.twin.telemetry())
    unlock = encoder.calibration_unlock(1)
    assert reasons(encoder.phases_store())[0] == [Reason.LOCKED]
    assert reasons(unlock, encoder.phases_store())[0] == [Reason.OK, Reason.NO_RESULT]
    result = bench.calibrate_phases(demodulation=False, measure_s=0.5)
    stored, frames = reasons(encoder.calibration_unlock(1), encoder.phases_store(), encoder.calibration_read())
    assert stored == [Reason.OK] * 3
    found = from_binary(frames.calibration[-1].data)
    assert found.drive_phase_rad[0] == pytest.approx(-ERROR_RAD + result.drive.correction_rad, abs=1e-9)
    assert found.sequence == bench.calibration.sequence + 1
    before = from_binary(to_binary(bench.calibration))
    assert found.with_changes(drive_phase_rad=before.drive_phase_rad, sequence=before.sequence) == before
    assert reasons(encoder.calibration_unlock(1), encoder.phases_store())[0] == [Reason.OK, Reason.NO_RESULT]


def test_only_a_locked_device_calibrates_its_phases_and_then_does_nothing_else():
    bench = Bench(settle_s=0.1)
    decoder = Decoder()

    def reason(data):
        bench.command(data)
        return [Reason(int(ack["reason"])) for ack in decoder.feed(bench.twin.telemetry()).ack]

    order = order_for(bench.run.device, demodulation=False)
    assert reason(bench.encoder.phase_calibration(order, 1000.0)) == [Reason.NOT_LOCKED]
    bench.turn(0.0, 2.0)
    assert reason(bench.encoder.phase_calibration(replace(order, phase_rad=0.5), 1000.0)) == [Reason.OUT_OF_RANGE]
    assert reason(bench.encoder.phase_calibration(replace(order, measure_s=200.0), 1000.0)) == [Reason.OUT_OF_RANGE]
    assert reason(bench.encoder.phase_calibration(order, 1000.0)) == [Reason.OK]
    for command in (bench.encoder.phase_calibration(order, 1000.0), bench.encoder.loop("open"), bench.encoder.raw_burst(10)):
        assert reason(command) == [Reason.BUSY]
    assert reason(bench.encoder.phase_calibration_abort()) == [Reason.OK]
    bench.turn(0.0, 1.0)
    assert bench.listen(np.zeros(1))["status"][0] & Status.RATE_VALID


def test_gains_without_margin_are_refused_while_it_runs():
    bench = Bench()
    decoder = Decoder()
    loop = rebalance.loop_of(bench.calibration)
    fastest = 0.7 / loop.delay_s / loop.growth_per_s

    def reason(kp, ki):
        bench.command(bench.encoder.rebalance(kp, ki, 5e3, 0.9, 0.43))
        return [Reason(int(ack["reason"])) for ack in decoder.feed(bench.twin.telemetry()).ack]

    assert reason(1.01 * fastest, 0.0) == [Reason.UNSTABLE]
    assert reason(0.5 * fastest, 0.5 * fastest * 300) == [Reason.UNSTABLE]
    assert reason(0.99 * fastest, 0.99 * fastest * loop.decay_per_s) == [Reason.OK]
    bench.turn(0.0, 0.5)
    heard = bench.listen(np.zeros(300))
    assert np.all(heard["status"] & Status.RATE_VALID) and np.abs(heard["rebalance_in_phase"]).max() < 0.1


def test_replay_is_bit_identical_in_rebalance():
    from wineglass.native import ffi, library, pointer
    from wineglass.twin import Twin

    run = scenario.prepare(scenario.parse({"mode": {"loop": "rebalance"}, "rate": {"kind": "sine", "amplitude_deg_s": 50, "frequency_hz": 7},
                                           "override": {"electronics.thermometer.noise_degc": 0.0}}, "case"))
    with Twin(run, codes=True) as twin:
        twin.step(1500)
        twin.command(CommandEncoder().test_signal(0.01, 0.02, 30.0, 5e3))
        twin.step(50)
        size = library().wg_device_snapshot_size()
        snapshot = ffi.new("uint8_t[]", size)
        assert library().wg_device_snapshot(twin._open_device(), snapshot, size) == size
        block = twin.step(100)
    cfg = ffi.new("struct wg_device_cfg *", {"sample_rate_millihz": 50_000_000, "adc_bits": 16, "dac_bits": 16, "serial": 5})
    device = library().wg_device_create(cfg, ffi.NULL, 0)
    assert library().wg_device_restore(device, snapshot, size) == 0
    library().wg_device_set_thermometer(device, round(block.thermometer_degc[0] * 128))
    adc = np.ascontiguousarray(block.codes[:, :2])
    dac = np.empty_like(adc)
    library().wg_device_run(device, len(adc), pointer(adc, "int32_t"), pointer(dac, "int32_t"))
    library().wg_device_destroy(device)
    assert np.array_equal(dac, block.codes[:, 2:])
    assert np.ptp(dac[:, 1]) > 1000


def test_phases_over_temperature_become_polynomials():
    """Forces that lag by 4 mrad and 50 urad/degC more: the fit through calibrations at three temperatures finds both."""
    lag = np.array([4e-3, 5e-5])
    results = []
    for degc in (-20.0, 25.0, 70.0):
        bench = Bench(degc=degc, drive_phase_rad=[float(-lag[0] - lag[1] * (degc - 25.0))])
        result = bench.calibrate_phases(demodulation=False, measure_s=0.5)
        assert result.temperature_shift_degc == pytest.approx(degc - 25.0, abs=0.02)
        results.append(result)
    found = phases.with_phases(bench.calibration.with_changes(drive_phase_rad=[0.0]), results, 1)
    assert len(found.drive_phase_rad) == 2 and found.sequence == bench.calibration.sequence + 1
    at = np.array([-45.0, 0.0, 45.0])
    assert np.polynomial.polynomial.polyval(at, found.drive_phase_rad) == pytest.approx(0 * at, abs=2e-4)  # what the plant really lags by
    corrections = [result.drive.correction_rad for result in results]
    assert corrections == pytest.approx(list(np.polynomial.polynomial.polyval(at, lag)), abs=2e-4)

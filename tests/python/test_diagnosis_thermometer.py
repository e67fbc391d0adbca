"""Where the bench recorded the shell's temperature, the thermometer is judged against it, and the bias is one over the shell's temperature."""

import os
from dataclasses import replace

import diagnosis_synthetic as synthetic
import numpy as np
import pytest

from wineglass.diagnosis.rate_level import analyse
from wineglass.diagnosis.verdict import diagnose

SEED = int(os.environ.get("WINEGLASS_SEED", "0"))


def late(time_s, degc, lag_s):
    """By Euler steps of a tenth of a sample."""
    out, state = np.empty(len(degc)), degc[0]
    for i, now in enumerate(degc):
        out[i] = state
        for _ in range(10):
            state += (now - state) * (time_s[1] - time_s[0]) / 10.0 / lag_s
    return out


def with_thermometer(measure, signals=(), seed=1):
    made = synthetic.make(list(signals), SEED + seed, synthetic.two_cycles)
    time_s, shell = synthetic.two_cycles()
    rng = np.random.default_rng(SEED + seed + 1000)
    return replace(made, temperature_degc=shell, measured_degc=measure(time_s, shell) + 0.01 * rng.standard_normal(len(shell)))


def answer(evidence):
    print(evidence.source)
    return diagnose(evidence, analyse(evidence))


def test_a_good_thermometer_is_no_gap():
    found = answer(with_thermometer(lambda t, shell: shell + 0.05))
    assert found.verdict == "no_gap" and not found.effects


def test_a_lag_shows_directly_and_the_bias_does_not_matter():
    found = answer(with_thermometer(lambda t, shell: late(t, shell, 40.0)))
    assert found.verdict == "attributed" and [e.id for e in found.effects] == ["thermometer_lag"]
    lag = found.effects[0].parameters[0]
    assert lag.name == "lag_s" and lag.interval[0] <= 40.0 <= lag.interval[1] and lag.value == pytest.approx(40.0, rel=0.15)
    assert found.where[0].stage == "temperature" and found.where[0].channel == "temperature_measured"


def test_offset_and_gain():
    found = answer(with_thermometer(lambda t, shell: 25.0 + 1.02 * (shell - 25.0) + 0.8))
    assert [e.id for e in found.effects] == ["thermometer_error"]
    gain = next(p for p in found.effects[0].parameters if p.name == "gain")
    assert gain.interval[0] - 1e-3 <= 0.02 <= gain.interval[1] + 1e-3


def test_beside_what_the_rate_shows():
    found = answer(with_thermometer(lambda t, shell: late(t, shell, 60.0), [synthetic.drift(8e-3)], seed=3))
    assert {e.id for e in found.effects} == {"thermometer_lag", "ageing"} and found.verdict == "attributed"
    assert {w.stage for w in found.where} == {"temperature", "coupling"}
    assert [c.channel for c in found.shrink.channels] == ["rate", "temperature_measured"]

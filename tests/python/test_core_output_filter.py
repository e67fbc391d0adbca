"""Output filters against scipy: corner, delay and gain at rest of the words in use, and the firmware's output. Table in docs/NUMBERS.md."""

import re

import numpy as np
import pytest
from scipy import signal

from core_library import ROOT, library, pointer

SLOW_RATE_HZ = 1000.0
CORNERS = {1: 0.01, 2: 0.025, 3: 0.05, 4: 0.1}
DELAY_TICKS = {1: 33.633, 2: 13.430, 3: 6.673, 4: 3.253}


def words() -> np.ndarray:
    """Table (choice, section, [gain, a1, a2]) as the firmware holds it, in Q29."""
    text = (ROOT / "firmware/core/output_filter_table.c").read_text(encoding="utf-8")
    rows = re.findall(r"\{(-?\d+), (-?\d+), (-?\d+)\}", text)
    return np.array(rows, dtype=np.int64).reshape(-1, 2, 3)


def sections(choice: int) -> np.ndarray:
    """scipy second-order sections of the exact words."""
    rows = []
    for gain, a1, a2 in words()[choice] / 2**29:
        rows.append([gain, 2 * gain, gain, 1.0, a1, a2])
    return np.array(rows)


@pytest.mark.parametrize("choice", CORNERS)
def test_gain_at_rest_is_exactly_one(choice):
    for gain, a1, a2 in words()[choice]:
        assert 4 * gain == 2**29 + a1 + a2


@pytest.mark.parametrize("choice", CORNERS)
def test_corner_and_delay(choice):
    _, at_corner = signal.sosfreqz(sections(choice), [CORNERS[choice]], fs=1.0)
    # Group delay at rest of (1 + 1/z)^2 / (1 + a1/z + a2/z^2), by hand.
    delay = sum(1 - (a1 + 2 * a2) / (1 + a1 + a2) for _, _, _, _, a1, a2 in sections(choice))
    print(f"{CORNERS[choice]}: {20 * np.log10(abs(at_corner[0])):.4f} dB, delay at rest {delay:.3f} ticks "
          f"= {delay / SLOW_RATE_HZ * 1e3:.2f} ms at 1 kHz")
    assert 20 * np.log10(abs(at_corner[0])) == pytest.approx(-3.0103, abs=1e-3)
    assert delay == pytest.approx(DELAY_TICKS[choice], abs=1e-3)


@pytest.mark.parametrize("choice", CORNERS)
def test_is_the_bessel_filter_it_claims_to_be(choice):
    reference = signal.bessel(4, CORNERS[choice], fs=1.0, output="sos", norm="mag")
    at = np.linspace(0, 0.49, 500)
    _, wanted = signal.sosfreqz(reference, at, fs=1.0)
    _, measured = signal.sosfreqz(sections(choice), at, fs=1.0)
    assert np.abs(measured - wanted).max() < 2e-5


@pytest.mark.parametrize("choice", CORNERS)
def test_firmware_output_is_that_of_scipy(choice):
    values = (np.random.default_rng(choice).standard_normal(50_000) * 2**26).astype(np.int32)
    out = np.zeros(len(values), np.int32)
    library().core_output_filter(choice, pointer(values, "int32_t"), len(values), pointer(out, "int32_t"))
    assert np.abs(out - signal.sosfilt(sections(choice), values.astype(np.float64))).max() <= 0.6


def test_the_table_is_what_its_generator_writes(tmp_path):
    import subprocess
    import sys

    for name in ("output_filter_table", "oscillator_table"):
        made = subprocess.run([sys.executable, ROOT / f"tools/tables/{name}.py"], check=True, capture_output=True, text=True).stdout
        assert made == (ROOT / f"firmware/core/{name}.c").read_text(encoding="utf-8")

"""The report in a real browser: it opens offline, shows its figures, throws nothing. And of several channels, whichever engine found them."""

import re
import shutil
import subprocess
from dataclasses import replace

import diagnosis_synthetic as synthetic
import numpy as np
import pytest

from wineglass.diagnosis.rate_level import analyse
from wineglass.diagnosis.verdict import diagnose
from wineglass.report.page import _percent, render
from wineglass.report.view import Alikeness, Channel, View, of_rate_level

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
         "--hide-scrollbars", "--window-size=1000,3000"]


@pytest.fixture(scope="module")
def view() -> View:
    evidence = synthetic.make([synthetic.lag(8e-3), synthetic.drift(8e-3)], 31)
    found = analyse(evidence)
    return of_rate_level(evidence, found, diagnose(evidence, found))


@pytest.fixture(scope="module")
def wide(view) -> View:
    """The same diagnosis with three channels, a rate, amplitude steps, and two explanations to be told apart."""
    rng = np.random.default_rng(3)
    n = len(view.time_s)
    quiet = Channel("drive_level", "FS", 1e-5 * rng.standard_normal(n), 1e-5 * rng.standard_normal(n), 1e-5)
    line = Channel("drive_frequency", "Hz", 1e-3 + 1e-5 * rng.standard_normal(n), np.where(np.arange(n) % 7, 1e-5, np.nan), 1e-5)
    first = view.diagnosis.shrink.channels[0]
    both = view.diagnosis.shrink.model_copy(update={"channels": [first, first.model_copy(update={"channel": "drive_frequency", "unit": "Hz", "before": 1e-3}),
                                                                 first.model_copy(update={"channel": "drive_level", "unit": "FS", "fraction": None, "interval": None})]})
    return replace(view, diagnosis=view.diagnosis.model_copy(update={"shrink": both}), channels=[*view.channels, quiet, line], rate_deg_s=10.0 * np.sin(view.time_s / 99),
                   amplitude_fs=np.where(view.time_s > 2000, 0.6, 0.9), alike=Alikeness(["a", "b with c"], np.array([[1.0, -0.9], [-0.9, 1.0]])))


def test_all_channels_with_a_gap_are_drawn(wide):
    page = render(wide)
    assert "drive frequency" in page and "all with a gap" in page
    drawn = page[page.index('aria-label="gap over time"'):page.index("</svg>")]
    assert "drive frequency" in drawn and "drive level" not in drawn  # it has no gap
    assert "amplitude [FS]" in page and "rate [°/s]" in page and "b with c" in page
    assert [c.name for c in wide.worst][0] == "drive_frequency"


def test_the_page_stays_small_and_fetches_nothing(wide):
    page = render(wide)
    assert len(page) < 1_000_000
    assert not re.findall(r"(?:src|href)\s*=\s*[\"'](?!#|data:)[^\"']+", page) and not re.search(r"@import|url\((?!#)|<script", page)
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_a_recording_that_shows_nothing_says_nothing_of_any_stage(view):
    """Not even that no share of a gap lies there."""
    silent = replace(view, channels=[], diagnosis=view.diagnosis.model_copy(update={"verdict": "insufficient", "where": []}))
    assert re.findall(r"<b>(.*?)</b><span></span></div>", render(silent)) == ["?"] * 9


def test_without_figures(view):
    page = render(View(view.diagnosis, "12 samples", frozenset()))
    assert "<svg" not in page and "Provenance" in page and "12 samples" in page


def test_without_notes_there_is_no_heading_for_them(view):
    assert "What to keep in mind" in render(View(view.diagnosis.model_copy(update={"notes": ["one"]}), "", frozenset()))
    assert "What to keep in mind" not in render(View(view.diagnosis.model_copy(update={"notes": []}), "", frozenset()))


@pytest.mark.parametrize(("value", "text"), [(0.0, "0 %"), (-0.003, "0 %"), (0.003, "< 1 %"), (0.5, "50 %"), (-1.14, "-114 %"), (0.9999, "99.9 %"), (1.0, "100 %")])
def test_percentages(value, text):
    assert _percent(value) == text


@pytest.mark.skipif(BROWSER is None, reason="no chromium is installed")
def test_in_a_browser(wide, tmp_path):
    """The text as the browser lays it out, with scripts and network of no use; a screenshot that is not blank."""
    (tmp_path / "report.html").write_text(render(wide))
    address = f"file://{tmp_path / 'report.html'}"
    run = [BROWSER, *FLAGS, f"--user-data-dir={tmp_path / 'profile'}"]
    dom = subprocess.run([*run, "--dump-dom", address], capture_output=True, text=True, timeout=120, check=True).stdout
    assert wide.diagnosis.sentence.split(";")[0] in dom and dom.count("<svg") == 4
    subprocess.run([*run, f"--screenshot={tmp_path / 'page.png'}", address], capture_output=True, timeout=120, check=True)
    import matplotlib.image

    pixels = matplotlib.image.imread(tmp_path / "page.png")
    assert pixels.shape[:2] == (3000, 1000)
    inked = np.mean(np.any(pixels[..., :3] < 0.9, axis=2), axis=1)
    assert np.mean(inked > 0) > 0.5, "more than half of the rows show something"
    assert np.all(pixels[:, -8:, :3] > 0.9), "nothing runs out of the page"

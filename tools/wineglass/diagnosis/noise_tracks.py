"""Where the strongest line of every window stands, and what its place follows from window to window.

    still      a fixed distance from the carrier: a rate                                          a
    fixed      a fixed frequency: a tone, a force                                                 |a - f|
    drifting   a frequency that follows the temperature: a tone of another oscillator             |a + s T - f|
    twice      the carrier's image in a stiffness that is pumped at a fixed frequency             |a - 2 f|
    moving     a place of its own at any time: no line of a structure, and no oscillator's        from the last place on, by steps

f, T: carrier and temperature of the window. A line of the mount stands where it stands, an oscillator runs where it runs: whatever moves otherwise is neither.
Each course is scored by the likelihood of the places, one in ten of which may be anywhere; a second line may take turns with the first one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wineglass.diagnosis.line_spectra import LEAST_BIN

STRONG, STANDS = 30.0, 10.0
"""height of a peak over the middle of the window's bins, and over both its sides: chance makes neither"""
LEAST = 4
"""windows that must show a strong line: two of them say where a course begins and how it goes on"""
LEAST_MOVING, SHARE_MOVING = 6, 0.2
"""the same of a line that goes its own way, and their part of all: a few steps are no way"""
GAP_BINS, SIDE_BINS = 4, 4
TOP = 0.1
"""of a peak's own height: bins that tell its place"""
ASTRAY = 0.1
"""part of the places that may be anywhere"""
OWN_BINS, OWN_WANDER = 0.35, 0.15
"""by which a place is uncertain: bins, and parts of what the line moves within a window"""
PACES_HZ_PER_S = (0.01, 0.03, 0.1, 0.3)
LARGEST_DRIFT_HZ_PER_DEGC, LEAST_SPAN_DEGC = 0.5, 5.0
TERMS = 1.6
"""of a bin's power: two tapers that overlap"""


@dataclass(frozen=True)
class Peaks:
    """Strongest line of windows, (n,) each. place_hz: distance from the carrier, NaN where none stands out; height: over the middle of the window's bins"""

    time_s: np.ndarray
    place_hz: np.ndarray
    height: np.ndarray
    sigma_hz: np.ndarray
    wander_hz: np.ndarray
    """by which the carrier moves in the window"""

    @property
    def strong(self) -> np.ndarray:
        return np.isfinite(self.place_hz)


@dataclass(frozen=True)
class Track:
    """form: "twice" or "moving"; place_hz (n,) in each window; log_evidence: of there being a line; margin: over the best course that a line of a structure or of an
    oscillator may take, nats"""

    form: str
    time_s: np.ndarray
    place_hz: np.ndarray
    height: np.ndarray
    reach_hz: np.ndarray
    """by which it moves in a window"""
    log_evidence: float
    margin: float


def peaks(power: np.ndarray, frequency_hz: np.ndarray, time_s: np.ndarray, wander_hz: np.ndarray) -> Peaks:
    """power: of the windows (n, m) over the floor's form, NaN where a bin does not count; frequency_hz (m,)"""
    bin_hz = float(frequency_hz[1] - frequency_hz[0])
    found = [_peak(row, frequency_hz, GAP_BINS + math.ceil(wander / bin_hz)) for row, wander in zip(power, wander_hz, strict=True)]
    place, height = np.array(found).reshape(-1, 2).T
    return Peaks(time_s, place, height, np.hypot(OWN_BINS * bin_hz, OWN_WANDER * wander_hz), wander_hz)


def _peak(power: np.ndarray, frequency_hz: np.ndarray, gap: int) -> tuple[float, float]:
    """Place and height of a window's strongest line, (m,) each; NaN where none stands over the middle and over its sides."""
    known = np.nan_to_num(power)
    known[:LEAST_BIN - 1] = 0.0
    if not known.any():
        return math.nan, 1.0
    at = int(np.argmax(known))
    height = float(known[at] / np.median(known[known > 0.0]))
    near = slice(max(0, at - gap), at + gap + 1)
    below, above = power[max(0, near.start - SIDE_BINS):near.start], power[near.stop:near.stop + SIDE_BINS]
    beside = [float(np.nanmedian(side)) for side in (below, above) if np.count_nonzero(np.isfinite(side)) > 1]
    hidden = np.isnan(power[near]).any() or np.count_nonzero(np.isfinite(below)) < 2  # what does not count may hold the top
    if hidden or height < STRONG or known[at] < STANDS * max(beside):
        return math.nan, height
    weight = np.where(known[near] > TOP * known[at], known[near], 0.0)
    return float(np.sum(weight * frequency_hz[near]) / np.sum(weight)), height


def follow(found: Peaks, carrier_hz: np.ndarray, temperature_degc: np.ndarray | None, top_hz: float) -> Track | None:
    """What the places follow, if that is nothing that a line does. carrier_hz, temperature_degc: of the windows (n,); top_hz: half the telemetry's rate.
    None: too few strong peaks to say, or a line of a usual kind."""
    strong = found.strong
    if np.count_nonzero(strong) < LEAST:
        return None
    courses = _Courses(found, carrier_hz, temperature_degc, top_hz)
    usual = max(courses.single(form) for form in (("still", "fixed") if temperature_degc is None else ("still", "fixed", "drifting")))
    usual = max(usual, courses.without_order(), *(courses.double(one, other) for one in ("still", "fixed") for other in ("still", "fixed")))
    scores = {"twice": courses.single("twice")}
    if np.count_nonzero(strong) >= max(LEAST_MOVING, SHARE_MOVING * len(strong)):
        scores["moving"] = courses.walk()
    form = max(scores, key=lambda name: scores[name])
    height = found.height[strong]
    evidence = float(np.sum(TERMS * (height - 1.0 - np.log(height))))
    place = courses.places_of_twice() if form == "twice" else np.interp(found.time_s, found.time_s[strong], found.place_hz[strong])
    margin = scores[form] - usual
    return Track(form, found.time_s, place, found.height, (2.0 if form == "twice" else 1.0) * found.wander_hz, evidence, margin) if margin > 0.0 else None


class _Courses:
    """Places of the strong peaks, and how well courses explain them."""

    def __init__(self, found: Peaks, carrier_hz: np.ndarray, temperature_degc: np.ndarray | None, top_hz: float):
        strong = found.strong
        self._all_hz, self._top_hz = carrier_hz - np.median(carrier_hz), top_hz
        self._time_s, self._place, self._sigma = found.time_s[strong], found.place_hz[strong], found.sigma_hz[strong]
        self._carrier = self._all_hz[strong]
        self._degc = np.zeros(len(self._place)) if temperature_degc is None else (temperature_degc - np.mean(temperature_degc))[strong]
        self._anywhere = 1.0 / top_hz
        self._trials = math.log(top_hz / (2.5 * float(np.median(self._sigma))))

    def single(self, form: str) -> float:
        """Log likelihood of one course, its place and slope paid for."""
        return max(self._best(slope * self._degc, form)[0] for slope in self._slopes(form)) - self._trials - math.log(len(self._slopes(form)))

    def double(self, one: str, other: str) -> float:
        """The same of two lines that take turns."""
        _, first = self._best(np.zeros(len(self._place)), one)
        left = np.abs(first - self._place) > 3.0 * self._sigma
        if np.count_nonzero(left) < 2:
            return -math.inf
        _, second = self._best(np.zeros(len(self._place)), other, left)
        both = 0.5 * (1.0 - ASTRAY) * (self._near(first) + self._near(second)) + ASTRAY * self._anywhere
        return float(np.sum(np.log(both))) - 2.0 * self._trials

    def walk(self) -> float:
        """Log likelihood of a place that goes on from the last one, at the best of a few paces."""
        step, gone = np.diff(self._place), np.diff(self._time_s)
        scores = []
        for pace in PACES_HZ_PER_S:
            sigma = np.sqrt(self._sigma[1:] ** 2 + self._sigma[:-1] ** 2 + (pace * gone) ** 2)
            near = np.exp(-0.5 * (step / sigma) ** 2) / (math.sqrt(2.0 * math.pi) * sigma)
            scores.append(float(np.sum(np.log((1.0 - ASTRAY) * near + ASTRAY * self._anywhere))))
        return max(scores) + math.log(self._anywhere) - math.log(len(PACES_HZ_PER_S))

    def without_order(self) -> float:
        """Log likelihood of places that may be anywhere."""
        return len(self._place) * math.log(self._anywhere)

    def places_of_twice(self) -> np.ndarray:
        """In all windows, (n,)."""
        at = self._starts(2.0 * self._carrier)
        scores = [float(np.sum(np.log(self._mixed(self._folded(a - 2.0 * self._carrier))))) for a in at]
        return self._folded(at[int(np.argmax(scores))] - 2.0 * self._all_hz)

    def _slopes(self, form: str) -> Sequence[float]:
        span = float(np.ptp(self._degc))
        if form != "drifting":
            return (0.0,)
        if span < LEAST_SPAN_DEGC:
            return (0.0,)
        step = 2.0 * float(np.median(self._sigma)) / span
        count = int(LARGEST_DRIFT_HZ_PER_DEGC / step)
        return [float(step * i) for i in range(-count, count + 1)]

    def _best(self, drift_hz: np.ndarray, form: str, chosen: np.ndarray | None = None) -> tuple[float, np.ndarray]:
        """Log likelihood of the best place, with the places (k,) that it means; chosen: windows that it is to explain."""
        moved = {"still": 0.0, "twice": 2.0}.get(form, 1.0) * self._carrier - drift_hz
        places = self._folded(self._starts(moved)[:, None] - moved)
        scores = np.log(self._mixed(places))
        total = scores.sum(axis=1) if chosen is None else scores[:, chosen].sum(axis=1)
        best = int(np.argmax(total))
        return float(total[best]), places[best]

    def _starts(self, moved: np.ndarray) -> np.ndarray:
        """Frequencies that put the line on a peak, on either side of the carrier, (2 k,)."""
        return np.concatenate([moved + self._place, moved - self._place])

    def _folded(self, distance_hz: np.ndarray) -> np.ndarray:
        turns = distance_hz / (2.0 * self._top_hz)
        return np.asarray(np.abs(turns - np.round(turns)) * 2.0 * self._top_hz)

    def _near(self, places: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(-0.5 * ((places - self._place) / self._sigma) ** 2) / (math.sqrt(2.0 * math.pi) * self._sigma))

    def _mixed(self, places: np.ndarray) -> np.ndarray:
        return (1.0 - ASTRAY) * self._near(places) + ASTRAY * self._anywhere

"""What tolerances leave of a gap: the recording with the effects against any that a healthy unit of the same description could have made.

Everything is a difference of runs of the described unit with the same noise: one with the effects, one with each uncertain number moved a little. The
moved ones are taken as straight lines; the best sum of them is taken off the effects' difference, at the price of its probability: a move of one standard
deviation costs as much as a difference of SNR 1."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from wineglass.blind.generator.case import Case
from wineglass.blind.generator.making import describe, looked_at
from wineglass.blind.generator.oracle import MEDIAN_OF_SQUARE, SEEN_THROUGH, ChannelGrade, Grade, Measured, beyond, white_power
from wineglass.blind.generator.unit import FARTHEST, Nudge, at, nudges

NOISE_SEED = 20
NUDGE = 0.2  # standard deviations
NOISE = "electronics.adc.snr_db"
QUIET = {NOISE: 0.0, "electronics.adc.bits": 32, "electronics.dac.bits": 32, "electronics.thermometer.noise_degc": 0.0,
         "electronics.thermometer.lsb_degc": 2.0**-16}
CLOSER = 2  # times that the lines are laid anew
CERTAIN = 4.0, 300.0  # below and above, it makes no difference
DECIDED = 10.0  # SNR of one effect from which on that of all together is not asked for
NEAR = 0.2  # standard deviations: lines do not bend over less
FAINTEST = 1e-12  # power of noise that is none, of the white one
NOISE_LIKE = ("excess_noise", "clock_jitter")
"""Effects that make noise: what they do is looked for in the noise's power, too."""


def alike(case: Case, quiet: bool, fields: Mapping[str, Any] | None = None) -> Case:
    """The case on the described unit and with the same floors as all others; what the effects draw stays theirs. quiet: without noise and steps of converters, which
    come out others as soon as the carrier's phase does; fields: moved ones. Raw bursts are not looked at, so there are none."""
    override = {**case.scenario.override, **QUIET} if quiet else case.scenario.override
    bursts = case.scenario.recording.model_copy(update={"bursts": []})
    scenario = case.scenario.model_copy(update={"override": override, "recording": bursts})
    return replace(case, scenario=scenario, seed=case.draw, noise_seed=NOISE_SEED, another_unit=False, noise_factor=1.0, lost_fraction=0.0,
                   fields=fields or {}, paced=True)


def moved(case: Case) -> list[Nudge]:
    """What a bench does not know of a healthy unit."""
    return [one for one in nudges(describe(case), NUDGE) if one.name != NOISE]


def louder(case: Case) -> list[Nudge]:
    """The same of its noise."""
    return [one for one in nudges(describe(case), 1.0) if one.name == NOISE]


def makes_noise(case: Case) -> bool:
    return any(one.id in NOISE_LIKE for one in case.effects)


def run(case: Case, calibration: Callable[[Case], bytes]) -> Measured:
    """One run, measured."""
    return looked_at(case, calibration(case))


@dataclass(frozen=True)
class Runs:
    """The same case twice: quiet, and with its noise where that is looked at."""

    quiet: Measured
    noisy: Measured | None = None


@dataclass(frozen=True)
class Whitening:
    """Differences of a kind of recordings in units of their noise: per channel its means, what is left inside of them, and last, of all channels, by how much
    the noise itself has changed. plain: the described unit, both ways"""

    plain: Runs

    def __post_init__(self) -> None:
        assert self.plain.noisy is not None

    @property
    def _like(self) -> Measured:
        return self.plain.quiet

    @cached_property
    def _white(self) -> dict[str, float]:
        return {name: self.plain.noisy.white(name) for name in self._like.values}  # type: ignore[union-attr]

    @cached_property
    def places(self) -> dict[str, tuple[int, int, int]]:
        """Of each channel's means, of its rest, and the end of these."""
        found, at = {}, 0
        for name, values in self._like.values.items():
            means, per = len(values) // self._like.per_mean[name], self._like.per_mean[name]
            found[name] = at, at + means, at + means * (1 + per)
            at = found[name][2]
        return found

    @property
    def length(self) -> int:
        return max((end for _, _, end in self.places.values()), default=0) + len(self.places)

    def of(self, changed: Runs, base: Runs) -> np.ndarray:
        """(length,)"""
        parts = [part for name in self.places for part in self._channel(name, changed.quiet, base.quiet)]
        return np.concatenate([*parts, [self._louder(name, changed.noisy, base.noisy) for name in self.places]])

    def _channel(self, name: str, changed: Measured, base: Measured) -> tuple[np.ndarray, np.ndarray]:
        per = self._like.per_mean[name]
        difference = np.zeros(len(self._like.values[name]) // per * per)
        if name in changed.values:
            count = min(len(difference), len(changed.values[name]), len(base.values[name]))
            difference[:count] = np.nan_to_num(changed.values[name][:count] - base.values[name][:count])
        blocks = difference.reshape(-1, per)
        means = blocks.mean(axis=1)
        return means / self._slow(name), ((blocks - means[:, None]) / np.sqrt(self._white[name])).ravel()

    def _slow(self, name: str) -> float:
        """Noise of a mean, rms: of the recorded noise, which need not be white (a rebalance force's is blue), and the described floor."""
        return float(np.sqrt(max(self._means[name], FAINTEST * self._white[name]) + self._like.floor[name] ** 2))

    @cached_property
    def _means(self) -> dict[str, float]:
        """Power of the means of what the noise adds; of the reference, of the device's channel that it is seen through."""
        return {name: self._power_of_means(SEEN_THROUGH.get(name, name)) for name in self._like.values}

    def _power_of_means(self, name: str) -> float:
        if name not in self._like.values:
            return 0.0
        noisy, quiet, per = self.plain.noisy.values[name], self._like.values[name], self._like.per_mean[name]  # type: ignore[union-attr]
        count = min(len(noisy), len(quiet)) // per
        steps = np.diff(np.nan_to_num(noisy[:count * per] - quiet[:count * per]).reshape(count, per).mean(axis=1))
        return float(np.median(steps**2)) / MEDIAN_OF_SQUARE / 2.0 if len(steps) else 0.0

    def _louder(self, name: str, changed: Measured | None, base: Measured | None) -> float:
        """Change of the noise's logarithm over what chance makes of it."""
        if changed is None or base is None or name not in changed.values or self._white[name] <= 1e-24:
            return 0.0
        powers = [max(white_power(one.values[name]), 1e-6 * self._white[name]) for one in (changed, base)]
        return float(np.log(powers[0] / powers[1]) / np.sqrt(8.0 / len(self._like.values[name])))

    def channel_grade(self, name: str, left: np.ndarray, noise_like: bool) -> ChannelGrade:
        """left (length,): what nothing healthy explains, in units of noise; noise_like: what of it is white noise does not count as a shift."""
        (begin, middle, end), per, white = self.places[name], self._like.per_mean[name], self._white[name]
        means, rest = left[begin:middle] * self._slow(name), left[middle:end] * np.sqrt(white)
        between = white_power(np.repeat(means, per) + rest) if noise_like else 0.0
        slow = beyond(float(np.sum(means**2)), len(means), between / per)
        fast = beyond(float(np.sum(rest**2)), len(rest), between)
        shift = float(np.sqrt(slow / self._slow(name) ** 2 + fast / white))
        noise = abs(float(left[len(left) - len(self.places) + list(self.places).index(name)]))
        return ChannelGrade(shift, float(np.sqrt(slow / max(1, len(means)))) / self._slow(name), noise)


@dataclass(frozen=True)
class Allowance:
    """moves (k, length): what each uncertain number of `names` does per standard deviation, in units of noise."""

    whitening: Whitening
    names: tuple[str, ...]
    moves: np.ndarray

    @cached_property
    def _gram(self) -> np.ndarray:
        return np.eye(len(self.names)) + np.array([[float(np.dot(a, b)) for b in self.moves] for a in self.moves]).reshape(len(self.names), -1)

    def explained(self, changed: Runs, base: Runs, at: np.ndarray) -> tuple[np.ndarray, Grade]:
        """The unit (k,), in standard deviations, that explains most, and what it leaves. at (k,): the unit of the base."""
        difference = self.whitening.of(changed, base)
        further = np.linalg.solve(self._gram, self.moves @ difference - at)
        left = difference - further @ self.moves
        channels = {name: self.whitening.channel_grade(name, left, changed.noisy is not None) for name in self.whitening.places}
        return at + further, Grade(channels, float(np.linalg.norm(at + further)))

    def grade(self, changed: Runs, base: Callable[[dict[str, float]], Runs]) -> Grade:
        """changed: with effects; base: without them, or with others that are there anyway, on the unit that lies so far off.

        Where the straight lines leave something of a size that their own bending could have, the unit they lead to is run and they are laid from there."""
        at = np.zeros(len(self.names))
        found = self.explained(changed, base({}), at)
        for _ in range(CLOSER):
            to = np.clip(found[0], -FARTHEST, FARTHEST)
            if not CERTAIN[0] < found[1].snr < CERTAIN[1] or np.linalg.norm(to - at) < NEAR:
                break
            at = to
            again = self.explained(changed, base(dict(zip(self.names, at, strict=True))), at)
            if again[1].snr >= found[1].snr:
                break
            found = again
        return found[1]


def graded(case: Case, calibration: Callable[[Case], bytes], allowance: Allowance) -> tuple[Grade, list[Grade]]:
    """Of all effects of the case together (or of the largest, where one is enough), and of each beside those before it. calibration: the block of a case's device"""
    plain = allowance.whitening.plain

    def runs(count: int, off: dict[str, float], noisy: bool) -> Runs:
        """With the first effects, on the unit that lies so far off."""
        if not off and not count:
            return plain
        some, fields = replace(case, effects=case.effects[:count]), at(describe(case), off) if off else {}
        return Runs(run(alike(some, True, fields), calibration), run(alike(some, False, fields), calibration) if noisy else plain.noisy)

    whole, noisy = len(case.effects), makes_noise(case)
    steps = [runs(count, {}, noisy) for count in range(whole + 1)]

    def grade(count: int, before: int) -> Grade:
        changed = steps[count] if noisy else Runs(steps[count].quiet)
        return allowance.grade(changed, lambda off: runs(before, off, noisy and before > 0) if off else steps[before])

    each = [grade(count, count - 1) for count in range(1, whole + 1)]
    largest = max(each, key=lambda one: one.snr)
    return (largest if whole == 1 or largest.snr > DECIDED else grade(whole, 0)), each


def save(allowance: Allowance, folder: Path) -> None:
    """Two files; the second is looked at where it lies."""
    plain = allowance.whitening.plain
    np.savez(folder / "plain.npz", names=np.array(allowance.names), channels=np.array(list(plain.quiet.values)),
             per_mean=np.array(list(plain.quiet.per_mean.values())), floor=np.array(list(plain.quiet.floor.values())),
             **{f"{way}_{name}": values for way in ("quiet", "noisy") for name, values in getattr(plain, way).values.items()})
    np.save(folder / "moves.npy", allowance.moves)


def load(folder: Path) -> Allowance:
    with np.load(folder / "plain.npz") as file:
        channels = [str(name) for name in file["channels"]]
        quiet, noisy = (Measured({name: file[f"{way}_{name}"] for name in channels}, dict(zip(channels, map(int, file["per_mean"]), strict=True)),
                                 dict(zip(channels, map(float, file["floor"]), strict=True))) for way in ("quiet", "noisy"))
        names = tuple(str(name) for name in file["names"])
    return Allowance(Whitening(Runs(quiet, noisy)), names, np.load(folder / "moves.npy", mmap_mode="r"))


def gathered(plain: Runs, moves: dict[str, tuple[float, Runs]]) -> Allowance:
    """moves: by name of what was moved, how far in standard deviations, and the runs."""
    whitening = Whitening(plain)
    rows = [(whitening.of(one, plain) / by).astype(np.float32) for by, one in moves.values()]
    return Allowance(whitening, tuple(moves), np.array(rows, np.float32).reshape(len(rows), whitening.length))

"""Evidence that powers of bands are a sum of known shapes of unknown strengths: gamma likelihood, log-uniform strengths, integrated by Laplace's method.

    mean power = noise e^t + steps + w^2 wander + sum of c_j answer_j        t Gaussian, w on a few nodes, log c_j uniform

A strength may be too small to matter: every subset of the shapes is fitted, and those that are left out count with the part of their range in which
they would not be seen."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import combinations, product

import numpy as np
from scipy.special import logsumexp

WANDERS = np.array([0.0, 0.3, 0.7, 1.1])
"""of the described slow noise, how much of it this unit may have"""
STARTS, ROUNDS = 5, 12
LARGEST_STEP = 2.0


@dataclass(frozen=True)
class Mixture:
    """Powers of bands (n,) with their gamma shapes, and what a healthy device has there: noise of a tolerance (standard deviation of its log), steps,
    wander; (n,) each."""

    power: np.ndarray
    shape: np.ndarray
    noise: np.ndarray
    steps: np.ndarray
    wander: np.ndarray
    tolerance: float
    _known: dict[tuple, float] = field(default_factory=dict, repr=False)

    def log_likelihood(self, mean: np.ndarray) -> np.ndarray:
        """Of means (..., n), relative to the powers themselves."""
        ratio = self.power / mean
        return -np.sum(self.shape * (ratio - 1.0 - np.log(ratio)), axis=-1)

    def log_evidence(self, answers: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
        """answers: (m, n); low, high: range of each shape's strength squared, (m,)"""
        seen = np.array([self._least_seen(*item) for item in zip(answers, low, high, strict=True)])
        unseen = np.log(np.log(seen / low) / np.log(high / low))
        scores = []
        for size in range(len(answers) + 1):
            for chosen in combinations(range(len(answers)), size):
                active = list(chosen)
                key = tuple((answers[j].tobytes(), low[j], high[j]) for j in active)
                if key not in self._known:
                    self._known[key] = self._laplace(answers[active], seen[active], high[active], np.log(high / low)[active])
                scores.append(self._known[key] + float(np.sum(unseen)) - float(np.sum(unseen[active])))
        return float(logsumexp(scores))

    def _least_seen(self, answer: np.ndarray, low: float, high: float) -> float:
        """Strength squared below which it would not be seen, within the range."""
        information = float(np.sum(self.shape * (answer / (self.noise + self.steps)) ** 2))
        return min(max(1.0 / math.sqrt(max(information, 1e-300)), low**0.98 * high**0.02), low**0.1 * high**0.9)

    def _laplace(self, answers: np.ndarray, low: np.ndarray, high: np.ndarray, ranges: np.ndarray) -> float:
        """All of the shapes at work, from where they are seen: mean over the nodes of wander. ranges: of log strengths squared, the unseen part included."""
        theta = self._started(answers, low, high)
        for _ in range(ROUNDS):
            gradient, information = self._derivatives(theta, answers, ranges)
            step = np.linalg.solve(information, gradient[..., None])[..., 0]
            theta = theta + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
            theta[:, 0] = np.clip(theta[:, 0], -4.0 * self.tolerance, 4.0 * self.tolerance)
            theta[:, 1:] = np.clip(theta[:, 1:], np.log(low), np.log(high))
            if np.max(np.abs(step)) < 1e-3:
                break
        _, information = self._derivatives(theta, answers, ranges)
        _, log_determinant = np.linalg.slogdet(information)
        log_prior = -0.5 * (theta[:, 0] / self.tolerance) ** 2 - math.log(self.tolerance * math.sqrt(2.0 * math.pi)) - np.sum(np.log(ranges))
        log_volume = 0.5 * (theta.shape[1] * math.log(2.0 * math.pi) - log_determinant)
        return float(logsumexp(self.log_likelihood(self._mean(theta, answers)) + log_prior + log_volume) - math.log(len(WANDERS)))

    def _mean(self, theta: np.ndarray, answers: np.ndarray) -> np.ndarray:
        """theta: t and log strengths squared, (nodes of wander, 1 + m); (nodes, n)"""
        floor = self.noise * np.exp(theta[:, :1]) + self.steps + WANDERS[:, None] ** 2 * self.wander
        return np.asarray(floor + np.exp(theta[:, 1:]) @ answers)

    def _derivatives(self, theta: np.ndarray, answers: np.ndarray, ranges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (nodes, 1 + m) of the log posterior, and its expected information (nodes, 1 + m, 1 + m)."""
        mean = self._mean(theta, answers)
        own = self.noise * np.exp(theta[:, :1])
        columns = np.concatenate([own[:, None, :], np.exp(theta[:, 1:, None]) * answers], axis=1) / mean[:, None, :]
        gradient = columns @ (self.shape * (self.power / mean - 1.0))[..., None]
        information = (columns * self.shape) @ columns.transpose(0, 2, 1)
        weight = np.concatenate([[self.tolerance**-2], 2.0 * math.pi / ranges**2])  # so that what is not seen fills its range and no more
        information += np.diag(weight)
        gradient = gradient[..., 0]
        gradient[:, 0] -= theta[:, 0] * weight[0]
        return gradient, information

    def _started(self, answers: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """The best of a coarse grid of strengths for every node of wander, (nodes, 1 + m)."""
        grids = [np.linspace(math.log(a), math.log(b), STARTS + 2)[1:-1] for a, b in zip(low, high, strict=True)]
        points = np.array(list(product(*grids)), float).reshape(STARTS ** len(answers), len(answers))
        start = np.zeros((len(WANDERS), 1 + len(answers)))
        for node in range(len(WANDERS)):
            floor = self.noise + self.steps + WANDERS[node] ** 2 * self.wander
            scores = self.log_likelihood(floor + np.exp(points) @ answers)
            start[node, 1:] = points[int(np.argmax(scores))]
        return start

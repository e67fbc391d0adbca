"""A recording of a device that is not quite what its description says, with the truth under seal: for trying the diagnosis.

The label's SHA-256 is known before the diagnosis runs, so nobody can change it afterwards.

    case = draw(seed=7)
    record(case, Path("case.h5"))          # the recording does not name what was drawn
    ...                                    # diagnose case.h5
    judge(case, diagnosis)                 # the label is opened
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from wineglass import effects
from wineglass.effects import Setting
from wineglass.errors import BadInput

if TYPE_CHECKING:
    from wineglass.diagnosis.contract import Diagnosis
    from wineglass.scenario import Run
    from wineglass.simulation import Done

HEALTHY_SHARE = 0.1  # of the draws: a diagnosis that always finds something would be found out
SIZES = 1.0, 3.0  # of the typical size
TRIES = 100


@dataclass(frozen=True)
class Case:
    """seed: of the draw; noise_seed: of the twin's noise, which the recording tells, and from which the draw cannot be made again;
    salt: keeps the label from being guessed from its digest"""

    seed: int
    noise_seed: int
    setting: Setting | None
    """None: a healthy device"""
    protocol: str
    device: str
    loop: Literal["open", "rebalance"]
    salt: str

    @property
    def label(self) -> str:
        values = None if self.setting is None else {"id": self.setting.id, "values": self.setting.values}
        return json.dumps({"seed": self.seed, "effect": values, "salt": self.salt}, sort_keys=True)

    @property
    def digest(self) -> str:
        """SHA-256 of the label."""
        return hashlib.sha256(self.label.encode()).hexdigest()

    @property
    def truth(self) -> str:
        """In words."""
        return "nothing: a healthy device" if self.setting is None else str(self.setting)

    @property
    def stage(self) -> str | None:
        return None if self.setting is None else effects.find(self.setting.id).stage

    def run(self) -> Run:
        from wineglass import protocols, scenario

        return scenario.prepare(protocols.scenario(self.protocol, self.device, self.loop, self.noise_seed))


@dataclass(frozen=True)
class Judgement:
    """named: every effect that the diagnosis holds possible; found: the truth is among them, or nothing was to be found and no effect is named.
    alone: and no other explanation is left. beside: what is named with it although it is not there. stage: the right one is the first of those that hold the gap; None: there is none to be right"""

    truth: str
    label: str
    digest: str
    verdict: str
    named: list[list[str]]
    found: bool
    alone: bool
    stage: bool | None
    beside: tuple[str, ...] = ()

    @property
    def in_words(self) -> str:
        if self.found and self.beside:
            return f"the truth was named, and with it what is not there: {', '.join(self.beside)}"
        if self.found:
            return "the truth is what was named" if self.alone else "the truth is among what was named"
        if self.verdict in ("unknown", "insufficient"):
            return "the truth was not named, and nothing else was claimed"
        return "the truth was not seen" if not self.named else "the truth is not among what was named"


def judge(case: Case, diagnosis: Diagnosis) -> Judgement:
    """Opens the label and holds the diagnosis against it."""
    named = [list(ids) for ids in diagnosis.alternatives] or ([[effect.id for effect in diagnosis.effects]] if diagnosis.effects else [])
    if case.setting is None:
        found = diagnosis.verdict == "no_gap"
    else:
        found = any(case.setting.id in ids for ids in named)
    beside = sorted({name for ids in named for name in ids} - {case.setting.id}) if case.setting and found and len(named) == 1 else []
    stage = None if case.stage is None or not diagnosis.where else max(diagnosis.where, key=lambda item: item.share).stage == case.stage
    return Judgement(case.truth, case.label, case.digest, diagnosis.verdict, named, found, found and len(named) <= 1, stage, tuple(beside))


def new_seed() -> int:
    return secrets.randbelow(1_000_000)


def draw(seed: int, protocol: str = "full", device: str = "metal-fast", loop: Literal["open", "rebalance"] = "open") -> Case:
    """One effect of the whole catalogue, or now and then none; of one to three times its typical size, either sign. The same seed draws the same."""
    rng = np.random.default_rng([seed, 0x48494444])
    salt, noise_seed = rng.bytes(16).hex(), int(rng.integers(2**32))
    for _ in range(TRIES):
        setting = None if rng.random() < HEALTHY_SHARE else _setting(rng)
        case = Case(seed, noise_seed, setting, protocol, device, loop, salt)
        if possible(case):
            return case
    raise BadInput("no effect of the catalogue is possible on this device", device, "choose another device")


def possible(case: Case) -> bool:
    """Would the twin run with it?"""
    from wineglass.twin import Twin

    try:
        with Twin(case.run(), effects=[case.setting] if case.setting else []):
            return True
    except BadInput:
        return False


def record(case: Case, path: Path, progress: Callable[[int], None] | None = None) -> Done:
    """The recording; it does not name the effect."""
    from wineglass.simulation import simulate

    return simulate(case.run(), path, progress, effects=[case.setting] if case.setting else [])


def _setting(rng: np.random.Generator) -> Setting:
    effect = effects.catalogue()[int(rng.integers(len(effects.catalogue())))]
    strengths = [parameter for parameter in effect.parameters if parameter.strength]
    chosen = strengths[int(rng.integers(len(strengths)))]
    size = float(chosen.typical * np.exp(rng.uniform(*np.log(SIZES))) * rng.choice([-1.0, 1.0]))
    if not chosen.low <= size <= chosen.high:
        size = float(np.clip(abs(size), chosen.low, chosen.high))
    return Setting(effect.id, {chosen.name: float(f"{size:.4g}")})

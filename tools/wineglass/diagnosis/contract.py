"""The diagnosis as JSON. Names and meanings are fixed; whatever breaks them fails validation here, before anything is written."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from wineglass.diagnosis.vocabulary import COMPONENTS, EFFECTS, NONE, OTHER, STAGES, VERDICTS, stage_of

FORMAT = "wineglass-diagnosis"
FORMAT_VERSION = 1

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Size = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Model(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Region(Model):
    """Where on an axis: time [s], temperature [degC], ... The field `from` is a keyword in Python, hence the alias."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)
    variable: str
    start: Finite = Field(alias="from")
    stop: Finite = Field(alias="to")
    unit: str


class Where(Model):
    stage: Literal[STAGES]
    channel: str
    component: Literal[COMPONENTS]
    share: Share
    region: Region
    size: Size
    unit: str
    ratio_over_floor: Size


class Hypothesis(Model):
    ids: list[str] = Field(min_length=1)
    probability: Share

    @field_validator("ids")
    @classmethod
    def _known(cls, ids: list[str]) -> list[str]:
        for name in ids:
            if name not in EFFECTS and name not in (NONE, OTHER):
                raise ValueError(f"'{name}' is no effect")
        if len(set(ids)) != len(ids) or (NONE in ids and len(ids) > 1):
            raise ValueError("ids must differ, and none stands alone")
        return ids


class Parameter(Model):
    name: str
    value: Finite
    interval: tuple[Finite, Finite]
    unit: str

    @model_validator(mode="after")
    def _ordered(self) -> Parameter:
        if not self.interval[0] <= self.interval[1]:
            raise ValueError("the interval is upside down")
        return self

    @property
    def text(self) -> str:
        """Value and interval, with as many digits as show how wide the interval is."""
        low, high = self.interval
        largest, width = max(abs(low), abs(high)), high - low
        digits = 3 if width <= 0.0 else min(15, max(3, 2 + math.ceil(math.log10(max(1.0, largest / width)))))
        return f"{self.value:.{digits}g} [{low:.{digits}g}, {high:.{digits}g}]"


class EffectFound(Model):
    id: Literal[tuple(EFFECTS)]
    stage: Literal[STAGES]
    confidence: Share
    parameters: list[Parameter]
    share: Share

    @model_validator(mode="after")
    def _stage(self) -> EffectFound:
        if self.stage != stage_of(self.id):
            raise ValueError(f"{self.id} belongs to stage {stage_of(self.id)}")
        return self


class ChannelShrink(Model):
    """fraction is null for a channel without a gap."""

    channel: str
    before: Size
    after: Size
    floor: Size
    unit: str
    fraction: Finite | None
    interval: tuple[Finite, Finite] | None


class TotalShrink(Model):
    """Over the whitened channels that have a gap: before, after and floor in multiples of the noise floor."""

    before: Size | None
    after: Size | None
    floor: Size | None
    unit: str = "floor"
    fraction: Finite | None
    interval: tuple[Finite, Finite] | None


class Shrink(Model):
    channels: list[ChannelShrink]
    all: TotalShrink
    held_out: str
    computed_by: str


class NextExperiment(Model):
    run: str
    separates: list[list[str]]
    predicted_separation: Finite | None
    unit: str = "nats"
    why: str


class Provenance(Model):
    program: str
    engine: str
    recording: str
    sha256: str
    device: str | None = None
    firmware: str | None = None


class Diagnosis(Model):
    format: Literal[FORMAT] = FORMAT
    format_version: Literal[FORMAT_VERSION] = FORMAT_VERSION
    verdict: Literal[VERDICTS]
    sentence: str
    where: list[Where]
    hypotheses: list[Hypothesis] = Field(min_length=2)
    effects: list[EffectFound]
    alternatives: list[list[str]]
    shrink: Shrink
    next_experiment: NextExperiment | None
    notes: list[str]
    provenance: Provenance

    @model_validator(mode="after")
    def _consistent(self) -> Diagnosis:
        total = sum(h.probability for h in self.hypotheses)
        if abs(total - 1.0) > 1e-6:
            raise ValueError(f"the probabilities sum to {total}")
        keys = [frozenset(h.ids) for h in self.hypotheses]
        if len(set(keys)) != len(keys):
            raise ValueError("a hypothesis is listed twice")
        if {frozenset({NONE}), frozenset({OTHER})} - set(keys):
            raise ValueError("none and other must be among the hypotheses")
        self._effects_are_marginals()
        if self.verdict == "ambiguous" and len(self.alternatives) < 2:
            raise ValueError("ambiguous needs two alternatives")
        if self.verdict in ("no_gap", "insufficient") and self.effects:
            raise ValueError(f"{self.verdict} names no effects")
        if self.verdict == "attributed" and not self.effects:
            raise ValueError("attributed names effects")
        if sum(w.share for w in self.where) > 1.0 + 1e-6:
            raise ValueError("shares of the gap sum to more than all of it")
        return self

    def _effects_are_marginals(self) -> None:
        for effect in self.effects:
            marginal = sum(h.probability for h in self.hypotheses if effect.id in h.ids)
            if abs(marginal - effect.confidence) > 1e-3:
                raise ValueError(f"confidence of {effect.id} is {effect.confidence}, its marginal {marginal}")

    def to_json(self) -> str:
        return self.model_dump_json(indent=2, by_alias=True) + "\n"

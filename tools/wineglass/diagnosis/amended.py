"""The device description with the named effects in it, so that simulation goes on with the better twin.

Every effect becomes an [[effect]] table (wineglass.effect_table), also where the description has a field of that meaning: the calibration is made from the
fields, and the recorded gyro was calibrated without knowing of the effect.
"""

from __future__ import annotations

from dataclasses import dataclass

from wineglass.device import Device
from wineglass.diagnosis import curves
from wineglass.diagnosis.contract import Diagnosis, EffectFound
from wineglass.diagnosis.vocabulary import OTHER
from wineglass.effect_table import EffectTable
from wineglass.effects import Effect, find
from wineglass.errors import BadInput


@dataclass(frozen=True)
class Amended:
    """left_out: named effects without a size that the twins understand"""

    device: Device
    applied: tuple[str, ...]
    left_out: tuple[str, ...]


def amend(device: Device, diagnosis: Diagnosis) -> Amended:
    """With the effects of the verdict, or of the most probable explanation where several are left."""
    named = _named(diagnosis)
    tables, left_out = [], []
    for effect in diagnosis.effects:
        if effect.id not in named:
            continue
        table = _table(effect)
        if table is None:
            left_out.append(effect.id)
        else:
            tables.append(table)
    merged = _merged([*device.effect, *tables])
    return Amended(device.model_copy(update={"effect": merged}), tuple(t.id for t in tables), tuple(left_out))


def text(amended: Amended, diagnosis: Diagnosis) -> str:
    """TOML with a heading that says where it comes from."""
    lines = [f"# Amended by {diagnosis.provenance.program} from {diagnosis.provenance.recording} (sha256 {diagnosis.provenance.sha256[:16]}).",
             f"# Verdict: {diagnosis.verdict}. {diagnosis.sentence}"]
    if diagnosis.verdict == "ambiguous":
        lines.append("# Several explanations are left; the most probable one is applied.")
    if not amended.applied:
        lines.append("# Nothing is applied: the description is unchanged.")
    lines += [f"# {name} is not applied: this recording does not give its size in the twin's parameters." for name in amended.left_out]
    return "\n".join(" ".join(line.split()) for line in lines) + "\n" + amended.device.to_toml()


def _named(diagnosis: Diagnosis) -> set[str]:
    if diagnosis.verdict != "ambiguous":
        return {effect.id for effect in diagnosis.effects}
    order = [h.ids for h in sorted(diagnosis.hypotheses, key=lambda h: -h.probability)]
    alternatives = [set(ids) for ids in diagnosis.alternatives if ids != [OTHER]]
    best = next((set(ids) for ids in order if set(ids) in alternatives), alternatives[0])
    return best - {OTHER}


def _table(effect: EffectFound) -> EffectTable | None:
    record = find(effect.id)
    values = {p.name: p.value for p in effect.parameters}
    known = {p.name: values[p.name] for p in record.parameters if p.name in values and p.low <= values[p.name] <= p.high}
    return EffectTable(id=effect.id, parameters=known) if any(p.strength and p.name in known for p in record.parameters) else None


def _merged(tables: list[EffectTable]) -> list[EffectTable]:
    """One table per effect: strengths and curves of the same effect add up, its shapes and other forms are those of the later one."""
    merged: dict[str, EffectTable] = {}
    for table in tables:
        merged[table.id] = _sum(find(table.id), merged[table.id], table) if table.id in merged else table
    return list(merged.values())


def _sum(record: Effect, first: EffectTable, second: EffectTable) -> EffectTable:
    values = {**first.parameters, **second.parameters}
    for parameter in record.parameters:
        if (parameter.strength or curves.is_point(parameter.name)) and parameter.name in values:
            total = first.parameters.get(parameter.name, 0.0) + second.parameters.get(parameter.name, 0.0)
            if not parameter.low <= total <= parameter.high:
                raise BadInput(f"{parameter.name} of {record.id} would become {total:g} {parameter.unit}", "--apply", "diagnose with the description before")
            values[parameter.name] = total
    return EffectTable(id=record.id, parameters=values)

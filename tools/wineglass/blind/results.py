"""All answers of one engine as a table (Parquet), beside the answers themselves."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from wineglass.atomic import atomic_path
from wineglass.blind.extra import need

TABLE = "results.parquet"


def read(folder: Path) -> dict[str, dict[str, Any]]:
    """Answers by case, without what is still being written or was left half written: such a file's name begins with a dot."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("[!.]*.json"))]
    return {one["case"]: one for one in found}


def write(folder: Path, names: list[str]) -> Path:
    """One row per case that has an answer."""
    arrow, parquet = need("pyarrow"), need("pyarrow.parquet")
    answers = read(folder)
    target = folder / TABLE
    table = arrow.Table.from_pylist([_row(answers[name]) for name in names if name in answers], schema=_schema(arrow))
    with atomic_path(target) as temporary:
        parquet.write_table(table, temporary)
    return target


def _schema(arrow: Any) -> Any:
    text, number = arrow.string(), arrow.float64()
    return arrow.schema({"case": text, "engine": text, "commit": text, "date": text, "machine": text, "elapsed_s": number, "cpu_s": number,
                         "error": text, "verdict": text, "p_none": number, "p_other": number, "best": arrow.list_(text), "p_best": number,
                         "named": arrow.list_(text), "place": text, "shrink": number, "diagnosis": text})


def _row(answer: dict[str, Any]) -> dict[str, Any]:
    found = answer.get("diagnosis")
    row = {key: answer.get(key) for key in ("case", "engine", "commit", "date", "machine", "elapsed_s", "cpu_s", "error")}
    if found is None:
        return row
    probability = {tuple(one["ids"]): one["probability"] for one in found["hypotheses"]}
    best = max(probability, key=probability.__getitem__)
    place = max(found["where"], key=lambda one: one["share"])["stage"] if found["where"] else None
    return {**row, "verdict": found["verdict"], "p_none": probability.get(("none",)), "p_other": probability.get(("other",)), "best": list(best),
            "p_best": probability[best], "named": [one["id"] for one in found["effects"]], "place": place,
            "shrink": found["shrink"]["all"]["fraction"], "diagnosis": json.dumps(found)}

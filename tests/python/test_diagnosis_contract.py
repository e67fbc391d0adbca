"""The diagnosis JSON: the table of effects against the records in sim/effects, and what validation refuses."""

import json
import re

import pytest
from pydantic import ValidationError

from wineglass.diagnosis.contract import Diagnosis, Parameter
from wineglass.diagnosis.vocabulary import COMPONENTS, EFFECTS, STAGES, VERDICTS
from wineglass.paths import repository_root


def valid():
    return {
        "verdict": "attributed", "sentence": "s",
        "where": [{"stage": "coupling", "channel": "rate", "component": "in_phase", "share": 1.0, "size": 1.0, "unit": "rad/s", "ratio_over_floor": 5.0,
                   "region": {"variable": "time", "from": 0.0, "to": 1.0, "unit": "s"}}],
        "hypotheses": [{"ids": ["ageing"], "probability": 0.9}, {"ids": ["none"], "probability": 0.06}, {"ids": ["other"], "probability": 0.04}],
        "effects": [{"id": "ageing", "stage": "coupling", "confidence": 0.9, "share": 1.0,
                     "parameters": [{"name": "linear", "value": 1.0, "interval": [0.5, 1.5], "unit": "rad/s/h"}]}],
        "alternatives": [],
        "shrink": {"channels": [{"channel": "rate", "before": 2.0, "after": 1.0, "floor": 0.5, "unit": "rad/s", "fraction": 0.5, "interval": [0.4, 0.6]}],
                   "all": {"before": 4.0, "after": 2.0, "floor": 1.0, "fraction": 0.5, "interval": [0.4, 0.6]}, "held_out": "h", "computed_by": "c"},
        "next_experiment": None, "notes": [], "provenance": {"program": "p", "engine": "e", "recording": "r", "sha256": "0"},
    }


def test_a_valid_one_survives_json():
    text = Diagnosis(**valid()).to_json()
    again = Diagnosis(**json.loads(text))
    assert again.to_json() == text
    assert json.loads(text)["where"][0]["region"]["from"] == 0.0


def change(path, value):
    data = valid()
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return data


@pytest.mark.parametrize("path, value", [
    (("verdict",), "maybe"),
    (("hypotheses", 0, "probability"), 0.95),
    (("hypotheses", 0, "ids"), ["gremlins"]),
    (("hypotheses", 1, "ids"), ["none", "ageing"]),
    (("hypotheses", 1, "ids"), ["other"]),
    (("hypotheses", 1, "ids"), ["flicker_noise"]),
    (("effects", 0, "confidence"), 0.5),
    (("effects", 0, "stage"), "pickoff"),
    (("effects", 0, "parameters", 0, "interval"), [2.0, 1.0]),
    (("effects", 0, "parameters", 0, "value"), float("nan")),
    (("where", 0, "component"), "sideways"),
    (("where", 0, "share"), 1.2),
    (("effects",), []),
    (("verdict",), "no_gap"),
    (("verdict",), "ambiguous"),
    (("extra",), 1),
])
def test_what_breaks_the_contract_is_refused(path, value):
    with pytest.raises(ValidationError):
        Diagnosis(**change(path, value))


def test_stages_and_effects_agree_with_the_catalogue_in_c():
    """Every record under sim/effects stands in the table, with the same stage."""
    records = 0
    for path in (repository_root() / "sim/effects").glob("*.c"):
        text = path.read_text(encoding="utf-8")
        name, stage = re.search(r'\.id = "(\w+)"', text), re.search(r"\.stage = EFFECT_STAGE_(\w+)", text)
        if name and stage:
            records += 1
            assert EFFECTS[name.group(1)].stage == stage.group(1).lower(), path.name
    assert records >= 20


def test_the_vocabulary_is_complete():
    assert len(EFFECTS) == 33 and len(STAGES) == 9 and len(VERDICTS) == 5
    assert {e.stage for e in EFFECTS.values()} == set(STAGES)
    assert {e.component for e in EFFECTS.values()} <= set(COMPONENTS)


@pytest.mark.parametrize("value, low, high, text", [
    (1.0, 0.5, 1.5, "1 [0.5, 1.5]"), (1.00000012e-6, 0.99999912e-6, 1.00000112e-6, "1.0000001e-06 [9.9999912e-07, 1.0000011e-06]"), (-3.21, -3.22, -3.2, "-3.21 [-3.22, -3.2]"),
    (0.0, 0.0, 0.0, "0 [0, 0]"), (1e-9, -1.0, 1.0, "1e-09 [-1, 1]"),
])
def test_a_number_has_the_digits_of_its_interval(value, low, high, text):
    assert Parameter(name="a", value=value, interval=(low, high), unit="s").text == text

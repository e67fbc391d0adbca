"""Noise, lines, events and raw codes on recordings of the independent generator, in forms that the twin does not have; no slow channel is looked at."""

import pytest

from wineglass.blind import generator, setting
from wineglass.diagnosis import noise_level
from wineglass.recording import Recording

SEED = 71


def found_in(path, effect_id=None, variant=None, factor=1.0, protocol="operating", loop="open", **more):
    effects = ()
    if effect_id is not None:
        effects = (generator.Applied(effect_id, variant, factor * generator.find(effect_id, variant).typical),)
    case = setting.case(protocol, loop=loop, seed=SEED, effects=effects, another_unit=True, **more)
    generator.make(case, path, setting.calibration_block(case))
    with Recording.open(path) as recording:
        return noise_level.examine(recording)


@pytest.mark.parametrize("more", [{}, {"noise_factor": 2.0}, {"lost_fraction": 0.002}])
@pytest.mark.parametrize("loop", ["open", "rebalance"])
def test_another_unit_is_silent(tmp_path, loop, more):
    """Its slow noise is what the description grants; its converters are noisier than described by no more than the description's tolerance."""
    found = found_in(tmp_path / "x.h5", loop=loop, **more)
    assert found.named == []
    assert max(found.log_evidence.values()) < 4.0


@pytest.mark.parametrize(("effect_id", "variant", "factor", "protocol", "loop"), [
    ("interference", "near_carrier", 0.5, "thermal", "rebalance"), ("interference", "drifting", 1.7, "operating", "open"),
    ("vibration", "near_carrier", 1.7, "thermal", "open"), ("vibration", "rocking", 0.5, "operating", "rebalance"),
    ("clock_jitter", "periodic", 1.0, "operating", "open"), ("dropped_samples", "stale", 1.0, "operating", "rebalance"),
    ("excess_noise", "thermal", 1.7, "thermal", "rebalance"), ("excess_noise", "lost_bits", 1.0, "operating", "rebalance"),
    ("adc_nonlinearity", "sawtooth", 1.0, "operating", "open"), ("adc_nonlinearity", "step", 1.0, "operating", "rebalance"),
    ("adc_saturation", "soft", 1.0, "operating", "open"), ("flicker_noise", "flicker", 1.7, "operating", "open"),
])
def test_forms_that_the_catalogue_does_not_have_are_named_alone(tmp_path, effect_id, variant, factor, protocol, loop):
    found = found_in(tmp_path / "x.h5", effect_id, variant, factor, protocol, loop)
    assert found.named == [effect_id]
    own = found.log_evidence[frozenset({effect_id})]
    assert own > 6.0 + max(score for chosen, score in found.log_evidence.items() if effect_id not in chosen and "other" not in chosen)
    assert own > 2.0 + max(score for chosen, score in found.log_evidence.items() if effect_id not in chosen)


@pytest.mark.parametrize(("effect_id", "variant"), [("swept_rocking", "swept"), ("parametric_pumping", "at_twice")])
def test_lines_that_go_their_own_way_are_no_effect_of_the_catalogue(tmp_path, effect_id, variant):
    found = found_in(tmp_path / "x.h5", effect_id, variant, 1.0, "full", "open")
    assert found.named == ["other"]
    assert found.log_evidence[frozenset({"other"})] > 2.0 + max(score for chosen, score in found.log_evidence.items() if "other" not in chosen)

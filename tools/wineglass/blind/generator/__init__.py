"""The independent generator: recordings of a gyro whose physics was written a second time, for the blind check.

    from wineglass.blind import generator
    case = generator.Case(scenario, effects=(generator.Applied("thermometer_lag", "two_poles", 1.0),), another_unit=True)
    generator.make(case, "case.h5", calibration_block)
    generator.oracle(case, calibration_block).snr
    generator.scaled_to(case, calibration_block, snr=50.0)

It may use descriptions, scenarios, calibration blocks and the recording's writer, and the firmware through its C interface; nothing of the
digital twin and nothing of the diagnosis (tests/structure/test_generator_room.py)."""

from wineglass.blind.generator.case import Applied, Case, Made
from wineglass.blind.generator.effects import Variant, find, ids, variants
from wineglass.blind.generator.making import make, oracle, scaled_to
from wineglass.blind.generator.oracle import ChannelGrade, Grade, grade

__all__ = ["Applied", "Case", "ChannelGrade", "Grade", "Made", "Variant", "find", "grade", "ids", "make", "oracle", "scaled_to", "variants"]

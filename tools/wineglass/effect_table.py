"""[[effect]] tables of a device description: in which ways of the catalogue the gyro is known to differ from its nominal fields.

    [[effect]]
    id = "frequency_split"
    parameters = { split_hz = 0.05 }

Both twins switch them on. The nominal calibration does not know of them: a description with such a table is that of a gyro that differs from what
it was calibrated for, as a diagnosis finds it. Fields of the description itself are what the calibration is made from.
"""

from __future__ import annotations

from pydantic import Field

from wineglass.effects import Setting
from wineglass.fields import Section, quantity


class EffectTable(Section):
    """One effect of the catalogue; parameters that are left out have their usual value."""

    id: str = quantity(..., "", "of the catalogue", pattern=r"^[a-z0-9_]+$")
    parameters: dict[str, float] = Field(default_factory=dict, description="by name, in the catalogue's units", json_schema_extra={"unit": ""})

    @property
    def setting(self) -> Setting:
        return Setting(self.id, dict(self.parameters))


def table(setting: Setting) -> EffectTable:
    return EffectTable(id=setting.id, parameters=setting.values)

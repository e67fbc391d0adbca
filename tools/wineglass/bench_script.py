"""What is sent to a device during a bench day, and when: a protocol's commands and bursts as a file that `record --script` plays.

Times are in s of the device's clock since the recording's first sample. Chamber and rate table follow their own programs; the segments are in
the script so that the recording has their names."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pydantic import BaseModel

from wineglass import toml_text
from wineglass.errors import BadInput
from wineglass.fields import Section, quantity, validate
from wineglass.scenario import Burst, Run, Segment
from wineglass.schedule import AnyCommand, Command, CompensationCommand, LoopCommand, OutputFilterCommand, SyncPulse


class Script(Section):
    """Everything that the device is asked for."""

    name: str = quantity("", "", "what it is called")
    device: str = quantity(..., "", "description for which it was made: name of a shipped device, or path of one")
    duration_s: float = quantity(..., "s", "length of the recording", gt=0)
    baseband_hz: float = quantity(50.0, "Hz", "rate of baseband frames", ge=0)
    output_hz: float = quantity(50.0, "Hz", "rate of output frames", ge=0)
    segment: list[Segment] = quantity([], "", "named stretches")
    command: list[AnyCommand] = quantity([], "", "commands, with their times")
    burst: list[Burst] = quantity([], "", "raw bursts, with their times")

    def items(self) -> list[Command | Burst]:
        """Commands and bursts in the order of their times."""
        return sorted([*self.command, *self.burst], key=time_of)

    def to_toml(self, comment: str = "") -> str:
        """One item a line."""
        lines = [f"# {line}" for line in comment.splitlines()]
        lines += [f"{name} = {toml_text.value(getattr(self, name))}" for name in ("name", "device", "duration_s", "baseband_hz", "output_hz")]
        for name in ("segment", "command", "burst"):
            lines += ["", *_listed(name, getattr(self, name))]
        return "\n".join(lines) + "\n"


def time_of(item: Command | Burst) -> float:
    return item.time_s if isinstance(item, Burst) else item.at_s


def of(run: Run) -> Script:
    """The script of a scenario; how the firmware runs is set first."""
    scenario = run.scenario
    mode = [OutputFilterCommand(at_s=0.0, corner=run.output_filter), CompensationCommand(at_s=0.0, mode=scenario.mode.compensation),
            LoopCommand(at_s=0.0, mode=scenario.mode.loop)]
    commands = [command for command in scenario.command if not isinstance(command, SyncPulse)]
    return Script(name=scenario.name, device=scenario.device, duration_s=scenario.duration_s, baseband_hz=scenario.recording.baseband_hz,
                  output_hz=scenario.recording.output_hz, segment=scenario.segment, command=[*mode, *commands], burst=scenario.recording.bursts)


def load(path: Path) -> Script:
    """A script from its file; BadInput names what is wrong."""
    script: Script = validate(Script, toml_text.read(path), str(path))
    late = [time for time in map(time_of, script.items()) if time >= script.duration_s]
    if late:
        raise BadInput(f"something at {late[0]:g} s comes after the end at {script.duration_s:g} s", str(path), "make duration_s longer")
    return script


def _listed(name: str, items: Iterable[BaseModel]) -> list[str]:
    return [f"{name} = [", *(f"    {toml_text.value(item.model_dump(mode='json', exclude_none=True))}," for item in items), "]"]

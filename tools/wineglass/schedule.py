"""What a scenario asks of the device while it runs: `[[command]]` tables with a time, a kind and the kind's own fields."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from wineglass import phases_order
from wineglass.commands_wire import CommandEncoder
from wineglass.fields import Section, quantity

if TYPE_CHECKING:
    from wineglass.device import Device


class Command(Section):
    """One command. `encode` gives its bytes."""

    kind: str
    at_s: float = quantity(..., "s", "when it is sent", ge=0)

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        raise NotImplementedError

    def note(self) -> str:
        """How the recording's event names it."""
        fields = self.model_dump(exclude={"kind", "at_s"})
        return " ".join([self.kind, *(f"{name}={value}" for name, value in fields.items())])


class LoopCommand(Command):
    kind: Literal["loop"] = "loop"
    mode: Literal["open", "rebalance"] = quantity(..., "", "open loop or force-to-rebalance from now on")

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return encoder.loop(self.mode)


class CompensationCommand(Command):
    kind: Literal["compensation"] = "compensation"
    mode: Literal["none", "static", "g2"] = quantity(..., "", "bias compensation from now on")

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return encoder.compensation(self.mode)


class AmplitudeCommand(Command):
    kind: Literal["amplitude"] = "amplitude"
    set_point_fs: float = quantity(..., "FS", "amplitude of the primary", ge=1 / 32, le=0.98)

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return encoder.amplitude(self.set_point_fs)


class TestSignalCommand(Command):
    """A force on the secondary axis: a constant, or a tone about the carrier; both zero: off."""

    __test__ = False  # no test class, whatever its name begins with

    kind: Literal["test_signal"] = "test_signal"
    in_phase_fs: float = quantity(0.0, "FS", "part that acts like a rate, of rebalance DAC full scale", ge=-0.9999, le=0.9999)
    quadrature_fs: float = quantity(0.0, "FS", "part that acts like quadrature", ge=-0.9999, le=0.9999)
    frequency_hz: float = quantity(0.0, "Hz", "of the tone; 0: a constant", ge=0)

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return encoder.test_signal(self.in_phase_fs, self.quadrature_fs, self.frequency_hz, _loop_rate_hz(device))


class DriveCommand(Command):
    """Off: no force, the shell rings down while the phase loop follows; on: the amplitude loop goes on where it stopped."""

    kind: Literal["drive"] = "drive"
    on: bool = quantity(..., "", "drive force on the primary")

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return encoder.drive(self.on)


class PhaseSetPointCommand(Command):
    kind: Literal["phase_set_point"] = "phase_set_point"
    phase_deg: float = quantity(..., "deg", "by which the drive loop holds the shell off resonance", ge=-45, le=45)

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return encoder.phase_set_point(self.phase_deg)


class RebalanceCommand(Command):
    kind: Literal["rebalance"] = "rebalance"
    kp: float = quantity(..., "FS/FS", "force per amplitude", gt=0)
    ki_per_s: float = quantity(..., "FS/FS/s", "integral", ge=0)
    in_phase_limit_fs: float = quantity(0.9, "FS", "largest in-phase force", gt=0, le=0.9999)
    quadrature_limit_fs: float = quantity(0.43, "FS", "largest quadrature force", ge=0, le=0.9999)

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return encoder.rebalance(self.kp, self.ki_per_s, _loop_rate_hz(device), self.in_phase_limit_fs, self.quadrature_limit_fs)


class OutputFilterCommand(Command):
    kind: Literal["output_filter"] = "output_filter"
    corner: Literal["none", "0.01", "0.025", "0.05", "0.1"] = quantity(..., "", "corner, of the slow tick's rate")

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return encoder.output_filter(self.corner)


class RestartCommand(Command):
    kind: Literal["restart"] = "restart"

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return encoder.restart()


class PhaseCalibrationCommand(Command):
    """Times follow the device; the rate is invalid until the sequence is over."""

    kind: Literal["phase_calibration"] = "phase_calibration"
    drive: bool = quantity(True, "", "find the drive phase")
    demodulation: bool = quantity(True, "", "find the demodulation phase")
    apply: bool = quantity(False, "", "what is found stays in force")

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        order = phases_order.order_for(device, drive=self.drive, demodulation=self.demodulation, apply=self.apply)
        return encoder.phase_calibration(order, device.slow_rate_hz)


class SyncPulse(Command):
    """A pulse at the synchronisation input, no command; the device answers with a sync frame."""

    kind: Literal["sync"] = "sync"
    since_sample: float = quantity(0.0, "sample", "time from the last sample to the pulse", ge=0, lt=1)

    def encode(self, encoder: CommandEncoder, device: Device) -> bytes:
        return b""


AnyCommand = Annotated[
    LoopCommand | CompensationCommand | AmplitudeCommand | TestSignalCommand | PhaseSetPointCommand | RebalanceCommand | OutputFilterCommand
    | DriveCommand | RestartCommand | PhaseCalibrationCommand | SyncPulse,
    Field(discriminator="kind"),
]


def _loop_rate_hz(device: Any) -> float:
    return device.electronics.sample_rate_hz / device.firmware.decimation

"""How long the steps of a phase calibration must last on a device."""

from __future__ import annotations

import math
from typing import Any

from wineglass.commands_wire import PhaseOrder
from wineglass.device import Device


def order_for(device: Device, **changes: Any) -> PhaseOrder:
    """Times that suit a device: the amplitude loop settles as a double pole at half its bandwidth, the open secondary with its decay rate. A
    demodulation phase can only be found where the secondary is usable open loop: the split is no more than its half bandwidth."""
    resonator = device.resonator
    decay = float(resonator.secondary_decay_rate_at(resonator.reference_temperature_degc))
    order = {"settle_drive_s": 6.0 / device.firmware.agc_bandwidth_hz, "settle_demodulation_s": 10.0 / decay,
             "demodulation": math.pi * resonator.split_hz <= decay}
    return PhaseOrder(**(order | changes))


def duration_s(order: PhaseOrder) -> float:
    """How long the sequence takes at most."""
    drive = 4 * (order.settle_drive_s + order.measure_s) if order.drive else 0.0
    demodulation = 4 * (order.settle_demodulation_s + order.measure_s) if order.demodulation else 0.0
    return drive + demodulation + max(order.settle_drive_s, order.settle_demodulation_s)

"""One scenario through both twins, command by command, as arrays that can be subtracted: what the tests of the envelope twin are made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wineglass import scenario
from wineglass.calibration_block import Calibration, from_binary, to_binary
from wineglass.commands_wire import CommandEncoder
from wineglass.effects import Setting
from wineglass.envelope import Envelope, Event
from wineglass.scenario import Run
from wineglass.telemetry import Conversion, Decoder, Identity, conversions, si
from wineglass.twin import Twin, block_for

IDEAL = {"electronics.adc.bits": 32, "electronics.adc.snr_db": 0.0, "electronics.thermometer.lsb_degc": 2.0**-16,
         "electronics.thermometer.noise_degc": 0.0}
"""No noise and no quantiser before the firmware: what is left between the twins is the envelope's own error."""

CHANNELS = ("primary_in_phase", "primary_quadrature", "secondary_in_phase", "secondary_quadrature", "drive_frequency", "drive_level",
            "rebalance_in_phase", "rebalance_quadrature", "temperature_measured", "rate", "rate_uncompensated", "quadrature")

Series = dict[str, np.ndarray]


@dataclass(frozen=True)
class Case:
    """A run of both twins: a scenario, commands, and effects."""

    run: Run
    block: bytes
    events: tuple[Event, ...] = ()
    effects: tuple[Setting, ...] = ()
    frame_ticks: int = 20


def rebalance_calibration(run: Run, bandwidth_hz: float = 100.0) -> Calibration:
    """The nominal calibration with a rebalance loop of its own: PI with its zero at a tenth of the bandwidth."""
    calibration = from_binary(block_for(run))
    device = run.device
    half_angle = math.pi * device.resonator.frequency_hz / device.electronics.sample_rate_hz
    held = math.sin(half_angle) / half_angle
    push = device.holding_acceleration_fs_s2 * device.electronics.dac.rebalance_reach * held / (4.0 * math.pi * device.resonator.frequency_hz)
    kp = 2.0 * math.pi * bandwidth_hz / push
    return calibration.with_changes(
        rebalance_kp=kp, rebalance_ki_per_s=kp * 2.0 * math.pi * bandwidth_hz / 10.0, rebalance_in_phase_limit_fs=0.95,
        rebalance_quadrature_limit_fs=0.3, rebalance_scale_rad_s_per_ratio=[2.0 * push / device.resonator.angular_gain], loop="rebalance")


def case(fields: dict, *, loop: str = "open", ideal: bool = True, events: tuple[Event, ...] = (), effects: tuple[Setting, ...] = (),
         frame_ticks: int = 20) -> Case:
    """A scenario from its fields; loop "rebalance" closes the loop after start-up."""
    override = {**(IDEAL if ideal else {}), **fields.pop("override", {})}
    run = scenario.prepare(scenario.parse({"override": override, **fields}, "case"))
    block = to_binary(rebalance_calibration(run)) if loop == "rebalance" else block_for(run)
    return Case(run, block, events, effects, frame_ticks)


def envelope(case: Case) -> Series:
    with Envelope(case.run, calibration_block=case.block, frame_ticks=case.frame_ticks, effects=case.effects) as twin:
        frames = twin.run(case.events)
        return {name: frames[name] for name in CHANNELS}


def full(case: Case) -> Series:
    """The sampled twin's telemetry, (n,) each, as many frames as are whole."""
    run, encoder, decoder = case.run, CommandEncoder(), Decoder()
    with Twin(run, calibration_block=case.block, effects=case.effects) as twin:
        twin.command(encoder.divisors(case.frame_ticks, case.frame_ticks))
        twin.poll()
        parts = [decoder.feed(twin.telemetry())]
        identity = Identity.of(parts[0].identity[0])
        for event in (*case.events, None):
            for _ in twin.chunks(run.n_blocks - twin.blocks_done if event is None
                                 else round(event.time_s * run.device.slow_rate_hz) - twin.blocks_done):
                parts.append(decoder.feed(twin.telemetry()))
            if event is not None:
                twin.command(_bytes(encoder, event, identity))
                twin.poll()
    table = conversions(identity)
    records = {tap: np.concatenate([getattr(part, tap) for part in parts]) for tap in ("baseband", "output")}
    table["output"]["quadrature"] = Conversion("quadrature", "rad/s", 2.0**-28)
    return {name: si(records[tap], table[tap][name]) for name in CHANNELS for tap in ("baseband", "output") if name in table[tap]}


def _bytes(encoder: CommandEncoder, event: Event, identity: Identity) -> bytes:
    loop_rate_hz = identity.sample_rate_hz / identity.decimation
    values = event.values
    if event.command == "test_signal":
        return encoder.test_signal(*values, loop_rate_hz)
    if event.command == "phase_set_point":
        return encoder.phase_set_point(math.degrees(values[0]))
    if event.command == "agc_gains":
        return encoder.agc_gains(*values, loop_rate_hz)
    if event.command == "pll_gains":
        return encoder.pll_gains(*values, identity.sample_rate_hz, identity.decimation)
    if event.command == "rebalance":
        return encoder.rebalance(values[0], values[1], loop_rate_hz, *values[2:])
    return getattr(encoder, event.command)(*values)


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def both(case: Case, start_s: float = 0.0) -> tuple[Series, Series]:
    """Envelope and full twin over the frames that both have, from start_s on."""
    fast, slow = envelope(case), full(case)
    first = round(start_s * case.run.device.slow_rate_hz / case.frame_ticks)
    n = min(len(fast["rate"]), len(slow["rate"]))
    return {name: fast[name][first:n] for name in CHANNELS}, {name: slow[name][first:n] for name in CHANNELS}

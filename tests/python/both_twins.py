"""One scenario through both twins, as arrays that can be subtracted: what the tests of the envelope twin are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wineglass import scenario
from wineglass.commands_wire import CommandEncoder
from wineglass.effects import Setting
from wineglass.envelope import Envelope
from wineglass.scenario import Run
from wineglass.telemetry import Decoder, Identity, conversions, si
from wineglass.twin import Twin

IDEAL = {"electronics.adc.bits": 32, "electronics.adc.snr_db": 0.0, "electronics.thermometer.lsb_degc": 2.0**-16,
         "electronics.thermometer.noise_degc": 0.0}
"""No noise and no quantiser before the firmware: what is left between the twins is the envelope's own error."""

CHANNELS = ("primary_in_phase", "primary_quadrature", "secondary_in_phase", "secondary_quadrature", "drive_frequency", "drive_level",
            "rebalance_in_phase", "rebalance_quadrature", "temperature_measured", "rate", "rate_uncompensated", "quadrature")

Series = dict[str, np.ndarray]


@dataclass(frozen=True)
class Case:
    """A scenario for both twins, with effects, in frames of so many slow ticks."""

    run: Run
    effects: tuple[Setting, ...] = ()
    frame_ticks: int = 20

    @property
    def frame_s(self) -> float:
        return self.frame_ticks / self.run.device.slow_rate_hz


def case(fields: dict, effects: Sequence[Setting] = (), frame_ticks: int = 20) -> Case:
    """A scenario from its fields, with ideal converters."""
    override = {**IDEAL, **fields.get("override", {})}
    return Case(scenario.prepare(scenario.parse({**fields, "override": override}, "case")), tuple(effects), frame_ticks)


def envelope(case: Case) -> Series:
    with Envelope(case.run, frame_ticks=case.frame_ticks, effects=case.effects) as twin:
        frames = twin.run()
    return {name: frames[name] for name in CHANNELS}


def full(case: Case) -> Series:
    """The sampled twin's telemetry, (n,) each, as many frames as are whole."""
    run, encoder, decoder = case.run, CommandEncoder(), Decoder()
    with Twin(run, effects=case.effects) as twin:
        twin.command(encoder.divisors(case.frame_ticks, case.frame_ticks))
        twin.poll()
        parts = [decoder.feed(twin.telemetry())]
        for command in sorted(run.scenario.command, key=lambda command: command.at_s):
            parts += _stretch(twin, decoder, round(command.at_s * run.device.slow_rate_hz))
            twin.command(command.encode(encoder, run.device))
            twin.poll()
        parts += _stretch(twin, decoder, run.n_blocks)
    table = conversions(Identity.of(parts[0].identity[0]))
    records = {tap: np.concatenate([getattr(part, tap) for part in parts]) for tap in ("baseband", "output")}
    return {name: si(records[tap], table[tap][name]) for name in CHANNELS for tap in ("baseband", "output") if name in table[tap]}


def _stretch(twin: Twin, decoder: Decoder, to_block: int) -> list:
    return [decoder.feed(twin.telemetry()) for _ in twin.chunks(to_block - twin.blocks_done)]


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def both(case: Case, start_s: float = 0.0) -> tuple[Series, Series]:
    """Envelope and full twin over the frames that both have, from start_s on."""
    fast, slow = envelope(case), full(case)
    first = round(start_s / case.frame_s)
    n = min(len(fast["rate"]), len(slow["rate"]))
    return {name: fast[name][first:n] for name in CHANNELS}, {name: slow[name][first:n] for name in CHANNELS}

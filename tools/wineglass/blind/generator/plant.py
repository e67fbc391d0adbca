"""The C plant from Python: a World, stepped block by block, with the firmware's telemetry and commands."""

from __future__ import annotations

from types import TracebackType
from typing import Any

import numpy as np

from wineglass.blind.generator.native import PLACES, QUANTITIES, TROUBLES, ffi, library, pointer
from wineglass.blind.generator.world import World
from wineglass.errors import BadInput

_TELEMETRY_CHUNK = 1 << 20
SERIAL = 1


class Plant:
    """One unit with its electronics, powered up."""

    def __init__(self, world: World, calibration: bytes):
        self.world = world
        self._keep: list[Any] = []
        self._columns = self._prepared(world.columns())
        self._thermometer = world.thermometer_codes()
        self.blocks_done = 0
        self._exam = library().exam_create(self._configuration(), ffi.from_buffer(calibration), len(calibration))
        if self._exam == ffi.NULL:
            raise BadInput("the firmware refuses the calibration", f"device {world.described.name}", "give a block made for this device")
        self._device = library().exam_device(self._exam)

    def run(self, n_blocks: int, *, state: bool = False, codes: bool = False) -> tuple[np.ndarray | None, np.ndarray | None]:
        """The next blocks. state: (n, 4) x1, x1'/w, x2, x2'/w at each block's end [FS]; codes: (n block_samples, 4) ADC 1, 2, DAC 1, 2."""
        states = np.empty((n_blocks, 4)) if state else None
        samples = n_blocks * self.world.described.block_samples
        written = np.empty((samples, 4), np.int32) if codes else None
        record = ffi.new("struct exam_record *", [ffi.NULL if states is None else pointer(states, "double"),
                                                  ffi.NULL if written is None else pointer(written, "int32_t")])
        first = self.blocks_done
        library().exam_run(self._exam, n_blocks, self._from(first), pointer(self._thermometer[first:first + n_blocks], "int32_t"), record)
        self.blocks_done += n_blocks
        return states, written

    def telemetry(self) -> bytes:
        """Bytes the device has sent since the last call."""
        parts = []
        while pending := int(library().wg_device_telemetry_pending(self._device)):
            buffer = ffi.new("uint8_t[]", min(pending, _TELEMETRY_CHUNK))
            count = library().wg_device_telemetry_read(self._device, buffer, len(buffer))
            parts.append(bytes(ffi.buffer(buffer, count)))
        return b"".join(parts)

    def command(self, message: bytes) -> None:
        """Bytes for the device, executed before the next sample."""
        if library().wg_device_command_write(self._device, message, len(message)) != 0:
            raise MemoryError("no room for the command")

    def poll(self) -> None:
        library().wg_device_poll(self._device)

    def sync(self, since_sample: float) -> None:
        library().wg_device_sync(self._device, round(since_sample * 65536))

    @property
    def clipped(self) -> int:
        return int(library().exam_clipped(self._exam))

    def close(self) -> None:
        if self._exam != ffi.NULL:
            library().exam_destroy(self._exam)
            self._exam = self._device = ffi.NULL

    def __enter__(self) -> Plant:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    # --- what the C side gets ----------------------------------------------------------------------------------------

    def _prepared(self, columns: dict[str, Any]) -> list[np.ndarray]:
        """One array for each quantity: a single number where it is constant."""
        unknown = set(columns) - set(QUANTITIES)
        if unknown:
            raise ValueError(f"no such quantity: {', '.join(sorted(unknown))}")
        edges = self.world.edges
        found = []
        for name in QUANTITIES:
            values = np.ascontiguousarray(np.atleast_1d(np.asarray(columns.get(name, 0.0), np.float64)))
            if len(values) not in (1, edges):
                raise ValueError(f"{name}: {len(values)} values, not {edges}")
            found.append(values)
        return found

    def _from(self, first: int) -> Any:
        rows = [(pointer(values[first:] if len(values) > 1 else values, "double"), 1 if len(values) > 1 else 0) for values in self._columns]
        return ffi.new("struct exam_column[]", rows)

    def _configuration(self) -> Any:
        world, described = self.world, self.world.described
        electronics = described.electronics
        cfg = ffi.new("struct exam_cfg *")
        cfg.sample_rate_hz, cfg.carrier_hz = electronics.sample_rate_hz, described.resonator.frequency_hz
        cfg.block_samples = described.block_samples
        cfg.adc_bits, cfg.dac_bits = electronics.adc.bits, electronics.dac.bits
        cfg.dac_latency_samples = electronics.dac.latency_samples
        cfg.serial, cfg.seed = SERIAL, world.seed if world.noise_seed is None else world.noise_seed
        cfg.amplitude_power, cfg.jitter_memory = world.amplitude_power, world.jitter_memory
        cfg.quantum[0:2] = world.quantum
        for index, tone in enumerate(world.tones):
            cfg.tone_place[index], cfg.tone_phase_rad[index] = PLACES[tone.place], tone.phase_rad
        self._curves(cfg)
        self._events(cfg)
        return cfg

    def _curves(self, cfg: Any) -> None:
        for target, curves in ((cfg.adc_error, self.world.adc_error), (cfg.dac_error, self.world.dac_error)):
            for channel, curve in enumerate(curves):
                if curve is not None:
                    values = np.ascontiguousarray(curve, np.float64)
                    self._keep.append(values)
                    cfg.curve_count = len(values)
                    target[channel] = pointer(values, "double")

    def _events(self, cfg: Any) -> None:
        troubles = sorted(self.world.troubles, key=lambda trouble: trouble.sample)
        events = ffi.new("struct exam_event[]", [(trouble.sample, TROUBLES[trouble.kind], trouble.count) for trouble in troubles])
        self._keep.append(events)
        cfg.events, cfg.event_count = events, len(troubles)

"""The digital twin from Python: a described device in a scenario, stepped block by block, with its telemetry, commands and truth.

    run = scenario.prepare(scenario.load("cold-start"))
    with Twin(run) as twin:
        records = twin.step(1000)          # one second
        bytes_ = twin.telemetry()
        print(twin.truth().resonance_hz)
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np

from wineglass import effects as catalogue
from wineglass import nominal
from wineglass.calibration_block import Calibration, to_binary
from wineglass.device import Device
from wineglass.effects import Setting
from wineglass.errors import BadInput
from wineglass.native import ffi, library, pointer
from wineglass.scenario import Run

CHUNK_BLOCKS = 2000
_TELEMETRY_CHUNK = 1 << 20

_DEVICE = -6  # the firmware refused its configuration; it can say why
_ERRORS = {
    -1: ("not enough memory", "close other programs"),
    -2: ("the sample rate does not suit the resonance", "check electronics.sample_rate_hz"),
    -3: ("the resonator cannot exist", "check the device's section resonator"),
    -4: ("the temperatures cannot be simulated", "check the device's sections thermal and electronics.thermometer"),
    -5: ("the converters cannot be simulated", "check the device's section electronics"),
    -7: ("the profile asks for what the shell cannot be: a temperature at which its damping turns negative, or a number that is none",
         "check the scenario's temperature and rate"),
    -8: ("the effects cannot be simulated", "check their parameters, and switch on fewer at a time"),
    -9: ("the forces stand at their limits for longer than the run allows", "ask for less rate or amplitude, or allow more single ticks"),
    -10: ("a mode rings without bound: its loop chases what the converter cannot show, or the modes are coupled too strongly for slow ticks",
          "use smaller effects, or the sampled twin"),
}


@dataclass(frozen=True)
class Block:
    """What happened in a stretch of blocks, one value per block, at its end; arrays (n,) float64.

    codes: (n block_samples, 4) int32, ADC primary and secondary, DAC drive and rebalance; None unless asked for
    """

    first_block: int
    true_rate_rad_s: np.ndarray
    chamber_degc: np.ndarray
    shell_degc: np.ndarray
    thermometer_degc: np.ndarray
    primary: np.ndarray | None
    """true complex amplitude [FS] of the primary against the device's oscillator; None unless asked for"""
    secondary: np.ndarray | None
    codes: np.ndarray | None


@dataclass(frozen=True)
class Truth:
    """The plant's true state at the last sample, which the firmware does not know."""

    time_s: float
    shell_degc: float
    resonance_hz: float
    primary_frequency_hz: float
    quality_factor: float
    bias_rad_s: float
    oscillator_hz: float
    primary_amplitude: float
    primary_phase_rad: float
    secondary_i: float
    secondary_q: float
    samples: int
    adc_saturations: int
    dac_saturations: int


class Twin:
    """Plant and firmware in one loop. State continues from call to call; splitting a run into calls changes nothing."""

    def __init__(self, run: Run, *, calibration_block: bytes | None = None, seed: int | None = None,
                 effects: Iterable[Setting] = (), amplitudes: bool = False, codes: bool = False):
        """calibration_block: None takes the one the scenario asks for. effects: beside those of the device. amplitudes, codes: also return them in
        every Block."""
        self.run = run
        self.seed = run.scenario.seed if seed is None else seed
        self.calibration_block = block_for(run) if calibration_block is None else calibration_block
        self._amplitudes, self._codes = amplitudes, codes
        self._block = 0
        error = ffi.new("int32_t *")
        block = self.calibration_block
        cfg = configuration(run, self.seed)
        self._twin = library().twin_create(cfg, ffi.from_buffer(block) if block else ffi.NULL, len(block), error)
        if self._twin == ffi.NULL:
            raise refusal(run, int(error[0]), block)
        self._device = library().twin_device(self._twin)
        self._switch_on([*run.truth.effects, *effects])

    def _switch_on(self, effects: list[Setting]) -> None:
        result = library().twin_set_effects(self._twin, catalogue.settings(effects), len(effects)) if effects else 0
        if result != 0:
            raise refusal(self.run, result, self.calibration_block)

    @property
    def blocks_done(self) -> int:
        return self._block

    @property
    def samples_done(self) -> int:
        return self._block * self.run.device.block_samples

    def step(self, n_blocks: int) -> Block:
        """The next blocks of the scenario."""
        rate, slope = self.run.rate_rad_s(self._block, n_blocks)
        temperature = self.run.temperature_degc(self._block, n_blocks)
        return self.step_with(rate, slope, temperature)

    def step_with(self, rate_rad_s: np.ndarray, slope_rad_s2: np.ndarray, temperature_degc: np.ndarray) -> Block:
        """The next blocks with other inputs than the scenario's: rate and its slope at each block's middle, temperature of the chamber (or
        the shell, if the scenario imposes it) at its end; (n,) each."""
        inputs = [np.ascontiguousarray(values, np.float64) for values in (rate_rad_s, slope_rad_s2, temperature_degc)]
        n = len(inputs[0])
        profile = ffi.new("struct twin_profile *", [n, *(pointer(values, "double") for values in inputs)])
        record = _Record(n, n * self.run.device.block_samples if self._codes else 0, self._amplitudes)
        result = library().twin_run(self._open(), profile, record.pointers())
        if result != 0:
            raise refusal(self.run, result, self.calibration_block)
        first, self._block = self._block, self._block + n
        return Block(first, inputs[0], inputs[2], record.shell, record.thermometer,
                     record.complex(0), record.complex(2), record.codes)

    def chunks(self, n_blocks: int | None = None) -> Iterator[Block]:
        """The rest of the scenario (or the next n_blocks) in pieces that fit into memory however long it is."""
        end = self.run.n_blocks if n_blocks is None else self._block + n_blocks
        while self._block < end:
            yield self.step(min(CHUNK_BLOCKS, end - self._block))

    def telemetry(self) -> bytes:
        """Bytes the device has sent since the last call."""
        parts = []
        while pending := int(library().wg_device_telemetry_pending(self._open_device())):
            buffer = ffi.new("uint8_t[]", min(pending, _TELEMETRY_CHUNK))
            count = library().wg_device_telemetry_read(self._device, buffer, len(buffer))
            parts.append(bytes(ffi.buffer(buffer, count)))
        return b"".join(parts)

    def command(self, message: bytes) -> None:
        """Bytes for the device, as over its wire."""
        if library().wg_device_command_write(self._open_device(), message, len(message)) != 0:
            raise MemoryError("no room for the command")

    def sync(self, since_sample: float = 0.0) -> None:
        """A synchronisation pulse, so many sample periods after the last sample."""
        library().wg_device_sync(self._open_device(), round(since_sample * 65536))

    def poll(self) -> None:
        """Let the firmware's background run once, e.g. so that a command counts from the next sample on."""
        library().wg_device_poll(self._open_device())

    def truth(self) -> Truth:
        truth = ffi.new("struct twin_truth *")
        library().twin_truth(self._open(), truth)
        return Truth(**{name: getattr(truth, name) for name in Truth.__dataclass_fields__})

    def signals(self) -> dict[str, int]:
        """What the firmware published last, as its own integers."""
        signals = ffi.new("struct wg_device_signals *")
        library().wg_device_get_signals(self._open_device(), signals)
        return {name: int(getattr(signals, name)) for name, _ in ffi.typeof("struct wg_device_signals").fields}

    def close(self) -> None:
        if self._twin != ffi.NULL:
            library().twin_destroy(self._twin)
            self._twin = self._device = ffi.NULL

    def __enter__(self) -> Twin:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __del__(self) -> None:
        if getattr(self, "_twin", ffi.NULL) != ffi.NULL:
            self.close()

    def _open(self) -> Any:
        if self._twin == ffi.NULL:
            raise ValueError("the twin is closed")
        return self._twin

    def _open_device(self) -> Any:
        self._open()
        return self._device


class _Record:
    """Arrays that the twin writes into."""

    def __init__(self, blocks: int, samples: int, amplitudes: bool):
        self.shell, self.thermometer = np.empty(blocks), np.empty(blocks)
        self.parts = [np.empty(blocks) if amplitudes else None for _ in range(4)]
        self.codes = np.empty((samples, 4), np.int32) if samples else None

    def pointers(self) -> Any:
        columns = (self.shell, self.thermometer, *self.parts)
        return ffi.new("struct twin_record *", [*(pointer(values, "double") for values in columns), pointer(self.codes, "int32_t")])

    def complex(self, first: int) -> np.ndarray | None:
        real, imaginary = self.parts[first], self.parts[first + 1]
        return None if real is None or imaginary is None else real + 1j * imaginary


def calibration_for(run: Run) -> Calibration | None:
    """The calibration that the scenario asks for; None: the firmware's own default."""
    choice = run.scenario.calibration
    if choice == "none":
        return None
    if choice in ("nominal", "zero_rate"):
        return nominal.calibration(run, zero_rate=choice == "zero_rate")
    return nominal.from_file(run, choice)


def block_for(run: Run) -> bytes:
    """The calibration block that the scenario asks for; empty: the firmware's own default."""
    calibration = calibration_for(run)
    return b"" if calibration is None else to_binary(calibration)


def refusal(run: Run, error: int, block: bytes) -> BadInput:
    """What an error of the library means."""
    if error == _DEVICE:
        return _device_refusal(run, block)
    what, todo = _ERRORS.get(error, (f"the twin failed with error {error}", "report this"))
    return BadInput(what, f"scenario {run.scenario.name or '(unnamed)'}", todo)


def _device_refusal(run: Run, block: bytes) -> BadInput:
    """Why the firmware does not take a calibration block."""
    electronics = run.truth.electronics
    cfg = ffi.new("struct wg_device_cfg *", [round(electronics.sample_rate_hz * 1000), electronics.adc.bits, electronics.dac.bits, 0, 1])
    reason = library().wg_calibration_check(cfg, ffi.from_buffer(block) if block else ffi.NULL, len(block))
    text = ffi.string(library().wg_reason_text(reason)).decode()
    return BadInput(f"the firmware refuses the calibration ({text})", f"calibration of scenario {run.scenario.name or '(unnamed)'}",
                    "use a calibration that was made for this device")


def configuration(run: Run, seed: int) -> Any:
    """struct twin_cfg of the simulated device."""
    device = run.truth
    cfg = ffi.new("struct twin_cfg *")
    cfg.sample_rate_hz = device.electronics.sample_rate_hz
    cfg.block_samples = device.block_samples
    cfg.serial = 1
    cfg.seed = seed
    _fill_resonator(cfg.resonator, run)
    _fill_thermal(cfg.thermal, run)
    _fill_electronics(cfg.electronics, device)
    return cfg


def resonator_cfg(run: Run) -> Any:
    """struct resonator_cfg of the simulated device, for the plant alone."""
    cfg = ffi.new("struct resonator_cfg *")
    _fill_resonator(cfg, run)
    return cfg


def _fill_resonator(cfg: Any, run: Run) -> None:
    resonator, dac = run.truth.resonator, run.truth.electronics.dac
    cfg.reference_degc = resonator.reference_temperature_degc
    cfg.frequency_hz = resonator.frequency_hz
    cfg.frequency_slope_ppm_per_degc = resonator.frequency_slope_ppm_per_degc
    cfg.frequency_curvature_ppm_per_degc2 = resonator.frequency_curvature_ppm_per_degc2
    cfg.quality_factor = resonator.q
    cfg.quality_slope_per_degc = resonator.q_slope_per_degc
    cfg.quality_knee_degc = resonator.q_knee_degc
    cfg.quality_slope_above_per_degc = resonator.q_slope_above_knee_per_degc
    cfg.decay_mismatch = resonator.damping_mismatch
    cfg.decay_axis_deg = resonator.damping_axis_deg
    cfg.split_hz = resonator.split_hz
    cfg.split_axis_deg = resonator.split_axis_deg
    cfg.quadrature_rad_s = resonator.quadrature_rad_s
    cfg.angular_gain = resonator.angular_gain
    cfg.bias_rad_s[0 : len(resonator.cross_damping_rad_s)] = resonator.cross_damping_rad_s
    holding = run.device.holding_acceleration_fs_s2  # electrodes are made for the described device
    cfg.drive_force_fs_s2 = holding * dac.drive_reach
    cfg.rebalance_force_fs_s2 = holding * dac.rebalance_reach


def _fill_thermal(cfg: Any, run: Run) -> None:
    thermal, thermometer = run.truth.thermal, run.truth.electronics.thermometer
    cfg.shell_imposed = run.scenario.temperature.acts_on == "shell"
    cfg.initial_degc = run.initial_degc
    cfg.shell_time_constant_s = thermal.shell_time_constant_s
    cfg.thermometer_lag_s = thermal.thermometer_lag_s
    cfg.thermometer_offset_degc = thermometer.zero_degc
    cfg.thermometer_lsb_degc = thermometer.lsb_degc
    cfg.thermometer_noise_degc = thermometer.noise_degc


def _fill_electronics(cfg: Any, device: Device) -> None:
    adc, dac = device.electronics.adc, device.electronics.dac
    cfg.adc_bits = adc.bits
    cfg.dac_bits = dac.bits
    cfg.adc_noise_rms_fs[0:2] = [adc.noise_fs_rms] * 2
    cfg.adc_offset_fs[0:2] = [adc.primary_offset_fs, adc.secondary_offset_fs]
    cfg.adc_delay_samples = adc.delay_samples
    cfg.adc_secondary_delay_samples = adc.secondary_delay_samples
    cfg.dac_latency_samples = dac.latency_samples

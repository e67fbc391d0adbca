"""Everything slow about one recording: the unit, the bench day, temperatures, and every parameter that the plant gets block by block.

Effects change the fields of a World; `columns` makes of them what the plant takes. Fields are numbers or arrays (n + 1,) at the blocks' edges."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wineglass.blind.generator import laws
from wineglass.device import Device
from wineglass.errors import BadInput
from wineglass.scenario import Scenario

TONE_NAMES = "abc"
LONGEST_BLOCKS = 4_000_000  # some 200 bytes each
COARSE_S = 0.1  # grid of what is slow even for temperatures
MOUNT_SHARE, RIM_SHARE = 3e-4, 1e-4  # of the shell's time constant: the mount before it, the rim behind the thermometer
ELECTRONICS_LAG = 3.0  # of the shell's time constant: board and converters follow the chamber
FLOOR_SHARE = 0.7  # of the described noise floors that this device has

Slow = Any
"""float or (n + 1,) array"""


@dataclass
class Tone:
    """place: a name of enum exam_place without its prefix; amplitude in the unit of the place"""

    place: str
    amplitude: Slow
    frequency_hz: Slow
    phase_rad: float = 0.0


@dataclass
class Trouble:
    """kind: lost, stale, doubled"""

    sample: int
    kind: str
    count: int = 1


@dataclass
class Bench:
    """What the bench's own instruments do to the reference tap."""

    rate_noise_rad_s: float = 2e-7
    rate_gain: float = 1.0 + 3e-6
    temperature_noise_degc: float = 1e-3
    rate_offset_rad_s: Slow = 0.0
    delay_s: float = 0.0


@dataclass
class World:
    """One unit on one bench day."""

    described: Device
    truth: Device
    scenario: Scenario
    seed: int
    noise_factor: float = 1.0
    noise_seed: int | None = None
    """of noise and described floors; None: `seed`"""
    paced: bool = False
    """table, chamber and shell go by the device's clock"""

    time_s: np.ndarray = field(init=False)
    chamber_degc: np.ndarray = field(init=False)
    mount_degc: np.ndarray = field(init=False)
    base_degc: np.ndarray = field(init=False)
    """where the thermometer sits"""
    shell_degc: np.ndarray = field(init=False)
    """where it vibrates"""
    electronics_degc: np.ndarray = field(init=False)
    table_rate_rad_s: np.ndarray = field(init=False)

    tones: list[Tone] = field(default_factory=list)
    troubles: list[Trouble] = field(default_factory=list)
    bench: Bench = field(default_factory=Bench)
    output_patches: list[Callable[[str, dict[str, np.ndarray], int], dict[str, np.ndarray]]] = field(default_factory=list)
    calibration_patches: list[Callable[[bytes], bytes]] = field(default_factory=list)
    adc_error: list[np.ndarray | None] = field(default_factory=lambda: [None, None])
    dac_error: list[np.ndarray | None] = field(default_factory=lambda: [None, None])
    quantum: list[int] = field(default_factory=lambda: [1, 1])
    amplitude_power: int = 2
    jitter_memory: float = 0.0

    def __post_init__(self) -> None:
        self.block_s = self.described.block_samples / self.described.electronics.sample_rate_hz
        self.n_blocks = max(1, round(self.scenario.duration_s * self.described.slow_rate_hz))
        if self.n_blocks > LONGEST_BLOCKS:
            raise BadInput(f"{self.scenario.duration_s:g} s are more than the generator holds in memory", f"scenario {self.scenario.name}",
                           f"stay below {LONGEST_BLOCKS * self.block_s:g} s: take a shorter day, or a device with a faster shell")
        self.sample_period_s: Slow = 1.0 / self.described.electronics.sample_rate_hz
        self.extra: dict[str, Slow] = {}
        """quantities of the plant by their own names, added to what the fields give"""
        self.set_clock(0.0)

    # --- time, table and chamber -------------------------------------------------------------------------------------

    @property
    def edges(self) -> int:
        return self.n_blocks + 1

    @property
    def duration_s(self) -> float:
        return self.n_blocks * self.block_s

    @property
    def part(self) -> np.ndarray:
        """Time as a part of the day, 0 .. 1."""
        return np.linspace(0.0, 1.0, self.edges)

    @property
    def shift(self) -> np.ndarray:
        """Shell temperature from T0 [degC]."""
        return self.shell_degc - self.truth.resonator.reference_temperature_degc

    def set_clock(self, relative: Slow) -> None:
        """The sampling period is longer by this part; the bench's own clock is right, so the whole day is seen at the true times. Comes before all
        that hangs on temperature or rate: it sets them anew."""
        nominal = 1.0 / self.described.electronics.sample_rate_hz
        self.sample_period_s = nominal * (1.0 + relative)
        nominal_times = np.arange(self.edges) * self.block_s
        late = np.zeros(self.edges)
        if np.any(relative):
            steps = np.broadcast_to(np.asarray(relative, float), (self.edges,))
            late[1:] = np.cumsum(0.5 * (steps[1:] + steps[:-1])) * self.block_s
        self.time_s = nominal_times if self.paced else nominal_times + late
        self.table_rate_rad_s = np.asarray(self.scenario.rate.at(self.time_s), float)
        self._set_temperatures()
        self._set_shell()
        self._set_electronics()
        self._set_thermometer()

    def _set_temperatures(self) -> None:
        """chamber -> mount -> base (thermometer) -> rim; the electronics on their own."""
        profile = np.asarray(self.scenario.temperature.at(self.time_s), float)
        shell_s, step = self.truth.thermal.shell_time_constant_s, float(self.time_s[-1] - self.time_s[0]) / self.n_blocks
        self.chamber_degc = profile
        if self.scenario.temperature.acts_on == "shell":
            self.mount_degc = self.base_degc = self.shell_degc = profile
        else:
            mount_s, rim_s = MOUNT_SHARE * shell_s, RIM_SHARE * shell_s
            self.mount_degc = laws.lag(profile, step, mount_s)
            self.base_degc = laws.lag(self.mount_degc, step, shell_s - mount_s - rim_s)
            self.shell_degc = laws.lag(self.base_degc, step, rim_s)
        self.electronics_degc = laws.lag(profile, step, ELECTRONICS_LAG * shell_s)

    # --- the unit as it truly is -------------------------------------------------------------------------------------

    def _set_shell(self) -> None:
        shell, floor, shift = self.truth.resonator, self.truth.noise_floor, self.shift
        ppm = shell.frequency_slope_ppm_per_degc * shift + shell.frequency_curvature_ppm_per_degc2 * shift**2
        ppm = ppm + self.floor("frequency", floor.frequency_ppm)
        self.frequency_hz: Slow = shell.frequency_hz * (1.0 + 1e-6 * ppm)
        knee = shell.q_knee_degc
        below = np.minimum(self.shell_degc, knee) - shell.reference_temperature_degc
        above = np.maximum(self.shell_degc - knee, 0.0)
        quality = shell.q * (1.0 + shell.q_slope_per_degc * below + shell.q_slope_above_knee_per_degc * above)
        decay = math.pi * self.frequency_hz / quality * (1.0 + self.floor("damping", floor.drive_level_relative))
        unequal = 0.5 * shell.damping_mismatch * math.cos(2.0 * math.radians(shell.damping_axis_deg))
        self.decay_1: Slow = decay * (1.0 + unequal)
        self.decay_2: Slow = decay * (1.0 - unequal)
        self.split_hz: Slow = shell.split_hz * np.exp(2j * math.radians(shell.split_axis_deg))
        """complex: real part raises mode 1 over mode 2, imaginary part couples them"""
        self.angular_gain: Slow = shell.angular_gain
        self.bias_rad_s: Slow = sum(c * shift**i for i, c in enumerate(shell.cross_damping_rad_s)) + self.floor(
            "bias", floor.rate_bias_instability_rad_s)
        self.bias_on_primary_rad_s: Slow = 0.0
        """what the damping of mode 2 on mode 1 has less than that of mode 1 on mode 2"""
        self.quadrature_rad_s: Slow = shell.quadrature_rad_s
        self.rate_error_rad_s: Slow = 0.0
        """true rate of the device that the table does not say"""
        self.stiffening: tuple[Slow, Slow] = (0.0, 0.0)
        self.thickening: tuple[Slow, Slow] = (0.0, 0.0)

    def _set_electronics(self) -> None:
        adc, dac = self.truth.electronics.adc, self.truth.electronics.dac
        described = self.described
        omega = 2.0 * math.pi * described.resonator.frequency_hz
        holding = described.firmware.amplitude_fs * omega**2 / described.resonator.q
        self.drive_force: Slow = holding * dac.drive_reach
        self.rebalance_force: Slow = holding * dac.rebalance_reach
        self.drive_angle_rad: Slow = 0.0
        self.rebalance_angle_rad: Slow = 0.0
        self.drive_delay_s: Slow = 0.0
        self.rebalance_delay_s: Slow = 0.0
        sample_s = 1.0 / described.electronics.sample_rate_hz
        self.pickoff_gain: list[Slow] = [1.0, 1.0]
        self.pickoff_delay_s: list[Slow] = [adc.delay_samples * sample_s, (adc.delay_samples + adc.secondary_delay_samples) * sample_s]
        noise = 0.0 if adc.snr_db == 0 else math.sqrt(0.5) * 10.0 ** (-adc.snr_db / 20.0) * self.noise_factor
        self.noise_fs: list[Slow] = [noise, noise]
        self.offset_fs: list[Slow] = [adc.primary_offset_fs, adc.secondary_offset_fs]

    def _set_thermometer(self) -> None:
        """thermometer_degc: what it senses, before noise and steps."""
        floor = FLOOR_SHARE * self.truth.noise_floor.temperature_degc
        self.thermometer_degc: np.ndarray = self.base_degc
        self.thermometer_noise_degc = self.truth.electronics.thermometer.noise_degc * self.noise_factor
        self.thermometer_wander_degc: np.ndarray = floor * self.coarsely(
            lambda t: laws.wander(self.noise("thermometer wander"), len(t), COARSE_S, 30.0))
        self.thermometer_steps_degc = 0.0
        self.thermometer_deadband_degc = 0.0

    # --- tools for laws ----------------------------------------------------------------------------------------------

    def random(self, purpose: str) -> np.random.Generator:
        """A generator of its own for each purpose, so that one thing drawn does not move another."""
        return self.random_for(self.seed, purpose)

    def noise(self, purpose: str) -> np.random.Generator:
        """The same for the noise that every device has."""
        return self.random_for(self.seed if self.noise_seed is None else self.noise_seed, purpose)

    @staticmethod
    def random_for(seed: int, purpose: str) -> np.random.Generator:
        return np.random.default_rng([seed, zlib.crc32(purpose.encode())])

    def coarsely(self, law: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """A law evaluated on a coarse grid of times, straight in between; (n + 1,)."""
        times = np.arange(0.0, self.duration_s + 2 * COARSE_S, COARSE_S)
        return np.interp(np.arange(self.edges) * self.block_s, times, law(times))

    def coarse(self, values: np.ndarray) -> np.ndarray:
        """A column on the coarse grid."""
        times = np.arange(0.0, self.duration_s + 2 * COARSE_S, COARSE_S)
        return np.interp(times, np.arange(self.edges) * self.block_s, values)

    def flicker(self, purpose: str, floor: float) -> Slow:
        return self._flicker(self.random(purpose), floor)

    def floor(self, purpose: str, described: float) -> Slow:
        """This device's part of a described floor."""
        return self._flicker(self.noise(purpose), FLOOR_SHARE * described)

    def _flicker(self, random: np.random.Generator, floor: float) -> Slow:
        return self.coarsely(lambda t: laws.flicker(random, len(t), COARSE_S, floor)) if floor != 0.0 else 0.0

    # --- for the plant -----------------------------------------------------------------------------------------------

    @property
    def rate_rad_s(self) -> Slow:
        return self.table_rate_rad_s + self.rate_error_rad_s

    def columns(self) -> dict[str, Slow]:
        """The plant's quantities by name; those not named are 0."""
        found = {**self._shell_columns(), **self._force_columns(), **self._pickoff_columns()}
        if len(self.tones) > len(TONE_NAMES):
            raise BadInput(f"{len(self.tones)} tones at once", "case", f"the plant has {len(TONE_NAMES)}: take fewer vibrations and interferences")
        for index, tone in zip(TONE_NAMES, self.tones, strict=False):
            found[f"tone_{index}"] = tone.amplitude
            found[f"tone_{index}_hz"] = tone.frequency_hz
        for name, value in self.extra.items():
            found[name] = found.get(name, 0.0) + value
        return found

    def _shell_columns(self) -> dict[str, Slow]:
        k = 2.0 * math.pi * self.frequency_hz
        split = 2.0 * math.pi * self.split_hz
        gain = self.truth.resonator.angular_gain
        cross = k * (np.imag(split) + gain * self.quadrature_rad_s)
        return {
            "stiffness_11": k * (k + np.real(split)), "stiffness_22": k * (k - np.real(split)), "stiffness_12": cross, "stiffness_21": cross,
            "damping_11": 2.0 * self.decay_1, "damping_22": 2.0 * self.decay_2, "damping_21": -gain * self.bias_rad_s,
            "damping_12": -gain * (self.bias_rad_s - self.bias_on_primary_rad_s),
            "rate": self.rate_rad_s, "angular_gain": self.angular_gain,
            "stiffening_1": self.stiffening[0], "stiffening_2": self.stiffening[1],
            "thickening_1": self.thickening[0], "thickening_2": self.thickening[1],
        }

    def _force_columns(self) -> dict[str, Slow]:
        latest = max(float(np.max(self.drive_delay_s)), float(np.max(self.rebalance_delay_s)))
        if latest > float(np.min(self.sample_period_s)):
            raise BadInput(f"a force {1e6 * latest:.3g} us late", "case", "stay within one sampling period: a smaller drive_phase")
        return {
            "drive_force_1": self.drive_force * np.cos(self.drive_angle_rad), "drive_force_2": self.drive_force * np.sin(self.drive_angle_rad),
            "rebalance_force_1": -self.rebalance_force * np.sin(self.rebalance_angle_rad),
            "rebalance_force_2": self.rebalance_force * np.cos(self.rebalance_angle_rad),
            "drive_delay": self.drive_delay_s, "rebalance_delay": self.rebalance_delay_s, "sample_period": self.sample_period_s,
        }

    def _pickoff_columns(self) -> dict[str, Slow]:
        turn = 2.0 * math.pi * self.frequency_hz
        return {
            "gain_1": self.pickoff_gain[0], "gain_2": self.pickoff_gain[1],
            **{f"lag_{i + 1}": turn * delay if np.any(delay) else 0.0 for i, delay in enumerate(self.pickoff_delay_s)},
            "offset_1": self.offset_fs[0], "offset_2": self.offset_fs[1], "noise_1": self.noise_fs[0], "noise_2": self.noise_fs[1],
        }

    def thermometer_codes(self) -> np.ndarray:
        """One code per block, at its start; (n,) int32."""
        sensor = self.truth.electronics.thermometer
        sensed = (self.thermometer_degc + self.thermometer_wander_degc)[:-1]
        sensed = sensed + self.thermometer_noise_degc * self.noise("thermometer noise").standard_normal(self.n_blocks)
        if self.thermometer_deadband_degc > 0.0:
            coarse = laws.play(sensed, self.thermometer_deadband_degc)
            sensed = coarse
        if self.thermometer_steps_degc > 0.0:
            sensed = self.thermometer_steps_degc * np.floor(sensed / self.thermometer_steps_degc + 0.5)
        return np.floor((sensed - sensor.zero_degc) / sensor.lsb_degc + 0.5).astype(np.int32)

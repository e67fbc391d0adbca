"""Device descriptions: what ships, inheritance, laws over temperature, and every refusal as one line that helps."""

import numpy as np
import pytest

from wineglass import device as devices
from wineglass.errors import BadInput
from wineglass.fields import rows

SHIPPED = ["metal", "metal-bringup", "metal-fast", "paper", "paper-fast", "silica", "silica-fast"]


def refusal(change: dict) -> str:
    with pytest.raises(BadInput) as caught:
        devices.load("metal").override(change, "case")
    text = str(caught.value)
    assert "\n" not in text and caught.value.exit_status == 2
    return text


def test_shipped_devices_are_complete():
    assert devices.names() == SHIPPED
    for name in SHIPPED:
        assert devices.load(name).name == name


@pytest.mark.parametrize("name", SHIPPED)
def test_text_form_reads_back_as_the_same_device(name):
    device = devices.load(name)
    assert devices.loads(device.to_toml()) == device


@pytest.mark.parametrize("name", SHIPPED)
def test_every_number_has_a_unit_and_every_field_a_meaning(name):
    for row in rows(devices.load(name)):
        assert row.meaning, row.path
        if isinstance(row.value, (int, float, list)) and not isinstance(row.value, bool):
            assert row.unit, row.path


def test_fast_variants_differ_only_in_thermal_time():
    for name in ("paper", "metal", "silica"):
        slow, fast = devices.load(name), devices.load(f"{name}-fast")
        assert fast.thermal.shell_time_constant_s == slow.thermal.shell_time_constant_s / 20
        same_time = fast.override({"name": name, "thermal.shell_time_constant_s": slow.thermal.shell_time_constant_s})
        assert same_time == slow


def test_metal_laws_over_temperature():
    resonator = devices.load("metal").resonator
    assert resonator.frequency_at(25.0) == 5000.0
    assert resonator.frequency_at(75.0) == pytest.approx(5000.0 * (1 + 250e-6 + 50e-6), rel=1e-15)
    assert resonator.q_at(75.0) == pytest.approx(9000.0)
    assert resonator.decay_rate_at(25.0) == pytest.approx(1 / 0.6366, rel=1e-4)
    rates_deg_h = np.degrees(resonator.cross_damping_at(np.array([25.0, -25.0, 75.0]))) * 3600
    assert rates_deg_h == pytest.approx([222.6, 1249, -9], abs=1)  # the figures published with the polynomial's reading


def test_silica_q_has_a_knee_and_cross_damping_a_tenth():
    silica, metal = devices.load("silica").resonator, devices.load("metal").resonator
    assert silica.q_at(60.0) == pytest.approx(7.3e5 * 1.07)
    assert silica.q_at(80.0) == pytest.approx(7.3e5 * 1.03)
    assert np.allclose(silica.cross_damping_rad_s, np.array(metal.cross_damping_rad_s) / 10)


def test_holding_force_makes_the_amplitude():
    device = devices.load("metal")
    k, zeta = 2 * np.pi * 5000, 1 / 2e4
    assert device.holding_acceleration_fs_s2 == pytest.approx(0.9 * 2 * zeta * k**2)


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"resonator.frequency_khz": 5}, ["unknown key 'frequency_khz'", "frequency_hz", "unit Hz"]),
        ({"resonatr.q": 5}, ["unknown key 'resonatr'"]),
        ({"resonator.q": 0}, ["resonator.q", "greater than 1"]),
        ({"resonator.q": "1e4"}, ["resonator.q", "valid number"]),
        ({"resonator.q": True}, ["resonator.q", "valid number"]),
        ({"resonator.q": float("inf")}, ["resonator.q", "finite"]),
        ({"resonator.q": float("nan")}, ["resonator.q", "finite"]),
        ({"resonator.frequency_hz": -5000}, ["frequency_hz"]),
        ({"resonator.cross_damping_rad_s": [1.9]}, ["cross damping", "energy", "rad/s"]),
        ({"resonator.cross_damping_rad_s": []}, ["cross_damping_rad_s"]),
        ({"resonator.cross_damping_rad_s": [0, 0, 0, 0, 0, 0, 1e-12]}, ["cross_damping_rad_s"]),
        ({"resonator.cross_damping_rad_s": [0, "a"]}, ["cross_damping_rad_s[1]"]),
        ({"resonator.q_slope_per_degc": -0.0099, "thermal.temperature_max_degc": 149}, ["Q falls", "149"]),
        ({"thermal.temperature_min_degc": 30}, ["T0 = 25 degC is outside"]),
        ({"thermal.temperature_max_degc": 160}, ["127 degC"]),
        ({"thermal.shell_time_constant_s": -1}, ["shell_time_constant_s"]),
        ({"electronics.adc.bits": 40}, ["adc.bits"]),
        ({"electronics.adc.bits": 16.5}, ["adc.bits"]),
        ({"electronics.sample_rate_hz": 500_000}, ["sample rate"]),
        ({"electronics.sample_rate_hz": 50001}, ["whole number of slow ticks"]),
        ({"firmware.pll_bandwidth_hz": 190, "firmware.decimation": 20}, ["too fast"]),
        ({"tolerance.q": {"relative": 0.1, "why": "test"}}, ["no number of this description"]),
        ({"tolerance": {"firmware.amplitude_fs": {"why": "test"}}}, ["either absolute or relative"]),
        ({"tolerance": {"firmware.amplitude_fs": {"absolute": [1.0], "why": "test"}}}, ["differ in shape"]),
        ({"name": "Has Blanks"}, ["name"]),
        ({"name": "longer-than-sixteen"}, ["name"]),
    ],
)
def test_refusals_name_the_field_and_what_to_do(change, parts):
    text = refusal(change)
    for part in ["case", *parts]:
        assert part in text, text


def test_passivity_limit_is_where_the_damping_matrix_turns_indefinite():
    device = devices.load("paper").override({"resonator.damping_mismatch": 0.4, "resonator.damping_axis_deg": 0.0})
    resonator = device.resonator
    limit = float(resonator.cross_damping_limit_at(25.0))
    decay = float(resonator.decay_rate_at(25.0))
    for factor, definite in ((0.999, True), (1.001, False)):
        cross = 0.5 * resonator.angular_gain * limit * factor  # zeta12 k
        matrix = np.array([[decay * 1.2, cross], [cross, decay * 0.8]])
        assert (np.linalg.eigvalsh(matrix).min() > 0) == definite


def test_unknown_device_lists_the_known_ones():
    with pytest.raises(BadInput, match="metal-fast"):
        devices.load("brass")


def test_inheritance_by_path_and_circles(tmp_path):
    (tmp_path / "a.toml").write_text('extends = "metal"\nname = "a"\n[resonator]\nq = 12_000\n')
    (tmp_path / "b.toml").write_text('extends = "a.toml"\nname = "b"\n[resonator]\nsplit_hz = 0.0\n')
    b = devices.load(tmp_path / "b.toml")
    assert (b.name, b.resonator.q, b.resonator.split_hz, b.resonator.split_axis_deg) == ("b", 12000, 0.0, 20)
    (tmp_path / "c.toml").write_text('extends = "d.toml"\nname = "c"\n')
    (tmp_path / "d.toml").write_text('extends = "c.toml"\nname = "d"\n')
    with pytest.raises(BadInput, match="circle"):
        devices.load(tmp_path / "c.toml")


@pytest.mark.parametrize("text", ["name = ", "\x00", "extends = 5\n", "name = 'x'\n[resonator]\nq = 5\nq = 6\n"])
def test_broken_files_are_refused(tmp_path, text):
    path = tmp_path / "broken.toml"
    path.write_text(text)
    with pytest.raises(BadInput, match="broken.toml"):
        devices.load(path)


def test_binary_file_is_refused(tmp_path):
    path = tmp_path / "binary.toml"
    path.write_bytes(bytes(range(128, 256)))
    with pytest.raises(BadInput, match="UTF-8"):
        devices.load(path)

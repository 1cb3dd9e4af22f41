"""A mass in g and a workspace in mm are detected, and a different true weight is not mistaken for them."""

import pytest

from hil_bridge.api import load, simulate
from hil_bridge.errors import ConfigError, DeviceError


def refusal(mass_kg: float, real_kg: float = 0.5) -> str:
    """Return the reason why a run does not begin with this mass if the tool has another."""
    config = {"tool": {"mass_kg": mass_kg}, "cell": {"tool": {"mass_kg": real_kg}}}
    with pytest.raises(DeviceError, match="where the tool's weight is") as refused:
        simulate(load({**config, "run": {"duration_s": 0.1}}), seed=1)
    return str(refused.value)


def test_mass_in_grams_is_detected_by_sensor_reading() -> None:
    assert refusal(500.0).endswith("nothing has moved; tool.mass_kg is in kg: did you mean 0.5?")
    for mass_kg in (50.0, 2.0):
        assert "did you mean" not in refusal(mass_kg)
    assert "did you mean" not in refusal(0.5, real_kg=0.0), "a sensor that reads zero fits every light tool"


def test_emulated_mass_in_grams_is_detected() -> None:
    with pytest.raises(
        ConfigError, match=r"cell\.tool\.mass_kg must be at most 10, got 500; .* did you mean 0\.5\?"
    ):
        load({"cell": {"tool": {"mass_kg": 500.0}}})
    with pytest.raises(ConfigError) as heavy:
        load({"cell": {"tool": {"mass_kg": 20_000.0}}})
    assert "did you mean" not in str(heavy.value)


def test_workspace_in_millimetres_is_detected() -> None:
    with pytest.raises(
        ConfigError, match=r"limits\.workspace_min_m is in m, .* did you mean \[0\.5, -0\.3, 0\.3\]\?"
    ):
        load({"limits": {"workspace_min_m": (500.0, -300.0, 300.0)}})


def test_approach_speed_in_metres_per_second_is_detected() -> None:
    with pytest.raises(
        ConfigError, match=r"task\.approach_speed_mm_s must be at least 0\.02, got 0\.005; .* mean 5\?"
    ):
        load({"task": {"approach_speed_mm_s": 0.005}})
    with pytest.raises(ConfigError, match=r"mean 5\?"):
        load({"task": {"step": [{"do": "approach", "speed_mm_s": 0.005}]}})


def test_setting_without_section_suggests_section() -> None:
    with pytest.raises(ConfigError, match=r"force_n is not a setting; did you mean task\.force_n\?"):
        load({"force_n": 5.0})

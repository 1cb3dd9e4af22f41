"""A mass in g and a box in mm are recognised where they show, and a true weight that differs is not taken for one."""

import pytest

from hil_bridge.api import load, simulate
from hil_bridge.errors import ConfigError, DeviceError


def refusal(mass_kg: float, real_kg: float = 0.5) -> str:
    """Reason why a run does not begin with this mass, where the tool has another."""
    config = {"tool": {"mass_kg": mass_kg}, "cell": {"tool": {"mass_kg": real_kg}}}
    with pytest.raises(DeviceError, match="where the tool's weight is") as refused:
        simulate(load({**config, "run": {"duration_s": 0.1}}), seed=1)
    return str(refused.value)


def test_a_mass_in_grams_is_recognised_by_what_the_sensor_reads() -> None:
    assert refusal(500.0).endswith("nothing has moved; tool.mass_kg is in kg: did you mean 0.5?")
    for mass_kg in (50.0, 2.0):
        assert "did you mean" not in refusal(mass_kg)
    assert "did you mean" not in refusal(0.5, real_kg=0.0), "a sensor that reads nothing fits each light tool"


def test_the_mass_of_the_emulated_tool_in_grams_is_recognised() -> None:
    with pytest.raises(
        ConfigError, match=r"cell\.tool\.mass_kg must be at most 10, got 500; .* did you mean 0\.5\?"
    ):
        load({"cell": {"tool": {"mass_kg": 500.0}}})
    with pytest.raises(ConfigError) as heavy:
        load({"cell": {"tool": {"mass_kg": 20_000.0}}})
    assert "did you mean" not in str(heavy.value)


def test_a_box_in_millimetres_is_recognised_in_a_configuration() -> None:
    with pytest.raises(
        ConfigError, match=r"limits\.workspace_min_m is in m, .* did you mean \[0\.5, -0\.3, 0\.3\]\?"
    ):
        load({"limits": {"workspace_min_m": (500.0, -300.0, 300.0)}})


def test_approach_speed_in_metres_a_second_is_recognised() -> None:
    with pytest.raises(
        ConfigError, match=r"task\.approach_speed_mm_s must be at least 0\.02, got 0\.005; .* mean 5\?"
    ):
        load({"task": {"approach_speed_mm_s": 0.005}})
    with pytest.raises(ConfigError, match=r"mean 5\?"):
        load({"task": {"step": [{"do": "approach", "speed_mm_s": 0.005}]}})


def test_setting_without_its_section_is_named_with_it() -> None:
    with pytest.raises(ConfigError, match=r"force_n is no setting; did you mean task\.force_n\?"):
        load({"force_n": 5.0})

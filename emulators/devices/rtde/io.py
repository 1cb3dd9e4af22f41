"""Inputs and outputs of the emulated controller.

RTDE inputs set outputs and the speed slider, each only if its mask permits.
"""

import math
from collections.abc import Mapping

from emulators.devices.rtde.state import ANALOG_TYPES, Registers, number_in
from protocol.devices.rtde.fields import Value

EXTERNAL_FORCE = "external_force_torque"
_DIGITAL = "actual_digital_output_bits"
_GROUPS = {"standard": 0, "configurable": 8, "tool": 16}
"""First bit of each group of digital outputs."""
_ANALOG_BITS = 2
"""Bit that holds the type of the first analogue output."""
MASKS = frozenset((*(f"{group}_digital_output_mask" for group in _GROUPS), "standard_analog_output_mask"))
"""Names of inputs that select the outputs that a package sets."""


def switch_outputs(inputs: Registers, outputs: Registers) -> Registers:
    """Return the outputs after a package of inputs. An analogue value is given as a share of its range, 0 … 1."""
    bits = int(number_in(outputs, _DIGITAL))
    for group, first in _GROUPS.items():
        mask = int(number_in(inputs, f"{group}_digital_output_mask")) << first
        bits = bits & ~mask | int(number_in(inputs, f"{group}_digital_output")) << first & mask
    mask, types = (int(number_in(inputs, f"standard_analog_output_{part}")) & 3 for part in ("mask", "type"))
    known = int(number_in(outputs, ANALOG_TYPES)) & ~(mask << _ANALOG_BITS)
    changed = {**outputs, _DIGITAL: bits, ANALOG_TYPES: known | (types & mask) << _ANALOG_BITS}
    for number in (0, 1):
        share = number_in(inputs, f"standard_analog_output_{number}")
        if mask >> number & 1 and math.isfinite(share):
            changed[f"standard_analog_output{number}"] = min(max(share, 0.0), 1.0)
    return changed


def read_slider(inputs: Registers, slider: float) -> float:
    """Return the speed slider after a package with a speed fraction, 0 … 1; `slider` is its previous value."""
    fraction = number_in(inputs, "speed_slider_fraction")
    obeyed = number_in(inputs, "speed_slider_mask") and math.isfinite(fraction)
    return min(max(fraction, 0.0), 1.0) if obeyed else slider


class RegisterBank:
    """Inputs and outputs of a controller, and its speed slider."""

    def __init__(self) -> None:
        self.inputs: Registers = {}
        self.outputs: Registers = {}
        self.flags: set[int] = set()
        """Numbers of the flags that programs have set. Assumed: they persist after the program ends."""
        self.claims: dict[str, object] = {}
        """Inputs that a connection holds, by name."""
        self.slider = 1.0
        """Speed scaling of motion from the next cycle on, 0 … 1 (assumed: without a ramp)."""

    def write_inputs(self, values: Mapping[str, Value]) -> None:
        """Write a package of inputs. Their values persist."""
        self.inputs = {**self.inputs, **values}
        if not MASKS.isdisjoint(values):
            self.outputs = switch_outputs(self.inputs, self.outputs)
        if "speed_slider_fraction" in values:
            self.slider = read_slider(self.inputs, self.slider)

    def write_output(self, name: str, value: float) -> None:
        """Write a register on behalf of a program."""
        if self.outputs.get(name, 0) != value:
            self.outputs = {**self.outputs, name: value}

    def number(self, name: str) -> float:
        """Return the value of a numeric input; 0 if it was never written."""
        return number_in(self.inputs, name)

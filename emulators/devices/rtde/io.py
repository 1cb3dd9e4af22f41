"""Outputs and the speed slider as inputs of RTDE set them: each only where its mask lets it."""

import math

from emulators.devices.rtde.state import ANALOG_TYPES, Registers, number_in

_DIGITAL = "actual_digital_output_bits"
_GROUPS = {"standard": 0, "configurable": 8, "tool": 16}
"""Digital outputs by group: the first bit of each."""
_ANALOG_BITS = 2
"""Bit of the type of the first analogue output."""
MASKS = frozenset((*(f"{group}_digital_output_mask" for group in _GROUPS), "standard_analog_output_mask"))
"""Inputs by which a package sets outputs."""


def switch_outputs(inputs: Registers, outputs: Registers) -> Registers:
    """The outputs after a package of inputs. An analogue value is a share of its range, 0 … 1."""
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
    """The speed slider after a package with a fraction for it, 0 … 1; `slider` is where it was."""
    fraction = number_in(inputs, "speed_slider_fraction")
    obeyed = number_in(inputs, "speed_slider_mask") and math.isfinite(fraction)
    return min(max(fraction, 0.0), 1.0) if obeyed else slider

"""Numbers with three digits."""

import math

import pytest

from hil_bridge.errors.rounding import three_digits


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.123456, "0.123"),
        (-0.5, "−0.500"),
        (12.0, "12"),
        (12345.6, "12300"),
        (0.0, "0"),
        (1.0e-9, "1e−09"),
        (math.inf, "inf"),
        (-math.inf, "−inf"),
        (math.nan, "nan"),
    ],
)
def test_three_digits(value: float, text: str) -> None:
    assert three_digits(value) == text


def test_digits_stay_on_their_side_of_a_bound() -> None:
    assert three_digits(1.0004, [1.0]) == "1.0004"
    assert three_digits(math.inf, [1.0]) == "inf"

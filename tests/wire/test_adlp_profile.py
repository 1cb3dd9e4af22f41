"""The link's profile: values from a configuration, bounds, marks, and the time of a character."""

import pytest
from pydantic import TypeAdapter, ValidationError

from protocol.marks import Mark
from protocol.marks import settings as settings_of
from protocol.s3.adlp import LinkProfile


def test_profile_comes_from_plain_values_and_refuses_wrong_ones():
    adapter = TypeAdapter(LinkProfile)
    assert adapter.validate_python({}) == LinkProfile()
    assert adapter.validate_python({"baudrate": 19200, "parity": "N"}).parity == "N"
    wrong = (
        {"parity": "X"},
        {"baud": 1},
        {"bid_limit": 0},
        {"answer_timeout_s": 0},
        {"dle_stuffing": "yes"},
        {"move_length": 200},
    )
    for values in wrong:
        with pytest.raises(ValidationError):
            adapter.validate_python(values)


def test_profile_knows_its_marks_and_its_character_time():
    marks = {item.name: item.info.mark for item in settings_of(LinkProfile())}
    assert marks["baudrate"] is Mark.OBSERVED
    assert marks["order_timeout_s"] is Mark.ASSUMED
    assert marks["gap_timeout_s"] is Mark.STANDARD
    assert LinkProfile().character_time == pytest.approx(1.1458e-3, rel=1e-4)
    assert LinkProfile().gap_time == 0.22
    assert LinkProfile(baudrate=300).gap_time == pytest.approx(20 * 11 / 300)
    assert LinkProfile(gap_timeout_s=1.0, baudrate=300).gap_time == 1.0
    assert LinkProfile(baudrate=1000, parity="N", stop_bits=2).character_time == 11 / 1000

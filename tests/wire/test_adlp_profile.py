"""Link profile: values from a configuration, bounds, marks, and character time."""

from dataclasses import replace

import pytest
from pydantic import TypeAdapter, ValidationError

from protocol.devices.s3.adlp import LinkProfile
from protocol.marks import Mark
from protocol.marks import settings as settings_of


def test_profile_accepts_plain_values_and_refuses_wrong_ones():
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
        {"profile": "unheard-of"},
        {"profile": 1},
        {"profile": "observed-client", "length_style": "whole"},
    )
    for values in wrong:
        with pytest.raises(ValidationError):
            adapter.validate_python(values)


def test_profile_has_marks_and_a_character_time():
    marks = {item.name: item.info.mark for item in settings_of(LinkProfile())}
    assert marks["baudrate"] is Mark.OBSERVED
    assert marks["order_timeout_s"] is Mark.ASSUMED
    assert marks["gap_timeout_s"] is Mark.STANDARD
    assert LinkProfile().character_time == pytest.approx(1.1458e-3, rel=1e-4)
    assert LinkProfile().gap_time == 0.22
    assert LinkProfile(baudrate=300).gap_time == pytest.approx(20 * 11 / 300)
    assert LinkProfile(gap_timeout_s=1.0, baudrate=300).gap_time == 1.0
    assert LinkProfile(baudrate=1000, parity="N", stop_bits=2).character_time == 11 / 1000


def test_observed_client_is_used_as_a_unit():
    link = LinkProfile.named("observed-client", baudrate=19200)
    assert TypeAdapter(LinkProfile).validate_python({"profile": "observed-client", "baudrate": 19200}) == link
    assert (link.length_style, link.move_length, link.stx_alternation) == ("data", 60, "parity")
    assert (link.dle_stuffing, link.bid_ahead) == ("off", False)
    assert replace(link, parity="N").profile == "observed-client"
    with pytest.raises(ValueError, match="move_length must be 60 in the profile observed-client, got 52"):
        replace(link, move_length=52)
    with pytest.raises(ValueError, match="profile must be one of default, observed-client, got 'x'"):
        LinkProfile.named("x")
    assert LinkProfile.named("default") == LinkProfile()

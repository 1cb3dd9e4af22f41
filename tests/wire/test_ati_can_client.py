"""Client of a NETCANOEM board: its requests, the wrench of the worked example, and the conditions that end
the session.
"""

from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.can.error import CanErrorReport, ErrorClass, encode_error
from protocol.can.frame import CanFrame
from protocol.can.text import parse_frame
from protocol.devices.ati_can import AtiCanClient, AtiCanClientProfile
from protocol.devices.ati_can.messages import BASE, encode_row, encode_sample
from protocol.endpoint import LocalProtocolError
from protocol.wrench import (
    SensorFailed,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStopped,
    WrenchFrame,
    Zeroed,
    wrench_of,
)

T0 = 1000.25
MATRIX = (
    (
        -11.6928025731666,
        -3.34657738404844,
        32.7764709067651,
        -926.64603423617,
        38.5192497186425,
        918.091940090325,
    ),
    (
        49.8475873968464,
        1111.54828736883,
        8.58054953347822,
        -540.982510416618,
        -7.04384116121561,
        -523.956402989209,
    ),
    (
        -1580.00155551285,
        -6.9911293161961,
        -1574.63107730182,
        14.3099554306112,
        -1614.37889906611,
        7.27537112828615,
    ),
    (
        0.37477300521384,
        6.04214878084067,
        -22.5165000555478,
        -2.45353141451211,
        22.5514352819426,
        -3.19660800051747,
    ),
    (
        25.4817193105601,
        -0.21309822296323,
        -13.0953176706754,
        5.46211714273733,
        -13.2800024806153,
        -4.8017154960817,
    ),
    (
        0.560558370801638,
        13.4460552194242,
        -0.356886435089904,
        12.7776663278492,
        0.341175056695845,
        12.7373831753738,
    ),
)
GAGES = (1000, -2000, 3000, -4000, 5000, -6000)
BIAS = (100, -150, 200, -250, 300, -350)


def frames(*texts: str) -> list[CanFrame]:
    return [parse_frame(text) for text in texts]


def events(client: AtiCanClient) -> list[Any]:
    items = []
    while (event := client.next_event()) is not None:
        items.append(event)
    return items


def sent_frames(client: AtiCanClient, now: float) -> list[str]:
    if (due := client.next_deadline()) is not None and due <= now:
        client.handle_deadline(now)
    return [str(frame) for frame in client.data_to_send(now)]


def sample(gages: Sequence[int] = GAGES, status: int = 0) -> tuple[CanFrame, CanFrame]:
    return encode_sample(BASE, status, gages)


def ready_client(firmware: str = "20F#03080002", **settings: Any) -> AtiCanClient:
    """Return a client that has read everything and requests its first sample."""
    client = AtiCanClient(AtiCanClientProfile(**settings), T0)
    assert sent_frames(client, T0) == ["20F#"]
    for answer, question in (
        (frames(firmware), "205#"),
        (frames("205#4654343437320000"), f"206#{client._profile.slot:02X}"),
        (frames(f"206#{client._profile.slot:02X}"), "202#00"),
        *((encode_row(BASE, MATRIX[k]), f"202#{k + 1:02X}") for k in range(5)),
        (encode_row(BASE, MATRIX[5]), "207#"),
    ):
        client.receive(answer, T0)
        assert sent_frames(client, T0) == [question]
    client.receive(frames("207#000F4240000F4240"), T0)
    if firmware == "20F#03080002":
        assert sent_frames(client, T0) == ["208#"]
        client.receive(frames("208#0203"), T0)
    assert sent_frames(client, T0) == ["200#"]
    return client


def ready(**settings: Any) -> AtiCanClient:
    client = ready_client(**settings)
    client.receive(sample(), T0 + 0.001)
    assert [type(event) for event in events(client)] == [SensorReady, WrenchFrame]
    return client


def test_wrench_matches_the_worked_example() -> None:
    client = ready_client()
    client.receive(sample(), T0 + 0.001)
    reports, frame = events(client)
    assert reports.facts.model == "ATI NETCANOEM, firmware 3.8 build 2, FT4472"
    assert wrench_of(frame.values, reports.facts.scales) == pytest.approx(
        (-1.516041, 3.124942, -14.462699, 0.062492, -0.072816, -0.153231), abs=1e-6
    )
    assert (frame.sequence, frame.at, frame.saturated) == (1, T0 + 0.001, 0)


def test_zero_is_a_bias_of_gages() -> None:
    client = ready(zero_s=0.004)
    client.zero()
    for k, gages in enumerate((BIAS, GAGES)):
        now = T0 + 0.004 * (k + 1)
        assert sent_frames(client, now) == ["200#"]
        client.receive(sample(gages), now)
    _, took, frame = events(client)
    assert took == Zeroed()
    assert wrench_of(frame.values, (1e-6,) * 6) == pytest.approx(
        (-1.443814, 2.968456, -13.500384, 0.059366, -0.069108, -0.143649), abs=1e-6
    )


def test_older_board_reports_no_units() -> None:
    client = ready_client(firmware="20F#03060001")
    client.receive(sample(), T0)
    assert events(client)[0].facts.scales == pytest.approx((1e-6,) * 6)


def test_one_question_is_under_way_and_the_next_keeps_the_period() -> None:
    client = ready()
    assert client.next_deadline() == pytest.approx(T0 + 0.004)
    assert sent_frames(client, T0 + 0.002) == []
    assert sent_frames(client, T0 + 0.0041) == ["200#"]
    assert sent_frames(client, T0 + 0.02) == []


def test_lost_response_is_requested_again_three_end_the_session() -> None:
    client = ready()
    now, reports = T0 + 0.004, []
    for _ in range(4):
        reports += sent_frames(client, now)
        now += 0.11
    assert reports == ["200#"] * 3
    (failed,) = events(client)
    assert isinstance(failed, SensorFailed)
    assert "sample after 3 requests" in failed.text
    with pytest.raises(LocalProtocolError):
        client.zero()


def test_booting_board_is_awaited() -> None:
    client = AtiCanClient(AtiCanClientProfile(ready_timeout_s=1.0), T0)
    reports = [sent_frames(client, T0 + 0.11 * k) for k in range(14)]
    assert len([one for one in reports if one]) in (9, 10, 11)
    assert "no response" in events(client)[0].text


def test_unmatched_halves_are_dropped() -> None:
    client = ready()
    sent_frames(client, T0 + 0.005)
    first, second = sample()
    client.receive([second, first, first, second], T0 + 0.006)
    assert [type(event) for event in events(client)] == [WrenchFrame]
    assert client.statistics.unpaired == 2


@pytest.mark.parametrize("gages", [(32767, 0, 0, 0, 0, 0), (0, 0, 0, -32768, 0, 0)])
def test_saturated_gage_marks_all_axes(gages: tuple[int, ...]) -> None:
    client = ready()
    sent_frames(client, T0 + 0.005)
    client.receive(sample(gages), T0 + 0.006)
    assert events(client)[0].saturated == 0b111111


@pytest.mark.parametrize(
    ("status", "lost"), [(0x8040, True), (0x8020, True), (0x9000, True), (0x8100, False), (0xC000, False)]
)
def test_critical_status_marks_all_axes(status: int, lost: bool) -> None:
    client = ready()
    sent_frames(client, T0 + 0.005)
    client.receive(sample(status=status), T0 + 0.006)
    notice, frame = events(client)
    assert isinstance(notice, SensorNotice)
    assert bool(frame.saturated) is lost


def test_constantly_changing_status_is_limited_in_the_recording() -> None:
    client = ready()
    for k in range(200):
        now = T0 + 0.005 * (k + 1)
        sent_frames(client, now)
        client.receive(sample(status=k << 8), now)
    assert len([event for event in events(client) if isinstance(event, SensorNotice)]) == 16


def test_session_does_not_start_with_a_critical_status() -> None:
    client = ready_client()
    client.receive(sample(status=0x8040), T0)
    assert "status 8040: bad calibration" in events(client)[-1].text


def test_watchdog_selects_the_slot_and_reads_the_matrix_again() -> None:
    client = ready()
    sent_frames(client, T0 + 0.005)
    client.receive(sample(status=0x8001), T0 + 0.006)
    assert SensorRestarted() in events(client)
    assert sent_frames(client, T0 + 0.02) == ["206#00"]


@pytest.mark.parametrize("text", ["206#01", "20C#"])
def test_another_host_that_changes_the_board_ends_the_session(text: str) -> None:
    client = ready()
    client.receive(frames(text), T0 + 0.002)
    (failed,) = events(client)
    assert "another host" in failed.text


def test_another_host_that_only_polls_is_reported_once() -> None:
    client = ready()
    client.receive(frames("200#", "20F#", "207#"), T0 + 0.002)
    assert [type(event) for event in events(client)] == [SensorNotice]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (["202#7FC000007FC00000"], "not a number"),
        (
            ["202#0000000000000000", "203#0000000000000000", "204#0000000000000000"],
            "row fx of the matrix is 0",
        ),
    ],
)
def test_invalid_matrix_ends_the_session(answer: list[str], message: str) -> None:
    client = AtiCanClient(AtiCanClientProfile(), T0)
    sent_frames(client, T0)
    client.receive(frames("20F#03080002", "205#4654343437320000", "206#00"), T0)
    client.receive(frames(*answer), T0)
    (failed,) = events(client)
    assert message in failed.text


def test_echo_of_another_slot_ends_the_session() -> None:
    client = AtiCanClient(AtiCanClientProfile(slot=2), T0)
    sent_frames(client, T0)
    client.receive(frames("20F#03080002", "205#4654343437320000", "206#00"), T0)
    assert "not selected slot 2" in events(client)[-1].text


def test_other_frames_are_ignored_and_a_stop_sends_nothing() -> None:
    client = ready()
    client.receive(
        [CanFrame(0x210, b"x"), CanFrame(0x200, b"", extended=True), CanFrame(0x20C, remote=True)], T0
    )
    assert events(client) == []
    client.stop()
    client.stop()
    client.receive(sample(), T0)
    assert events(client) == [SensorStopped()]
    assert client.next_deadline() is None


def test_bus_report_of_the_interface_is_reported_once() -> None:
    client = ready()
    report = encode_error(CanErrorReport(ErrorClass.BUS_OFF))
    client.receive([report, report, CanFrame(0x7FF, b"", error=True)], T0)
    (notice,) = [event for event in events(client) if event.text.startswith("CAN bus: ")][:1]
    assert isinstance(notice, SensorNotice)


@given(st.lists(st.tuples(st.integers(0x1F0, 0x21F), st.binary(max_size=8)), max_size=30), st.booleans())
def test_no_frames_raise(data: list[tuple[int, bytes]], begun: bool) -> None:
    client = ready() if begun else AtiCanClient(AtiCanClientProfile(), T0)
    for k, (number, payload) in enumerate(data):
        now = T0 + 0.01 * (k + 1)
        sent_frames(client, now)
        client.receive([CanFrame(number, payload)], now)
        events(client)

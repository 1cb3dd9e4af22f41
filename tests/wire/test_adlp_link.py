"""Input of an end of the link from its owner, its events, and its largest stores.

What it does on the line is in the transcripts beside this file, what it makes of a bad line in test_adlp_faults.py.
"""

import pytest

from protocol.devices.s3.adlp import (
    ROUTINE,
    Link,
    LinkFailed,
    LinkFailure,
    LinkNotice,
    LinkProfile,
    MessageReceived,
    MessageSent,
    NoticeKind,
    Role,
    State,
)
from protocol.endpoint import LocalProtocolError

HOST, ROBOT = Role.HOST, Role.ROBOT
EPOCH = 1234.5
ASK = bytes.fromhex("00 08 01 00 13 01 00 00")
B_ASK = bytes.fromhex("10 02 00 08 01 00 13 01 00 00 10 03 18")
B_REPLY = bytes.fromhex("10 02 00 08 00 00 13 02 00 00 10 03 1A")
REPLY = B_REPLY[2:-3]


def events_of(link):
    """Every queued event; a notice as its kind."""
    out = []
    while (event := link.next_event()) is not None:
        out.append(event.kind if isinstance(event, LinkNotice) else event)
    return out


def test_send_refuses_invalid_messages():
    link = Link(HOST, LinkProfile())
    with pytest.raises(LocalProtocolError, match="at least one"):
        link.send([])
    with pytest.raises(LocalProtocolError, match="129 bytes is too long"):
        link.send([(129).to_bytes(2, "big") + bytes(127)])
    with pytest.raises(LocalProtocolError, match="wrong length field"):
        link.send([b"\x00\x09" + bytes(6)])
    for _ in range(16):
        link.send([ASK])
    with pytest.raises(LocalProtocolError, match="16 messages"):
        link.send([ASK])


def test_counters_count_and_are_read_only():
    link = Link(HOST, LinkProfile())
    link.receive(b"\xff\xff\x05" + B_REPLY + b"\x04", 0.0)
    assert link.counters["messages received"] == link.counters["blocks received"] == 1
    assert link.counters["noise bytes"] == 2
    assert link.counters["noise"] == 1
    with pytest.raises(TypeError):
        link.counters["noise"] = 0


def exchange(link):
    """The link sends one message and receives another."""
    link.send([ASK])
    assert link.data_to_send(EPOCH) == b"\x05"
    link.receive(b"\x06", EPOCH)
    assert link.data_to_send(EPOCH) == B_ASK
    link.receive(b"\x06", EPOCH)
    assert link.data_to_send(EPOCH) == b"\x04"
    for data in (b"\x05", B_REPLY, b"\x04"):
        link.receive(data, EPOCH)
        link.data_to_send(EPOCH)


def test_bids_and_acknowledgements_are_always_counted():
    quiet, verbose = Link(HOST, LinkProfile()), Link(HOST, LinkProfile())
    assert not quiet.verbose
    verbose.verbose = True
    assert verbose.verbose
    for link in (quiet, verbose):
        exchange(link)
        assert [link.counters[kind] for kind in ("bid sent", "bid received")] == [1, 1]
        assert [link.counters[kind] for kind in ("ACK sent", "ACK received")] == [2, 2]
    assert events_of(quiet) == [MessageSent(), MessageReceived((REPLY,))]
    assert events_of(verbose) == [
        NoticeKind.BID_SENT,
        NoticeKind.ACK_RECEIVED,
        NoticeKind.ACK_RECEIVED,
        MessageSent(),
        NoticeKind.BID_RECEIVED,
        NoticeKind.ACK_SENT,
        NoticeKind.ACK_SENT,
        MessageReceived((REPLY,)),
    ]


@pytest.mark.parametrize("acknowledged", [b"\x06", b"\x0f"], ids=["ACK", "RVI"])
def test_end_delayed_for_too_long_bids_again(acknowledged):
    """The process was delayed while its bid was out: the other side has stopped waiting for the block."""
    link, late = Link(HOST, LinkProfile()), EPOCH + 2.5
    link.announce()
    assert link.data_to_send(EPOCH) == b"\x05"
    link.send([ASK])
    link.receive(acknowledged, late)
    assert link.data_to_send(late) == b"\x05"
    link.receive(b"\x06", late)
    assert link.data_to_send(late) == B_ASK


def test_permanently_delayed_end_gives_up_after_the_bid_limit():
    link, now = Link(HOST, LinkProfile()), EPOCH
    link.send([ASK])
    for _ in range(3):
        assert link.data_to_send(now) == b"\x05"
        now += 2.5
        link.receive(b"\x06", now)
    assert link.data_to_send(now) == b""
    assert [event.reason for event in events_of(link) if isinstance(event, LinkFailed)] == [
        LinkFailure.NO_ANSWER
    ]


def test_announcement_during_a_message_bids_after_it():
    link = Link(HOST, LinkProfile())
    link.send([ASK])
    link.data_to_send(EPOCH)
    link.announce()
    link.receive(b"\x06", EPOCH)
    assert link.data_to_send(EPOCH) == B_ASK
    link.receive(b"\x06", EPOCH)
    assert link.data_to_send(EPOCH) == b"\x04\x05"


def test_message_after_a_long_hold_bids_again():
    link, late = Link(HOST, LinkProfile()), EPOCH + 1.5
    link.announce()
    link.data_to_send(EPOCH)
    link.receive(b"\x06", EPOCH)
    link.send([ASK])  # before the owner has handled the time-out
    assert link.data_to_send(late) == b"\x04"
    assert link.data_to_send(late) == b"\x05"
    link.receive(b"\x06", late)
    assert link.data_to_send(late) == B_ASK


def test_every_kind_of_notice_has_a_counter():
    counters = Link(HOST, LinkProfile()).counters
    assert {str(kind) for kind in NoticeKind} <= counters.keys()
    assert set(NoticeKind) > ROUTINE


def test_failed_bid_loop_counts_each_bid():
    link = Link(HOST, LinkProfile())
    link.send([ASK])
    now = EPOCH
    link.data_to_send(now)
    while (due := link.next_deadline()) is not None:
        link.handle_deadline(due)
        link.data_to_send(due)
    assert (link.counters["bid sent"], link.counters["bid repeated"]) == (3, 2)


def test_unread_events_are_bounded():
    link = Link(HOST, LinkProfile())
    link.receive(b"\x15" * 2000, 0.0)
    assert link.counters["events dropped"] == 2000 - 1024


def test_endless_message_is_abandoned():
    link = Link(HOST, LinkProfile())
    link.receive(b"\x05" + B_REPLY * 4097, 0.0)
    assert link.state is State.IDLE
    assert link.data_to_send(0.0)[-2:] == b"\x06\x04"
    (failed,) = events_of(link)
    assert failed.reason == "too long"


def test_late_block_with_old_stx_and_new_telegram_is_dropped():
    link = Link(HOST, LinkProfile(stx_alternation="toggle"))
    link.receive(b"\x05" + B_REPLY, 0.0)
    link.data_to_send(0.0)
    link.handle_deadline(1.0)
    link.receive(bytes.fromhex("10 02 00 08 00 00 1D 02 00 00 10 03 14"), 1.0)
    assert link.data_to_send(1.0) == b""
    assert events_of(link) == [NoticeKind.MISSING_EOT, MessageReceived((REPLY,)), NoticeKind.STRAY_BLOCK]


def test_receiving_is_true_from_the_bid_to_the_end():
    link = Link(HOST, LinkProfile())
    states = []
    for data in (b"\x05", B_REPLY, b"\x04"):
        link.receive(data, 0.0)
        states.append(link.receiving)
    assert states == [True, True, False]


def test_early_deadline_call_does_nothing():
    link = Link(HOST, LinkProfile())
    link.handle_deadline(5.0)
    link.send([ASK])
    assert link.data_to_send(5.0) == b"\x05"
    link.receive(b"\xff", 5.1)
    link.handle_deadline(5.2)
    assert events_of(link) == []
    assert link.next_deadline() == 5.1 + 0.22


def test_texts_name_the_checks_for_an_operator():
    remedies = {}
    for name, noise in (("no answer", b""), ("only noise", b"\xff")):
        link = Link(HOST, LinkProfile(bid_limit=1))
        link.send([ASK])
        link.data_to_send(0.0)
        link.receive(noise, 0.1)
        link.handle_deadline(9.0)
        (event,) = (event for event in events_of(link) if isinstance(event, LinkFailed))
        assert event.reason == name
        remedies[name] = event.remedy
    assert "cable" in remedies["no answer"]
    assert "parity" in remedies["only noise"]

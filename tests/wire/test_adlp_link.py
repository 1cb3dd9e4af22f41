"""Every behaviour row of the computer-link specification, section 2, as a transcript with times.

The line runs at 11000 Bd here, so that a character (11 bits) takes 1 ms and time-outs are easy to read:
an unanswered ENQ is over after 2.001 s, an unanswered block of 13 characters after 2.013 s.
"""

from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from protocol.adlp import (
    TRANSITIONS,
    Action,
    Link,
    LinkFailed,
    LinkNotice,
    LinkProfile,
    MessageReceived,
    MessageSent,
    Role,
    State,
    Stimulus,
    encode_block,
)
from protocol.endpoint import LocalProtocolError
from protocol.marks import Mark
from protocol.marks import settings as settings_of

HOST, ROBOT = Role.HOST, Role.ROBOT
EPOCH = 1234.5
ASK = bytes.fromhex("00 08 01 00 13 01 00 00")
STOP = bytes.fromhex("00 08 01 00 03 01 00 00")
REPLY = bytes.fromhex("00 08 00 00 13 02 00 00")
MORE = bytes.fromhex("00 0A 00 00 1D 0A 00 00 10 03")
LAST = bytes.fromhex("00 08 00 00 1D 02 00 00")
B_ASK = "10 02 00 08 01 00 13 01 00 00 10 03 18"
B_STOP = "10 02 00 08 01 00 03 01 00 00 10 03 08"
B_REPLY = "10 02 00 08 00 00 13 02 00 00 10 03 1A"
B_MORE = "10 02 00 0A 00 00 1D 0A 00 00 10 03 10 03 0D"
B_LAST = "10 02 00 08 00 00 1D 02 00 00 10 03 14"
B_MORE_ODD = "10 82" + B_MORE[5:]
BAD_REPLY = B_REPLY[:-2] + "00"


def send(at, *telegrams):
    return at, "send", telegrams


def rx(at, text):
    return at, "rx", text


def tx(at, text):
    return at, "tx", text


@dataclass(frozen=True)
class Row:
    """One row of section 2: what happens to a link of this role, what it sends when, what it tells."""

    name: str
    role: Role
    steps: tuple
    events: tuple[str, ...]
    settings: dict = field(default_factory=dict)
    until: float = 30.0


def told(link):
    out = []
    while (event := link.next_event()) is not None:
        match event:
            case MessageReceived(telegrams):
                out.append("received " + " | ".join(t.hex(" ").upper() for t in telegrams))
            case MessageSent():
                out.append("sent")
            case LinkFailed(reason):
                out.append(f"failed: {reason}")
            case LinkNotice(kind):
                out.append(str(kind))
    return tuple(out)


def profile(**changes):
    return LinkProfile(**{"baudrate": 11000, **changes})


def play(row, split=None):
    """Run the transcript; returns what went out, as (time, hex), and what was told."""
    link = Link(row.role, profile(**row.settings))
    sent = []

    def flush(now):
        if data := link.data_to_send(now):
            sent.append((round(now - EPOCH, 4), data.hex(" ").upper()))

    def advance(to):
        while (deadline := link.next_deadline()) is not None and deadline <= to:
            link.handle_deadline(deadline)
            flush(deadline)

    for at, what, value in row.steps:
        if what == "tx":
            continue
        advance(EPOCH + at)
        if what == "send":
            link.send(value)
        else:
            data = bytes.fromhex(value)
            for piece in (
                [data] if split is None else [data[i : i + split] for i in range(0, len(data), split)]
            ):
                link.receive(piece, EPOCH + at)
        flush(EPOCH + at)
    advance(EPOCH + row.until)
    assert link.next_deadline() is None, "every wait must end"
    return sent, told(link)


R_REPLY, R_ASK, R_MORE, R_LAST = (f"received {t.hex(' ').upper()}" for t in (REPLY, ASK, MORE, LAST))
R_TWO = f"{R_MORE} | {LAST.hex(' ').upper()}"

BID_TIMES = (tx(0, "05"), tx(2.001, "05"), tx(4.002, "05"))

ROWS = [
    Row(
        "bid, block, EOT from the PC",
        HOST,
        (send(0, ASK), tx(0, "05"), rx(0.01, "06"), tx(0.01, B_ASK), rx(0.03, "06"), tx(0.03, "04")),
        ("sent",),
    ),
    Row(
        "bid, block, EOT taken by the robot",
        ROBOT,
        (rx(0, "05"), tx(0, "06"), rx(0.02, B_ASK), tx(0.02, "06"), rx(0.03, "04")),
        (R_ASK,),
    ),
    Row(
        "the robot may bid too",
        ROBOT,
        (send(0, REPLY), tx(0, "05"), rx(0.01, "06"), tx(0.01, B_REPLY), rx(0.03, "06"), tx(0.03, "04")),
        ("sent",),
    ),
    Row(
        "answer taken by the PC",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, B_REPLY), tx(0.02, "06"), rx(0.03, "04")),
        (R_REPLY,),
    ),
    Row(
        "one EOT ends several blocks, the next follows without ENQ: sender",
        ROBOT,
        (
            send(0, MORE, LAST),
            tx(0, "05"),
            rx(0.01, "06"),
            tx(0.01, B_MORE),
            rx(0.03, "06"),
            tx(0.03, B_LAST),
            rx(0.05, "06"),
            tx(0.05, "04"),
        ),
        ("sent",),
    ),
    Row(
        "one EOT ends several blocks, the next follows without ENQ: receiver",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_MORE),
            tx(0.02, "06"),
            rx(0.04, B_LAST),
            tx(0.04, "06"),
            rx(0.05, "04"),
        ),
        (R_TWO,),
    ),
    Row(
        "next message bids after the EOT of the one before",
        ROBOT,
        (
            send(0, REPLY),
            tx(0, "05"),
            send(0, LAST),
            rx(0.01, "06"),
            tx(0.01, B_REPLY),
            rx(0.03, "06"),
            tx(0.03, "04 05"),
            rx(0.04, "06"),
            tx(0.04, B_LAST),
            rx(0.06, "06"),
            tx(0.06, "04"),
        ),
        ("sent", "sent"),
    ),
    Row(
        "NAK repeats the whole block",
        HOST,
        (
            send(0, ASK),
            tx(0, "05"),
            rx(0.01, "06"),
            tx(0.01, B_ASK),
            rx(0.03, "15"),
            tx(0.03, B_ASK),
            rx(0.05, "06"),
            tx(0.05, "04"),
        ),
        ("NAK received", "block repeated", "sent"),
    ),
    Row(
        "three repeats, then EOT and a link error",
        HOST,
        (
            send(0, ASK),
            tx(0, "05"),
            rx(0.01, "06"),
            tx(0.01, B_ASK),
            *(step for n in range(1, 4) for step in (rx(n / 10, "15"), tx(n / 10, B_ASK))),
            rx(0.4, "15"),
            tx(0.4, "04"),
        ),
        ("NAK received", "block repeated") * 3 + ("NAK received", "failed: repeats exhausted"),
    ),
    Row(
        "bad check character is answered by NAK, the repeat is taken",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, BAD_REPLY),
            tx(0.02, "15"),
            rx(0.04, B_REPLY),
            tx(0.04, "06"),
            rx(0.05, "04"),
        ),
        ("bad block", "NAK sent", R_REPLY),
    ),
    Row(
        "bad check character of a further block keeps the blocks before",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_MORE),
            tx(0.02, "06"),
            rx(0.04, BAD_REPLY),
            tx(0.04, "15"),
            rx(0.06, B_LAST),
            tx(0.06, "06"),
            rx(0.07, "04"),
        ),
        ("bad block", "NAK sent", R_TWO),
    ),
    Row(
        "receiver refuses at most three times, then gives up quietly",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            *(step for n in range(1, 4) for step in (rx(n / 10, BAD_REPLY), tx(n / 10, "15"))),
            rx(0.4, BAD_REPLY),
        ),
        ("bad block", "NAK sent") * 3 + ("bad block", "gave up receiving"),
    ),
    Row(
        "receiver gives up in the middle of a message",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, B_MORE), tx(0.02, "06"), rx(0.04, BAD_REPLY)),
        ("bad block", "gave up receiving", "failed: incomplete"),
        {"repeat_limit": 0},
    ),
    Row(
        "DLE in the telegram is not doubled",
        ROBOT,
        (send(0, MORE), tx(0, "05"), rx(0.01, "06"), tx(0.01, B_MORE), rx(0.03, "06"), tx(0.03, "04")),
        ("sent",),
    ),
    Row(
        "DLE in the telegram is doubled where the profile says so: sender",
        ROBOT,
        (
            send(0, MORE),
            tx(0, "05"),
            rx(0.01, "06"),
            tx(0.01, "10 02 00 0A 00 00 1D 0A 00 00 10 10 03 10 03 0D"),
            rx(0.03, "06"),
            tx(0.03, "04"),
        ),
        ("sent",),
        {"dle_stuffing": "double"},
    ),
    Row(
        "DLE in the telegram is doubled where the profile says so: receiver",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.01, "10 02 00 0A 00 00 1D 0A 00 00 10 10 03 10 03 0D"),
            tx(0.01, "06"),
            rx(0.03, "04"),
        ),
        (R_MORE,),
        {"dle_stuffing": "double"},
    ),
    Row(
        "receiver takes STX 82 too",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, "10 82" + B_REPLY[5:]), tx(0.02, "06"), rx(0.03, "04")),
        (R_REPLY,),
    ),
    Row(
        "STX alternates from 02, a repeat keeps its value: sender",
        ROBOT,
        (
            send(0, LAST, MORE),
            tx(0, "05"),
            rx(0.01, "06"),
            tx(0.01, B_LAST),
            rx(0.03, "06"),
            tx(0.03, B_MORE_ODD),
            rx(0.05, "15"),
            tx(0.05, B_MORE_ODD),
            rx(0.07, "06"),
            tx(0.07, "04"),
        ),
        ("NAK received", "block repeated", "sent"),
        {"stx_alternation": "toggle"},
    ),
    Row(
        "STX equal to the last accepted one: acknowledged and dropped",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_LAST),
            tx(0.02, "06"),
            rx(0.04, B_LAST),
            tx(0.04, "06"),
            rx(0.06, B_MORE_ODD),
            tx(0.06, "06"),
            rx(0.07, "04"),
        ),
        ("duplicate dropped", f"{R_LAST} | {MORE.hex(' ').upper()}"),
        {"stx_alternation": "toggle"},
    ),
    Row(
        "three bids of 2 s each, nothing comes",
        HOST,
        (send(0, ASK), *BID_TIMES),
        ("time-out", "bid repeated") * 2 + ("failed: no answer",),
    ),
    Row(
        "three bids of 2 s each, only noise comes",
        HOST,
        (send(0, ASK), tx(0, "05"), rx(0.01, "83 C0 FF"), tx(2.001, "05"), tx(4.002, "05")),
        ("noise", *("time-out", "bid repeated") * 2, "failed: only noise"),
    ),
    Row(
        "three bids of 2 s each, a bid is refused",
        HOST,
        (send(0, ASK), tx(0, "05"), rx(0.01, "15"), tx(2.001, "05"), tx(4.002, "05")),
        ("NAK received", *("time-out", "bid repeated") * 2, "failed: bid refused"),
    ),
    Row(
        "a block of somebody else does not answer a bid",
        HOST,
        (send(0, ASK), tx(0, "05"), rx(0.01, B_REPLY), tx(2.001, "05"), tx(4.002, "05")),
        ("stray block", *("time-out", "bid repeated") * 2, "failed: only noise"),
    ),
    Row(
        "the second bid is answered",
        HOST,
        (
            send(0, ASK),
            tx(0, "05"),
            tx(2.001, "05"),
            rx(2.1, "06"),
            tx(2.1, B_ASK),
            rx(2.2, "06"),
            tx(2.2, "04"),
        ),
        ("time-out", "bid repeated", "sent"),
    ),
    Row(
        "2 s from the end of a block to its ACK",
        HOST,
        (
            send(0, ASK),
            tx(0, "05"),
            rx(1, "06"),
            tx(1, B_ASK),
            tx(3.013, B_ASK),
            tx(5.026, B_ASK),
            tx(7.039, B_ASK),
            tx(9.052, "04"),
        ),
        ("time-out", "block repeated") * 3 + ("time-out", "failed: repeats exhausted"),
    ),
    Row(
        "gap inside a block: dropped and NAK after 0.22 s",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_REPLY[:17]),
            tx(0.24, "15"),
            rx(0.3, B_REPLY),
            tx(0.3, "06"),
            rx(0.31, "04"),
        ),
        ("NAK sent", "noise", R_REPLY),
    ),
    Row(
        "gap inside a further block",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_MORE),
            tx(0.02, "06"),
            rx(0.2, B_LAST[:-3]),
            tx(0.42, "15"),
            rx(0.5, B_LAST),
            tx(0.5, "06"),
            rx(0.51, "04"),
        ),
        ("gap in block", "NAK sent", "noise", R_TWO),
        {"gap_timeout_s": 0.22},
    ),
    Row(
        "block whose length is mutilated: NAK after silence",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, "10 02 00 00 01 00 13 04 05 00 10 03 18"),
            tx(0.24, "15"),
            rx(0.3, B_REPLY),
            tx(0.3, "06"),
            rx(0.31, "04"),
        ),
        ("bad block", "gap in block", "NAK sent", "noise", R_REPLY),
    ),
    Row(
        "garbage instead of a block: NAK after silence, three times",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            *(step for n in range(3) for step in (rx(n + 0.1, "55 AA"), tx(n + 0.32, "15"))),
            rx(3.1, "55 AA"),
        ),
        ("gap in block", "NAK sent", "noise") * 3 + ("gap in block", "gave up receiving", "noise"),
    ),
    Row(
        "endless garbage instead of a block does not hold the link for ever",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            *(rx(round(0.1 * n, 4), "FF") for n in range(1, 91)),
            tx(2.101, "15"),
            tx(4.201, "15"),
            tx(6.301, "15"),
        ),
        ("gap in block", "NAK sent") * 3 + ("gap in block", "gave up receiving", "noise"),
    ),
    Row(
        "noise before the block that was bid for",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, "FF 04" + B_REPLY), tx(0.02, "06"), rx(0.03, "04")),
        ("noise", R_REPLY),
    ),
    Row(
        "bad check character after garbage",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, "FF" + BAD_REPLY), tx(0.02, "15"), rx(0.03, "04")),
        ("bad block", "noise", "NAK sent", "failed: early EOT"),
    ),
    Row(
        "collision: the PC yields and bids again after the robot's EOT",
        HOST,
        (
            send(0, ASK),
            tx(0, "05"),
            rx(0.001, "05"),
            tx(0.001, "06"),
            rx(0.02, B_REPLY),
            tx(0.02, "06"),
            rx(0.03, "04"),
            tx(0.03, "05"),
            rx(0.04, "06"),
            tx(0.04, B_ASK),
            rx(0.06, "06"),
            tx(0.06, "04"),
        ),
        ("collision", R_REPLY, "sent"),
    ),
    Row(
        "collision: the robot waits for its ACK",
        ROBOT,
        (
            send(0, REPLY),
            tx(0, "05"),
            rx(0.001, "05"),
            rx(0.002, "06"),
            tx(0.002, B_REPLY),
            rx(0.02, "06"),
            tx(0.02, "04"),
        ),
        ("collision", "sent"),
    ),
    Row(
        "collision with the other winner: the robot yields",
        ROBOT,
        (
            send(0, REPLY),
            tx(0, "05"),
            rx(0.001, "05"),
            tx(0.001, "06"),
            rx(0.02, B_ASK),
            tx(0.02, "06"),
            rx(0.03, "04"),
            tx(0.03, "05"),
            rx(0.04, "06"),
            tx(0.04, B_REPLY),
            rx(0.06, "06"),
            tx(0.06, "04"),
        ),
        ("collision", R_ASK, "sent"),
        {"collision_winner": "host"},
    ),
    Row(
        "WACK: wait again",
        HOST,
        (
            send(0, ASK),
            tx(0, "05"),
            rx(1, "0E"),
            rx(2.9, "06"),
            tx(2.9, B_ASK),
            rx(4.8, "0E"),
            rx(6.7, "06"),
            tx(6.7, "04"),
        ),
        ("WACK received", "WACK received", "sent"),
    ),
    Row(
        "WACK: at most ten times for a bid",
        HOST,
        (send(0, ASK), tx(0, "05"), *(rx(n, "0E") for n in range(1, 12)), tx(11, "04")),
        ("WACK received",) * 11 + ("failed: asked to wait too often",),
    ),
    Row(
        "WACK: at most ten times for a block",
        HOST,
        (
            send(0, ASK),
            tx(0, "05"),
            rx(0.5, "06"),
            tx(0.5, B_ASK),
            *(rx(n, "0E") for n in range(1, 12)),
            tx(11, "04"),
        ),
        ("WACK received",) * 11 + ("failed: asked to wait too often",),
    ),
    Row(
        "RVI counts as ACK, the sender ends and listens",
        ROBOT,
        (
            send(0, MORE, LAST),
            send(0, REPLY),
            tx(0, "05"),
            rx(0.01, "06"),
            tx(0.01, B_MORE),
            rx(0.03, "0F"),
            tx(0.03, B_LAST),
            rx(0.05, "06"),
            tx(0.05, "04"),
            rx(0.06, "05"),
            tx(0.06, "06"),
            rx(0.08, B_STOP),
            tx(0.08, "06"),
            rx(0.09, "04"),
            tx(0.09, "05"),
            rx(0.1, "06"),
            tx(0.1, B_REPLY),
            rx(0.12, "06"),
            tx(0.12, "04"),
        ),
        ("RVI received", "sent", f"received {STOP.hex(' ').upper()}", "sent"),
    ),
    Row(
        "RVI to a bid and nobody bids then",
        ROBOT,
        (
            send(0, LAST),
            send(0, REPLY),
            tx(0, "05"),
            rx(0.01, "0F"),
            tx(0.01, B_LAST),
            rx(0.03, "0F"),
            tx(0.03, "04"),
            rx(0.1, B_ASK),
            tx(2.031, "05"),
            rx(2.1, "06"),
            tx(2.1, B_REPLY),
            rx(2.2, "06"),
            tx(2.2, "04"),
        ),
        ("RVI received", "RVI received", "sent", "stray block", "sent"),
    ),
    Row(
        "missing EOT: message ends after the gap time-out",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, B_REPLY), tx(0.02, "06")),
        ("missing EOT", R_REPLY),
        until=0.241,
    ),
    Row(
        "missing EOT: message ends at the next ENQ",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_REPLY),
            tx(0.02, "06"),
            rx(0.1, "05"),
            tx(0.1, "06"),
            rx(0.12, B_LAST),
            tx(0.12, "06"),
            rx(0.13, "04"),
        ),
        ("missing EOT", R_REPLY, R_LAST),
    ),
    Row(
        "mutilated EOT is a missing one",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, B_REPLY), tx(0.02, "06"), rx(0.03, "84")),
        ("missing EOT", R_REPLY, "noise"),
        until=0.25,
    ),
    Row(
        "EOT mutilated into a DLE is a missing one",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, B_REPLY), tx(0.02, "06"), rx(0.03, "10")),
        ("missing EOT", R_REPLY, "noise"),
        until=0.25,
    ),
    Row(
        "mutilated further block: NAK, the message goes on",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_MORE),
            tx(0.02, "06"),
            rx(0.04, "90" + B_LAST[2:]),
            tx(0.26, "15"),
            rx(0.3, B_LAST),
            tx(0.3, "06"),
            rx(0.31, "04"),
        ),
        ("gap in block", "NAK sent", "noise", R_TWO),
    ),
    Row(
        "mutilated length of a further block: NAK, the message goes on",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_MORE),
            tx(0.02, "06"),
            rx(0.04, "10 02 FF" + B_LAST[8:]),
            tx(0.26, "15"),
            rx(0.3, B_LAST),
            tx(0.3, "06"),
            rx(0.31, "04"),
        ),
        ("bad block", "gap in block", "NAK sent", "noise", R_TWO),
    ),
    Row(
        "our ACK was lost: the repeat after the missing EOT is acknowledged, not delivered twice",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_MORE),
            tx(0.02, "06"),
            rx(2.02, B_MORE),
            tx(2.02, "06"),
            rx(2.04, B_LAST),
            tx(2.04, "06"),
            rx(2.05, "04"),
        ),
        ("missing EOT", R_MORE, "duplicate dropped", R_LAST),
    ),
    Row(
        "our ACK was lost: a late EOT after the repeat delivers nothing",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_REPLY),
            tx(0.02, "06"),
            rx(2.02, B_REPLY),
            tx(2.02, "06"),
            rx(2.05, "04"),
        ),
        ("missing EOT", R_REPLY, "duplicate dropped"),
    ),
    Row(
        "receiver bids instead of answering a block: its ACK was lost, ours may have been taken",
        HOST,
        (
            send(0, ASK),
            tx(0, "05"),
            rx(0.01, "06"),
            tx(0.01, B_ASK),
            rx(0.3, "05"),
            tx(0.3, "06"),
            rx(0.32, B_REPLY),
            tx(0.32, "06"),
            rx(0.33, "04"),
        ),
        ("failed: interrupted", R_REPLY),
    ),
    Row(
        "receiver ends our message",
        HOST,
        (send(0, ASK), tx(0, "05"), rx(0.01, "06"), tx(0.01, B_ASK), rx(0.03, "04")),
        ("failed: aborted",),
    ),
    Row(
        "sender ends its message before a block came",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, "04")),
        ("failed: early EOT",),
    ),
    Row(
        "sender bids and falls silent",
        HOST,
        (rx(0, "05"), tx(0, "06")),
        ("time-out",),
        until=2.222,
    ),
    Row(
        "sender bids again though it was acknowledged",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(2, "05"), tx(2, "06"), rx(2.1, B_REPLY), tx(2.1, "06"), rx(2.2, "04")),
        (R_REPLY,),
    ),
    Row(
        "sender begins anew in the middle of a message",
        HOST,
        (
            rx(0, "05"),
            tx(0, "06"),
            rx(0.02, B_MORE),
            tx(0.02, "06"),
            rx(0.04, BAD_REPLY),
            tx(0.04, "15"),
            rx(0.1, "05"),
            tx(0.1, "06"),
            rx(0.12, B_LAST),
            tx(0.12, "06"),
            rx(0.13, "04"),
        ),
        ("bad block", "NAK sent", "failed: incomplete", R_LAST),
    ),
    Row(
        "noise between frames is dropped and counted",
        HOST,
        (
            rx(0, "FF 00 10 41"),
            rx(1, "41 05"),
            tx(1, "06"),
            rx(1.02, B_REPLY),
            tx(1.02, "06"),
            rx(1.03, "04"),
        ),
        ("noise", "noise", R_REPLY),
    ),
    Row(
        "half a frame at start-up that holds control bytes is not answered",
        HOST,
        (rx(0, "00 00 18 01 00 05 06 05 10 03 18"), rx(0.3, "05"), tx(0.3, "06"), rx(0.31, "04")),
        ("noise", "failed: early EOT"),
    ),
    Row(
        "half a frame at start-up",
        HOST,
        (
            rx(0, "00 00 10 03 18"),
            rx(0.5, "05"),
            tx(0.5, "06"),
            rx(0.6, B_REPLY),
            tx(0.6, "06"),
            rx(0.7, "04"),
        ),
        ("noise", R_REPLY),
    ),
    Row(
        "a block nobody bid for, whole and mutilated",
        HOST,
        (rx(0, B_REPLY), rx(1, BAD_REPLY), rx(2, B_REPLY[:20]), rx(3, "10 02 00 00")),
        ("stray block", "bad block", "stray block", "noise", "noise", "bad block", "noise"),
    ),
    Row(
        "a block repeated after its EOT is not acknowledged",
        HOST,
        (rx(0, "05"), tx(0, "06"), rx(0.02, B_REPLY), tx(0.02, "06"), rx(0.03, "04"), rx(1, B_REPLY)),
        (R_REPLY, "stray block"),
    ),
    Row(
        "what follows a stray block with a wrong check character is not answered",
        HOST,
        (rx(0, BAD_REPLY + "05"), rx(1, "05"), tx(1, "06"), rx(1.1, "04")),
        ("bad block", "stray block", "noise", "failed: early EOT"),
    ),
    Row(
        "each block has its own repeats",
        ROBOT,
        (
            send(0, MORE, LAST),
            tx(0, "05"),
            rx(0.01, "06"),
            tx(0.01, B_MORE),
            rx(0.03, "15"),
            tx(0.03, B_MORE),
            rx(0.05, "06"),
            tx(0.05, B_LAST),
            rx(0.07, "15"),
            tx(0.07, B_LAST),
            rx(0.09, "06"),
            tx(0.09, "04"),
        ),
        ("NAK received", "block repeated", "NAK received", "block repeated", "sent"),
        {"repeat_limit": 1},
    ),
    Row(
        "control bytes that mean nothing now",
        HOST,
        (rx(0, "04 06 15 0E 0F"),),
        ("stray control byte",) * 5,
    ),
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_row_of_section_2(row):
    expected = [(at, bytes.fromhex(text).hex(" ").upper()) for at, what, text in row.steps if what == "tx"]
    sent, events = play(row)
    assert sent == expected
    assert events == row.events


def bytes_only(sent):
    return "".join(text for _, text in sent).replace(" ", "")


@pytest.mark.parametrize("split", [1, 2, 5])
@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_any_split_gives_the_same_transcript(row, split):
    whole, events = play(row)
    cut, cut_events = play(row, split)
    assert bytes_only(cut) == bytes_only(whole)
    assert cut_events == events


def test_robot_takes_a_message_whose_length_counts_the_data_only():
    raw = bytes.fromhex("00 02 01 00 02 01 00 00 00 07")
    row = Row("", ROBOT, (rx(0, "05"), rx(0.02, encode_block(raw).hex()), rx(0.03, "04")), ())
    assert play(row)[1] == (f"received {raw.hex(' ').upper()}",)


def test_every_transition_of_the_table_is_taken_by_some_row(monkeypatch):
    taken = set()
    original = Link._step

    def spy(self, stimulus, size=0):
        before = self._state
        original(self, stimulus, size)
        if (before, stimulus) in TRANSITIONS:
            assert self._state in TRANSITIONS[before, stimulus].next
            taken.add((before, stimulus, self._state))
        else:
            assert self._state is before

    monkeypatch.setattr(Link, "_step", spy)
    for row in ROWS:
        play(row)
    pairs = {(state, stimulus) for state, stimulus, _ in taken}
    swallowed = {pair for pair, arrow in TRANSITIONS.items() if arrow.action is Action.SWALLOW}
    assert TRANSITIONS.keys() - pairs - swallowed == set()


@given(st.lists(st.one_of(st.binary(max_size=30), st.sampled_from([b"\x05", b"\x06", b"\x04", b"\x15"]))))
@settings(max_examples=100)
def test_arbitrary_bytes_lead_only_where_the_table_says(pieces):
    for role in Role:
        link = Link(role, profile())
        link.send([ASK])
        now = EPOCH
        for piece in pieces:
            link.receive(piece, now)
            link.data_to_send(now)
            if (deadline := link.next_deadline()) is not None and len(piece) % 2:
                now = max(now, deadline)
                link.handle_deadline(now)
        assert link.state in State


def test_send_refuses_what_cannot_travel():
    link = Link(HOST, LinkProfile())
    with pytest.raises(LocalProtocolError, match="at least one"):
        link.send([])
    with pytest.raises(LocalProtocolError, match="129 bytes is too long"):
        link.send([(129).to_bytes(2, "big") + bytes(127)])
    with pytest.raises(LocalProtocolError, match="another length"):
        link.send([b"\x00\x09" + bytes(6)])
    for _ in range(16):
        link.send([ASK])
    with pytest.raises(LocalProtocolError, match="16 messages"):
        link.send([ASK])


def test_counters_count_and_cannot_be_written():
    link = Link(HOST, LinkProfile())
    link.receive(b"\xff\xff\x05" + bytes.fromhex(B_REPLY) + b"\x04", 0.0)
    assert link.counters["messages received"] == link.counters["blocks received"] == 1
    assert link.counters["noise bytes"] == 2
    assert link.counters["noise"] == 1
    with pytest.raises(TypeError):
        link.counters["noise"] = 0


def test_buffers_are_bounded():
    link = Link(HOST, LinkProfile())
    link.receive(b"\x15" * 2000, 0.0)
    assert link.counters["events dropped"] == 2000 - 1024
    link = Link(HOST, LinkProfile())
    block = bytes.fromhex(B_MORE)
    link.receive(b"\x05" + block * 4097, 0.0)
    assert link.state is State.IDLE
    assert link.data_to_send(0.0)[-2:] == b"\x06\x04"
    assert told(link) == ("failed: too long",)


def test_receiving_is_true_from_the_bid_to_the_end():
    link = Link(HOST, LinkProfile())
    seen = []
    for data in (b"\x05", bytes.fromhex(B_REPLY), b"\x04"):
        link.receive(data, 0.0)
        seen.append(link.receiving)
    assert seen == [True, True, False]


def test_early_deadline_call_is_harmless():
    link = Link(HOST, LinkProfile())
    link.handle_deadline(5.0)
    link.send([ASK])
    assert link.data_to_send(5.0) == b"\x05"
    link.receive(b"\xff", 5.1)
    link.handle_deadline(5.2)
    assert told(link) == ()
    assert link.next_deadline() == 5.1 + 0.22


def test_texts_tell_people_what_to_check():
    texts = {}
    for name, noise in (("no answer", b""), ("only noise", b"\xff")):
        link = Link(HOST, LinkProfile(bid_limit=1))
        link.send([ASK])
        link.data_to_send(0.0)
        link.receive(noise, 0.1)
        link.handle_deadline(9.0)
        while (event := link.next_event()) is not None:
            if isinstance(event, LinkFailed):
                assert event.reason == name
                texts[name] = event.text
    assert "cable" in texts["no answer"]
    assert "parity" in texts["only noise"]


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
    assert LinkProfile(baudrate=1000, parity="N", stop_bits=2).character_time == 11 / 1000


def test_stimuli_of_the_table_are_all_used():
    assert {stimulus for _, stimulus in TRANSITIONS} == set(Stimulus)
    assert {arrow.action for arrow in TRANSITIONS.values()} == set(Action)

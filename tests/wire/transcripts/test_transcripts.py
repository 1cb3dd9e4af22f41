"""Transcripts of the line, each naming the specification rows that it covers, played against both ends.

A transcript begins with `==` and its name, then come `key: value` lines:

- `covers`: rows, see `ROWS`; for a refusal, its code;
- `ends`: the ends played against: `PC S3` (the default), or one if the other sends what no end of ours would;
- `mirror: no` unless it also holds with both ends exchanged (then the other side wins collisions);
- `link`: settings; `robot`: settings of the emulated controller; `verbose: yes`: bids and ACKs are reported;
- `crossing: yes` if both sides send before either has received.

Each further line is one thing: the time in ms, actor, action, and the bytes or words; `#` begins a comment, `00*3` is
`00 00 00`. `PC→S3` is sent by one end and received by the other; `PC→×` is lost and `×→PC` has no sender, so a byte
that is changed in transit is both. `PC queues` the telegrams of a message, separated by `|`, `PC announces` that it is
about to; `PC tells` an event.

What an end sends and reports must be in its transcript, in this order, at that millisecond, and nothing else.
"""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from emulators.devices.s3 import S3Controller, S3Profile, S3Profiles
from emulators.seams import StartPose
from protocol.devices.s3.adlp import (
    TRANSITIONS,
    Action,
    Link,
    LinkFailed,
    LinkNotice,
    LinkProfile,
    MessageReceived,
    MessageSent,
    Role,
    Stimulus,
)
from protocol.devices.s3.arap import Answered, ArapHost, RefusalCode, Refused, SpontaneousReceived, Telegram

EPOCH = 1234.5
FOLDER = Path(__file__).parent
OTHER = {"PC": "S3", "S3": "PC"}
ROLES = {"PC": Role.HOST, "S3": Role.ROBOT}

ROWS = {
    "control bytes": "ENQ 05, ACK 06, WACK 0E, RVI 0F, DLE 10, NAK 15, STX 02 and 82, ETX 03, EOT 04",
    "block": "DLE STX telegram DLE ETX BCC; BCC is the XOR of telegram and ETX",
    "exchange": "ENQ ACK block ACK EOT; either side may bid",
    "one EOT": "one EOT ends all blocks, a following block starts without a new ENQ",
    "NAK repeats": "NAK repeats the whole last block",
    "repeats end": "3 repeats, then EOT and a link error",
    "ACK is one byte": "06, not DLE 0 / DLE 1",
    "stuffing off": "DLE inside the telegram is not doubled",
    "stuffing double": "… or doubled, by the profile",
    "BCC is 10": "sent as is, never doubled",
    "STX 02 and 82": "the sender uses 02, the receiver accepts both",
    "STX toggle": "alternates per block from 02 at each ENQ, a repeat keeps its value",
    "STX parity": "82 for a telegram of odd length, else 02, as the observed client",
    "duplicate dropped": "STX equal to that of the last accepted block: acknowledged and dropped",
    "ENQ to ACK": "2.0 s",
    "block to ACK": "2.0 s",
    "gap": "0.22 s inside a block, then the block is dropped and NAK answered",
    "bids end": "3 ENQ, then link error",
    "collision": "the PC yields, and bids again after the EOT; or the S3, by the profile",
    "WACK": "wait again, at most 10 times, then link error",
    "RVI": "counts as ACK; the sender ends with EOT and listens",
    "largest telegram": "128 bytes; longer messages go as several blocks",
    "missing EOT": "the message is ended after one character time-out",
    "frames by length": "10 03 inside data; DLE ETX has to stand where the length says",
    "length styles": "the robot accepts whole length and data length, the host the whole one",
    "noise": "between frames",
    "start-up": "half a frame at start-up",
}
"""The rows of the specification's section 2 (and what is said below its table), each to be covered."""


@dataclass(frozen=True)
class Step:
    at: int
    who: str
    """`PC→S3`, `PC queues` and so on."""
    what: str


@dataclass(frozen=True)
class Transcript:
    name: str
    covers: tuple[str, ...] = ()
    ends: tuple[str, ...] = ("PC", "S3")
    mirror: bool = True
    crossing: bool = False
    verbose: bool = False
    link: dict = field(default_factory=dict)
    robot: dict = field(default_factory=dict)
    steps: tuple[Step, ...] = ()

    def mirrored(self):
        winner = self.link.get("collision_winner", "robot")
        return replace(
            self,
            ends=tuple(OTHER[end] for end in self.ends),
            link={**self.link, "collision_winner": "robot" if winner == "host" else "host"},
            steps=tuple(
                replace(step, who=re.sub("PC|S3", lambda match: OTHER[match[0]], step.who))
                for step in self.steps
            ),
        )


def settings(text):
    pairs = (item.split("=") for item in text.split(", "))
    return {
        key: value if not re.fullmatch(r"[\d.]+", value) else float(value) if "." in value else int(value)
        for key, value in pairs
    }


READERS = {
    "covers": lambda text: tuple(text.split(", ")),
    "ends": lambda text: tuple(text.split()),
    "mirror": lambda text: text == "yes",
    "crossing": lambda text: text == "yes",
    "verbose": lambda text: text == "yes",
    "link": settings,
    "robot": settings,
}


def read(path):
    """Return the transcripts of a file; text before the first one is a comment."""
    for part in re.split(r"^== ", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        name, *lines = part.splitlines()
        head, steps = {}, []
        for line in lines:
            line = line.partition("#")[0].strip()
            if match := re.fullmatch(r"(\d+) +((?:PC|S3) \w+|\S+→\S+) *(.*)", line):
                steps.append(Step(int(match[1]), match[2], match[3].strip()))
            elif line:
                key, _, value = line.partition(": ")
                head[key] = READERS[key](value)
        yield Transcript(name, **head, steps=tuple(steps))


def octets(text):
    repeated = re.sub(r"(\w\w)\*(\d+)", lambda match: " ".join([match[1]] * int(match[2])), text)
    return bytes.fromhex(repeated)


def telegrams(text):
    return [octets(part) for part in text.split("|")]


LINK_FILES = ("exchange.txt", "ahead.txt", "disturbed.txt")
LINKS = [item for name in LINK_FILES for item in read(FOLDER / name)]
ORDERS = list(read(FOLDER / "refusals.txt"))


class LinkEnd:
    """A `Link` and its events."""

    def __init__(self, transcript, end):
        self.endpoint = Link(ROLES[end], LinkProfile(**{"baudrate": 11000, **transcript.link}))
        self.endpoint.verbose = transcript.verbose

    def queues(self, text, now):
        self.endpoint.send(telegrams(text))

    def announces(self, text, now):
        self.endpoint.announce()

    def describe(self, event):
        match event:
            case MessageReceived(received):
                return "received " + " | ".join(raw.hex() for raw in received)
            case MessageSent():
                return "sent"
            case LinkFailed(reason):
                return f"failed: {reason}"
            case LinkNotice(kind):
                return str(kind)


class Host:
    """The client of the computer link."""

    def __init__(self, transcript, end):
        self.endpoint = ArapHost(LinkProfile(**{"baudrate": 11000, **transcript.link}))

    def queues(self, text, now):
        self.endpoint.order(*(Telegram.decode(raw, from_robot=False) for raw in telegrams(text)))

    def describe(self, event):
        match event:
            case Answered(_, answer):
                return f"answered {answer.encode().hex()}"
            case Refused(_, refusal):
                return f"refused {int(refusal.code)}"
            case SpontaneousReceived(spontaneous):
                return f"spontaneous {spontaneous.x}.{spontaneous.y}"
            case _:
                return str(event)


class Controller:
    """The emulated controller, with an operator."""

    def __init__(self, transcript, end):
        self.endpoint = S3Controller(
            S3Profiles(
                S3Profile(**{"turnaround_ms": 12.0, "turnaround_spread_ms": 0.0, **transcript.robot}),
                LinkProfile(**{"baudrate": 11000, **transcript.link}),
            ),
            StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0)),
            EPOCH,
            seed=1,
        )

    def does(self, text, now):
        match text.split():
            case ["emergency", "stop"]:
                self.endpoint.press_emergency_stop(now)
            case ["work", "stop"]:
                self.endpoint.set_work_stop(True, now)
            case ["key", "manual"]:
                self.endpoint.set_key(False, now)
            case ["take", "link", "control"]:
                self.endpoint.set_link_control(False, now)
            case ["refuse", code]:
                self.endpoint.inject("refuses", now, code=int(code))


class Player:
    """Plays a transcript as the peer of one end and compares step by step."""

    def __init__(self, transcript, end, make, split=None):
        self.transcript, self.end, self.split = transcript, end, split
        self.owner = make(transcript, end)
        self.endpoint = self.owner.endpoint
        self.sent = []
        """Bytes handed out and not yet in the transcript, as (ms, bytes)."""
        self.reported = []

    def flush(self, now):
        ms = round((now - EPOCH) * 1000, 3)
        if data := self.endpoint.data_to_send(now):
            self.sent.append((ms, data))
        while (event := self.endpoint.next_event()) is not None:
            self.reported.append((ms, self.owner.describe(event)))

    def advance(self, until):
        while (due := self.endpoint.next_deadline()) is not None and due <= until:
            self.endpoint.handle_deadline(due)
            self.flush(due)

    def hear(self, data, now):
        size = self.split or len(data)
        for at in range(0, len(data), size):
            self.endpoint.receive(data[at : at + size], now)

    def expect(self, step):
        data = octets(step.what)
        assert self.sent, f"nothing was said: {step}"
        at, output = self.sent.pop(0)
        assert output.startswith(data), f"{output.hex(' ')} was said: {step}"
        assert abs(at - step.at) < 0.51, f"it was said at {at} ms: {step}"
        if rest := output[len(data) :]:
            self.sent.insert(0, (at, rest))

    def play(self):
        end, reports = self.end, []
        for step in self.transcript.steps:
            now = EPOCH + step.at / 1000
            source, _, sink = step.who.partition("→")
            # A time-out of this very millisecond comes first, unless it is an answer to the bytes heard now.
            self.advance(now + 0.0004)
            if source == end:
                self.expect(step)
                continue
            match step.who.split():
                case [who, "tells"]:
                    reports += [(step.at, self.normal(step.what))] if who == end else []
                    continue
                case [who, doing]:
                    if who == end:
                        getattr(self.owner, doing)(step.what, now)
                case _:
                    if sink != end:
                        continue
                    assert self.transcript.crossing or not self.sent, f"{self.sent} was said before {step}"
                    self.hear(octets(step.what), now)
            self.flush(now)
        self.advance(EPOCH + 1000.0)
        assert not self.sent, f"{self.sent} was said at the end"
        assert [(round(at), text) for at, text in self.reported] == reports
        assert self.endpoint.next_deadline() is None, "every wait has to end"

    def normal(self, text):
        """An event's bytes as `told` writes them."""
        word, _, rest = text.partition(" ")
        if word not in ("received", "answered"):
            return text
        return f"{word} " + " | ".join(raw.hex() for raw in telegrams(rest))


def plays():
    for transcript in LINKS:
        for variant in (transcript, transcript.mirrored()) if transcript.mirror else (transcript,):
            for end in variant.ends:
                mirrored = " mirrored" if variant is not transcript else ""
                yield pytest.param(variant, end, id=f"{transcript.name}, {end}{mirrored}")


@pytest.mark.parametrize("split", [None, 1, 5], ids=["whole", "by 1", "by 5"])
@pytest.mark.parametrize(("transcript", "end"), list(plays()))
def test_link(transcript, end, split):
    Player(transcript, end, LinkEnd, split).play()


@pytest.mark.parametrize("transcript", ORDERS, ids=lambda item: item.name)
@pytest.mark.parametrize(("end", "make"), [("PC", Host), ("S3", Controller)], ids=["host", "controller"])
def test_refusal(transcript, end, make):
    Player(transcript, end, make).play()


def test_every_row_has_a_transcript_at_each_end():
    for end in ROLES:
        covered = {
            row
            for item in LINKS
            for variant in ((item, item.mirrored()) if item.mirror else (item,))
            if end in variant.ends
            for row in item.covers
        }
        assert ROWS.keys() <= covered
    assert len(LINKS) + len(ORDERS) >= 40


def test_every_refusal_has_a_transcript():
    assert {int(code) for item in ORDERS for code in item.covers} == {int(code) for code in RefusalCode}


def test_every_transition_is_covered_by_a_transcript(monkeypatch):
    covered = set()
    original = Link._step

    def spy(self, stimulus, size=0):
        before = self.state
        original(self, stimulus, size)
        if (before, stimulus) in TRANSITIONS:
            assert self.state in TRANSITIONS[before, stimulus].next
            covered.add((before, stimulus, self.state))
        else:
            assert self.state is before

    monkeypatch.setattr(Link, "_step", spy)
    for transcript in LINKS:
        for end in transcript.ends:
            Player(transcript, end, LinkEnd).play()
    pairs = {(state, stimulus) for state, stimulus, _ in covered}
    swallowed = {pair for pair, arrow in TRANSITIONS.items() if arrow.action is Action.SWALLOW}
    assert TRANSITIONS.keys() - pairs - swallowed == set()


def test_stimuli_of_the_table_are_all_used():
    assert {stimulus for _, stimulus in TRANSITIONS} == set(Stimulus)
    assert {arrow.action for arrow in TRANSITIONS.values()} == set(Action)

"""State diagrams of both roles of the link in docs/reference/computer-link.md, generated from the link's own table."""

import textwrap
from collections.abc import Iterator, Mapping
from functools import partial
from itertools import permutations

from protocol.devices.s3.adlp import TRANSITIONS, Action, LinkProfile, Role, State, Stimulus
from tools.pages import table
from tools.state_picture import Bend, Layout, draw_states

SENDING = {State.BIDDING, State.HOLDING, State.AWAITING_ACK}
"""States whose arrows are drawn in the sender's diagram. Arrows of the idle states are drawn in the diagram of
their target.
"""
NAMES = {Role.HOST: "PC", Role.ROBOT: "S3"}

PLACES = {
    State.IDLE: (150.0, 270.0),
    State.LISTENING: (430.0, 500.0),
    State.BIDDING: (430.0, 60.0),
    State.HOLDING: (430.0, 270.0),
    State.AWAITING_ACK: (860.0, 270.0),
    State.AWAITING_BLOCK: (860.0, 60.0),
}
SENDER = Layout(
    (960.0, 540.0),
    {state.value: place for state, place in PLACES.items()},
    {
        (State.IDLE.value, State.BIDDING.value): Bend(-55.0),
        (State.BIDDING.value, State.IDLE.value): Bend(-5.0, 0.45),
        (State.BIDDING.value, State.AWAITING_ACK.value): Bend(0.0, 0.22),
        (State.HOLDING.value, State.AWAITING_BLOCK.value): Bend(0.0, 0.25),
        (State.HOLDING.value, State.LISTENING.value): Bend(0.0, 0.3),
        (State.AWAITING_ACK.value, State.IDLE.value): Bend(-115.0, 0.3),
        (State.AWAITING_ACK.value, State.LISTENING.value): Bend(-45.0, 0.6),
    },
)
MORE_PLACES = {
    State.IDLE: (150.0, 240.0),
    State.AWAITING_BLOCK: (500.0, 60.0),
    State.AWAITING_MORE: (860.0, 240.0),
    State.DISCARDING: (500.0, 420.0),
}
APART = {
    (State.IDLE, State.AWAITING_MORE): Bend(-30.0, 0.36),
    (State.AWAITING_MORE, State.IDLE): Bend(-30.0, 0.18),
    (State.AWAITING_BLOCK, State.DISCARDING): Bend(-70.0),
    (State.DISCARDING, State.AWAITING_BLOCK): Bend(-70.0),
    (State.DISCARDING, State.AWAITING_MORE): Bend(-28.0, 0.35),
}
RECEIVER = Layout(
    (960.0, 470.0),
    {state.value: place for state, place in MORE_PLACES.items()},
    {
        (a.value, b.value): APART.get((a, b), Bend(-28.0))
        for a, b in permutations(MORE_PLACES, 2)
        if {a, b} != {State.IDLE, State.DISCARDING}
    },
)
"""Layout of the receiver's diagram. Chosen: no arrow crosses a box, and no labels overlap."""

INTRODUCTION = """\
`tools/link_diagrams.py` draws the diagrams from `protocol/devices/s3/adlp/transitions.py`, the table of both ends.
The label of an arrow is the stimulus. The table below has the actions, and the stimuli that do not change the state.
Both ends send and receive. They differ in precedence when both bid at once, and in the lengths that they
understand."""
RECEIVING = """\
The PC understands a length that counts the complete telegram, the S3 also one of the data alone (`accepted_lengths`).
Before it refuses a block, the S3 therefore waits for the end by the other length, or for the gap time-out. "Listening"
is the same as "idle" here."""
DOING = """\
A stimulus that is not listed for a state is ignored and counted. "Failed" is reported to the sender for its message,
and to the receiver for an incomplete one. "Gap" is silence inside a block or after garbage (`gap_timeout_s`); the other
time-outs are those of the state."""

_FIRST = {
    State.AWAITING_ACK: "message ready",
    State.HOLDING: "bid was ahead of its message",
    State.BIDDING: "read too late, ENQ again up to bid_limit",
    State.IDLE: "then failed",
}
_REPEATED = {State.AWAITING_ACK: "up to repeat_limit", State.IDLE: "then EOT, failed"}
_ENDED = {State.IDLE: "none left, EOT", State.LISTENING: "none left, EOT, line was requested"}
_STRAY = "else a stray one"
CONDITIONS: Mapping[Action, Mapping[State, str]] = {
    Action.COLLIDE: {State.BIDDING: "we go first", State.AWAITING_BLOCK: "the other side goes first"},
    Action.WAIT_LONGER: {
        State.BIDDING: "up to wack_limit",
        State.AWAITING_ACK: "up to wack_limit",
        State.IDLE: "then EOT, failed",
    },
    Action.BID_AGAIN: {State.BIDDING: "up to bid_limit", State.IDLE: "then failed"},
    Action.SEND_FIRST: _FIRST,
    Action.SEND_HELD: {
        State.AWAITING_ACK: "in time",
        State.IDLE: "too late, EOT",
        State.LISTENING: "too late, EOT, line was requested",
    },
    Action.RELEASE: {State.IDLE: "EOT", State.LISTENING: "EOT, line was requested"},
    Action.SEND_FIRST_REVERSED: _FIRST,
    Action.SEND_NEXT: {State.AWAITING_ACK: "more blocks", **_ENDED},
    Action.SEND_NEXT_REVERSED: {State.AWAITING_ACK: "more blocks", State.LISTENING: "none left, EOT"},
    Action.REPEAT_REFUSED: _REPEATED,
    Action.REPEAT_UNANSWERED: _REPEATED,
    Action.ACCEPT_BLOCK: {State.AWAITING_MORE: "ACK", State.IDLE: "too many, EOT, failed"},
    Action.REFUSE_BLOCK: {State.AWAITING_BLOCK: "NAK, up to repeat_limit", State.IDLE: "then failed"},
    Action.JUDGE_GARBAGE: {State.AWAITING_BLOCK: "NAK", State.IDLE: "a mutilated EOT, or NAKs used up"},
    Action.RECOGNISE_LATE: {
        State.AWAITING_MORE: "ACK, after a missing EOT",
        State.IDLE: _STRAY,
        State.LISTENING: _STRAY,
    },
}
"""Conditions that select the next state if an action has several."""


def transitions(role: Role) -> Iterator[tuple[State, Stimulus, Action, State]]:
    """Yield every state, stimulus, action and next state for this role in the default profile."""
    first = LinkProfile().collision_winner == role
    for (state, stimulus), transition in TRANSITIONS.items():
        for target in transition.next:
            if transition.action is Action.COLLIDE and (target is State.BIDDING) is not first:
                continue
            yield state, stimulus, transition.action, target


def is_sending(state: State, target: State) -> bool:
    """Return whether an arrow is drawn in the sender's diagram rather than in the receiver's."""
    return state in SENDING or target in SENDING or (state is State.LISTENING and target is State.IDLE)


def arrows(role: Role, sending: bool) -> dict[tuple[State, State], list[str]]:
    """Return the transitions for each pair of states. In the receiver's diagram, listening counts as idle."""
    pairs: dict[tuple[State, State], list[str]] = {}
    for state, stimulus, _, target in transitions(role):
        alike = state is State.LISTENING and TRANSITIONS.get((State.IDLE, stimulus)) is not None
        if target is not state and not alike and is_sending(state, target) is sending:
            pairs.setdefault((state, target), []).append(stimulus.value)
    return pairs


def labels(drawn: dict[tuple[State, State], list[str]]) -> dict[tuple[str, str], list[str]]:
    """Return the label lines of each arrow."""
    return {
        (source.value, target.value): textwrap.wrap(", ".join(stimuli), 18, break_on_hyphens=False)
        for (source, target), stimuli in drawn.items()
    }


def receiving() -> dict[tuple[State, State], list[str]]:
    """Return the receiver's arrows. Raises ValueError if the roles differ, because one picture shows both."""
    host, robot = (arrows(role, sending=False) for role in Role)
    if host != robot:
        raise ValueError("the roles receive differently: draw a diagram for each")
    return host


def draw_sending(role: Role) -> str:
    """Draw the states while this side sends."""
    title = f"States of the link while the {NAMES[role]} sends"
    return draw_states(title, labels(arrows(role, sending=True)), SENDER)


def draw_receiving() -> str:
    """Draw the states while either side receives."""
    return draw_states("States of the link while either side receives", labels(receiving()), RECEIVER)


def action_table() -> str:
    """Return action and next state, by state and stimulus."""
    rows = dict[tuple[str, str, str], list[str]]()
    for (state, stimulus), transition in TRANSITIONS.items():
        conditions = CONDITIONS.get(transition.action, {})
        targets = "; ".join(
            f"{target.value} ({conditions[target]})" if target in conditions else target.value
            for target in transition.next
        )
        done = state.value, transition.action.value.replace("_", " "), targets
        rows.setdefault(done, []).append(stimulus.value)
    lines = (
        (state, ", ".join(stimuli), action, targets) for (state, action, targets), stimuli in rows.items()
    )
    return table(("state", "stimulus", "action", "next state"), lines)


def section() -> str:
    """Return the text between the marks of the page."""
    parts = [INTRODUCTION]
    for role in Role:
        first = "goes first" if LinkProfile().collision_winner == role else "gives way"
        parts += [
            f"### The {NAMES[role]} sends",
            f"When both bid at once (ENQ while bidding), the {NAMES[role]} {first} (`collision_winner`).",
            f"![States of the link while the {NAMES[role]} sends](../pictures/link-{NAMES[role].lower()}-sends.svg)",
        ]
    picture = "![States of the link while either side receives](../pictures/link-receives.svg)"
    parts += ["### Either receives", RECEIVING, picture]
    return "\n\n".join([*parts, "### Actions", DOING, action_table()])


TABLES = {"state diagrams": section}
PICTURES = {
    **{f"link-{NAMES[role].lower()}-sends.svg": partial(draw_sending, role) for role in Role},
    "link-receives.svg": draw_receiving,
}

"""Behaviour of the data link as one table: state × stimulus → action and the possible next states.

A combination that is not in the table is ignored and counted. Source: computer-link specification, section 2.
"""

from dataclasses import dataclass
from enum import StrEnum


class State(StrEnum):
    """State of one end of the link between two stimuli."""

    IDLE = "idle"
    LISTENING = "listening"
    """Idle, but the other side requested the line (RVI) and may bid first."""
    BIDDING = "bidding"
    """We sent ENQ and wait for its acknowledge."""
    HOLDING = "holding the line"
    """Our bid was acknowledged, but its message is not queued yet."""
    AWAITING_ACK = "awaiting ACK"
    """We sent a block and wait for its acknowledge."""
    AWAITING_BLOCK = "awaiting block"
    """We acknowledged a bid or refused a block. A block must follow."""
    AWAITING_MORE = "awaiting more"
    """We acknowledged a block. Another block or EOT may follow."""
    DISCARDING = "discarding"
    """Garbage arrived instead of a block. We wait for silence, so that our NAK does not collide with the remaining
    bytes.
    """


class Stimulus(StrEnum):
    """Event that triggers a transition."""

    SEND = "message queued"
    ENQ = "ENQ"
    ACK = "ACK"
    NAK = "NAK"
    WACK = "WACK"
    RVI = "RVI"
    EOT = "EOT"
    BLOCK = "block"
    BAD_CHECKSUM = "bad checksum"
    MUTILATED = "mutilated block"
    NOISE = "noise"
    GAP = "gap"
    """A block stopped before its end, or garbage ended."""
    TIME_OUT = "time-out"


class Action(StrEnum):
    """Action of one end of the link. `Link._actions` lists the method for each action."""

    BID = "bid"
    BID_AGAIN = "bid_again"
    NOTE_BID_REFUSED = "note_bid_refused"
    COLLIDE = "collide"
    SEND_FIRST = "send_first"
    SEND_FIRST_REVERSED = "send_first_reversed"
    SEND_HELD = "send_held"
    RELEASE = "release"
    SEND_NEXT = "send_next"
    SEND_NEXT_REVERSED = "send_next_reversed"
    REPEAT_REFUSED = "repeat_refused"
    REPEAT_UNANSWERED = "repeat_unanswered"
    WAIT_LONGER = "wait_longer"
    ABORT = "abort"
    INTERRUPT = "interrupt"
    RESUME = "resume"
    ACCEPT_BID = "accept_bid"
    ACCEPT_BLOCK = "accept_block"
    REFUSE_BLOCK = "refuse_block"
    DISCARD = "discard"
    SWALLOW = "swallow"
    JUDGE_GARBAGE = "judge_garbage"
    DELIVER = "deliver"
    DELIVER_UNENDED = "deliver_unended"
    DELIVER_ACCEPT_BID = "deliver_accept_bid"
    END_EARLY = "end_early"
    ABANDON = "abandon"
    RECOGNISE_LATE = "recognise_late"


@dataclass(frozen=True, slots=True)
class Transition:
    """Entry of the table: an action and its possible next states. There are several if a limit or the profile
    decides.
    """

    action: Action
    next: tuple[State, ...]


def _to(action: Action, *states: State) -> Transition:
    return Transition(action, states)


_S, _X, _A = State, Stimulus, Action

TRANSITIONS: dict[tuple[State, Stimulus], Transition] = {
    (_S.IDLE, _X.SEND): _to(_A.BID, _S.BIDDING),
    (_S.IDLE, _X.ENQ): _to(_A.ACCEPT_BID, _S.AWAITING_BLOCK),
    (_S.IDLE, _X.BLOCK): _to(_A.RECOGNISE_LATE, _S.AWAITING_MORE, _S.IDLE),
    #
    (_S.LISTENING, _X.ENQ): _to(_A.ACCEPT_BID, _S.AWAITING_BLOCK),
    (_S.LISTENING, _X.BLOCK): _to(_A.RECOGNISE_LATE, _S.AWAITING_MORE, _S.LISTENING),
    (_S.LISTENING, _X.TIME_OUT): _to(_A.RESUME, _S.IDLE),
    #
    (_S.BIDDING, _X.ACK): _to(_A.SEND_FIRST, _S.AWAITING_ACK, _S.HOLDING, _S.BIDDING, _S.IDLE),
    (_S.BIDDING, _X.RVI): _to(_A.SEND_FIRST_REVERSED, _S.AWAITING_ACK, _S.HOLDING, _S.BIDDING, _S.IDLE),
    (_S.BIDDING, _X.NAK): _to(_A.NOTE_BID_REFUSED, _S.BIDDING),
    (_S.BIDDING, _X.WACK): _to(_A.WAIT_LONGER, _S.BIDDING, _S.IDLE),
    (_S.BIDDING, _X.ENQ): _to(_A.COLLIDE, _S.AWAITING_BLOCK, _S.BIDDING),
    (_S.BIDDING, _X.TIME_OUT): _to(_A.BID_AGAIN, _S.BIDDING, _S.IDLE),
    #
    (_S.HOLDING, _X.SEND): _to(_A.SEND_HELD, _S.AWAITING_ACK, _S.IDLE, _S.LISTENING),
    (_S.HOLDING, _X.TIME_OUT): _to(_A.RELEASE, _S.IDLE, _S.LISTENING),
    (_S.HOLDING, _X.EOT): _to(_A.RESUME, _S.IDLE),
    (_S.HOLDING, _X.ENQ): _to(_A.ACCEPT_BID, _S.AWAITING_BLOCK),
    #
    (_S.AWAITING_ACK, _X.ACK): _to(_A.SEND_NEXT, _S.AWAITING_ACK, _S.IDLE, _S.LISTENING),
    (_S.AWAITING_ACK, _X.RVI): _to(_A.SEND_NEXT_REVERSED, _S.AWAITING_ACK, _S.LISTENING),
    (_S.AWAITING_ACK, _X.NAK): _to(_A.REPEAT_REFUSED, _S.AWAITING_ACK, _S.IDLE),
    (_S.AWAITING_ACK, _X.TIME_OUT): _to(_A.REPEAT_UNANSWERED, _S.AWAITING_ACK, _S.IDLE),
    (_S.AWAITING_ACK, _X.WACK): _to(_A.WAIT_LONGER, _S.AWAITING_ACK, _S.IDLE),
    (_S.AWAITING_ACK, _X.EOT): _to(_A.ABORT, _S.IDLE),
    (_S.AWAITING_ACK, _X.ENQ): _to(_A.INTERRUPT, _S.AWAITING_BLOCK),
    #
    (_S.AWAITING_BLOCK, _X.BLOCK): _to(_A.ACCEPT_BLOCK, _S.AWAITING_MORE, _S.IDLE),
    (_S.AWAITING_BLOCK, _X.BAD_CHECKSUM): _to(_A.REFUSE_BLOCK, _S.AWAITING_BLOCK, _S.IDLE),
    (_S.AWAITING_BLOCK, _X.GAP): _to(_A.REFUSE_BLOCK, _S.AWAITING_BLOCK, _S.IDLE),
    (_S.AWAITING_BLOCK, _X.MUTILATED): _to(_A.DISCARD, _S.DISCARDING),
    (_S.AWAITING_BLOCK, _X.NOISE): _to(_A.DISCARD, _S.DISCARDING),
    (_S.AWAITING_BLOCK, _X.ENQ): _to(_A.ACCEPT_BID, _S.AWAITING_BLOCK),
    (_S.AWAITING_BLOCK, _X.EOT): _to(_A.END_EARLY, _S.IDLE),
    (_S.AWAITING_BLOCK, _X.TIME_OUT): _to(_A.ABANDON, _S.IDLE),
    #
    (_S.AWAITING_MORE, _X.BLOCK): _to(_A.ACCEPT_BLOCK, _S.AWAITING_MORE, _S.IDLE),
    (_S.AWAITING_MORE, _X.BAD_CHECKSUM): _to(_A.REFUSE_BLOCK, _S.AWAITING_BLOCK, _S.IDLE),
    (_S.AWAITING_MORE, _X.GAP): _to(_A.JUDGE_GARBAGE, _S.AWAITING_BLOCK, _S.IDLE),
    (_S.AWAITING_MORE, _X.MUTILATED): _to(_A.DISCARD, _S.DISCARDING),
    (_S.AWAITING_MORE, _X.NOISE): _to(_A.DISCARD, _S.DISCARDING),
    (_S.AWAITING_MORE, _X.ENQ): _to(_A.DELIVER_ACCEPT_BID, _S.AWAITING_BLOCK),
    (_S.AWAITING_MORE, _X.EOT): _to(_A.DELIVER, _S.IDLE),
    (_S.AWAITING_MORE, _X.TIME_OUT): _to(_A.DELIVER_UNENDED, _S.IDLE),
    #
    (_S.DISCARDING, _X.BLOCK): _to(_A.ACCEPT_BLOCK, _S.AWAITING_MORE, _S.IDLE),
    (_S.DISCARDING, _X.BAD_CHECKSUM): _to(_A.REFUSE_BLOCK, _S.AWAITING_BLOCK, _S.IDLE),
    (_S.DISCARDING, _X.GAP): _to(_A.JUDGE_GARBAGE, _S.AWAITING_BLOCK, _S.IDLE),
    (_S.DISCARDING, _X.TIME_OUT): _to(_A.JUDGE_GARBAGE, _S.AWAITING_BLOCK, _S.IDLE),
    **{
        (_S.DISCARDING, stimulus): _to(_A.SWALLOW, _S.DISCARDING)
        for stimulus in (_X.NOISE, _X.MUTILATED, _X.ENQ, _X.ACK, _X.NAK, _X.WACK, _X.RVI, _X.EOT)
    },
}

"""ADLP-10, the data link of the S3 computer link: control bytes, blocks, and both ends of the link."""

from protocol.adlp.block import (
    BLOCK_OVERHEAD,
    HEADER_SIZE,
    LENGTH_STYLES,
    SINGLE_CONTROLS,
    Block,
    BlockFormat,
    BlockScanner,
    Control,
    Flaw,
    Noise,
    Token,
    check_character,
    encode_block,
)
from protocol.adlp.events import (
    INCOMING_FAILURES,
    LinkEvent,
    LinkFailed,
    LinkFailure,
    LinkNotice,
    MessageReceived,
    MessageSent,
    NoticeKind,
)
from protocol.adlp.journal import EVENT_LIMIT, Count
from protocol.adlp.link import MESSAGE_LIMIT, QUEUE_LIMIT, Link, Role
from protocol.adlp.profile import DleStuffing, LengthStyle, LinkProfile
from protocol.adlp.transitions import TRANSITIONS, Action, State, Stimulus, Transition

__all__ = [
    "BLOCK_OVERHEAD",
    "EVENT_LIMIT",
    "HEADER_SIZE",
    "INCOMING_FAILURES",
    "LENGTH_STYLES",
    "MESSAGE_LIMIT",
    "QUEUE_LIMIT",
    "SINGLE_CONTROLS",
    "TRANSITIONS",
    "Action",
    "Block",
    "BlockFormat",
    "BlockScanner",
    "Control",
    "Count",
    "DleStuffing",
    "Flaw",
    "LengthStyle",
    "Link",
    "LinkEvent",
    "LinkFailed",
    "LinkFailure",
    "LinkNotice",
    "LinkProfile",
    "MessageReceived",
    "MessageSent",
    "Noise",
    "NoticeKind",
    "Role",
    "State",
    "Stimulus",
    "Token",
    "Transition",
    "check_character",
    "encode_block",
]

"""ADLP-10, the data link of the S3 computer link: control bytes, blocks, and both ends of the link.

The link gives a guarantee on a line where bytes are lost, duplicated, corrupted or late. The guarantee assumes that
no other byte is corrupted into a control byte, that no STX is corrupted into the other STX (no check character
covers them), and that an answer comes within `answer_timeout_s`. A telegram is then delivered at most once, in
order. `MessageSent` says that all telegrams of a message were delivered, `LinkFailed` that they may not have been.
Each message ends with one of the two events. The event comes within `bid_limit` answer time-outs for the bids,
`repeat_limit` + 1 answer time-outs for each block, one for each WACK, and the transmission time. A message may be
delivered in pieces if its sender's EOT or our ACK was late. With `stx_alternation = "off"`, all blocks start with
the same STX. The guarantee then holds only for a sender whose answer time-out is longer than the receiver's gap
time-out. If an ACK is late, the second of two equal consecutive telegrams may be mistaken for a repeat.

The link buffers one incomplete block, `QUEUE_LIMIT` messages to send, `MESSAGE_LIMIT` blocks of the incoming
message, and `EVENT_LIMIT` events. It also buffers bytes to send until the owner takes them. Their number is limited
by the bytes received and the messages queued.
"""

from protocol.devices.s3.adlp.block import (
    BLOCK_OVERHEAD,
    HEADER_SIZE,
    LENGTH_STYLES,
    SINGLE_CONTROLS,
    TRAILER,
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
from protocol.devices.s3.adlp.events import (
    INCOMING_FAILURES,
    ROUTINE,
    LinkEvent,
    LinkFailed,
    LinkFailure,
    LinkNotice,
    MessageReceived,
    MessageSent,
    NoticeKind,
    Role,
)
from protocol.devices.s3.adlp.journal import EVENT_LIMIT, Count
from protocol.devices.s3.adlp.link import Link
from protocol.devices.s3.adlp.profile import (
    CHUNK,
    DEFAULT_PROFILE,
    OBSERVED_CLIENT,
    PROFILES,
    DleStuffing,
    LengthStyle,
    LinkProfile,
    settings_of_profile,
)
from protocol.devices.s3.adlp.receiving import MESSAGE_LIMIT
from protocol.devices.s3.adlp.transitions import TRANSITIONS, Action, State, Stimulus, Transition

__all__ = [
    "BLOCK_OVERHEAD",
    "CHUNK",
    "DEFAULT_PROFILE",
    "EVENT_LIMIT",
    "HEADER_SIZE",
    "INCOMING_FAILURES",
    "LENGTH_STYLES",
    "MESSAGE_LIMIT",
    "OBSERVED_CLIENT",
    "PROFILES",
    "ROUTINE",
    "SINGLE_CONTROLS",
    "TRAILER",
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
    "settings_of_profile",
]

"""ADLP-10, the data link of the S3 computer link: control bytes, blocks, and both ends of the link.

The link's promise holds on a line where bytes get lost, doubled, changed or late. But no byte becomes a control byte by
itself, nor one STX the other (no check character covers it), and an answer comes within `answer_timeout_s`. A telegram
is then delivered once at the most, in order. `MessageSent` says that all telegrams of a message were delivered,
`LinkFailed` that they may not have been. One of them comes for each message. It comes within `bid_limit` answer
time-outs for its bids, `repeat_limit` + 1 for each block, one for each WACK, and the line's time. A message may be
delivered in pieces where its sender's EOT or our ACK was late. With `stx_alternation = "off"` all blocks begin with the
same STX. Then the promise holds only for a sender whose answer time-out is longer than the receiver's gap time-out. Of
two equal telegrams in a row the second may be taken for a repeat when an ACK is late.

The link keeps one unfinished block, `QUEUE_LIMIT` messages to send, `MESSAGE_LIMIT` blocks of the incoming message, and
`EVENT_LIMIT` events. It also keeps bytes to send until they are taken, no more than bytes came and messages hold.
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

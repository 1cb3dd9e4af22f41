"""A telegram whose data exceed one block travels as several telegrams, a block each.

Observed: all but the last have a "further block follows" type, and the data behind the headers join up. Assumed:
the last has the type that a single telegram would have, and every one repeats function and suffix.
"""

from collections.abc import Sequence

from protocol.devices.s3.adlp import HEADER_SIZE, MESSAGE_LIMIT
from protocol.devices.s3.arap.codes import TelegramType
from protocol.devices.s3.arap.telegram import Telegram
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

# Asked for with every telegram, by names of this module: until Python 3.12 an enum's own name costs five times that.
_FURTHER_FROM_ROBOT, _FURTHER_FROM_PC = TelegramType.FURTHER_FROM_ROBOT, TelegramType.FURTHER_FROM_PC


def further_type(from_robot: bool) -> TelegramType:
    """Type of every block but the last of a long telegram."""
    return _FURTHER_FROM_ROBOT if from_robot else _FURTHER_FROM_PC


def split_telegram(telegram: Telegram, max_telegram: int) -> tuple[Telegram, ...]:
    """Split a telegram for its blocks: one, or as many as blocks of `max_telegram` bytes need.

    Raises LocalProtocolError when that is more than one message may have.
    """
    room = max_telegram - HEADER_SIZE
    data = telegram.data
    parts = [data[at : at + room] for at in range(0, len(data), room)] or [b""]
    if len(parts) > MESSAGE_LIMIT:
        raise LocalProtocolError(
            f"{len(data)} bytes of data are too long: {MESSAGE_LIMIT} blocks of {room} are the most"
        )
    further = further_type(telegram.from_robot)
    return (
        *(telegram._replace(type=further, data=part) for part in parts[:-1]),
        telegram._replace(data=parts[-1]),
    )


def join_blocks(blocks: Sequence[Telegram]) -> Telegram:
    """Join the blocks of a telegram: the header of the last, the data of all in order.

    Raises RemoteProtocolError when they do not belong together, or the last announces another one.
    """
    last = blocks[-1]
    further = further_type(last.from_robot)
    if len(blocks) == 1 and last.type != further:
        return last
    for number, block in enumerate(blocks[:-1], 1):
        if (block.function, block.type) != (last.function, further):
            raise RemoteProtocolError(f"block {number} of {len(blocks)} is none of a long telegram: {block}")
    if last.type == further:
        raise RemoteProtocolError(f"a further block was announced and did not come: {last}")
    return last._replace(data=b"".join(block.data for block in blocks))

"""Splitting of a telegram whose data exceeds one block into several telegrams, one per block, and joining of such
telegrams.

Observed: all telegrams but the last have a type that means "further block follows", and their data is concatenated.
Assumed: the last telegram has the type of a single telegram, and all of them have the same function and suffix.
"""

from collections.abc import Sequence

from protocol.devices.s3.adlp import HEADER_SIZE, MESSAGE_LIMIT
from protocol.devices.s3.arap.codes import TelegramType
from protocol.devices.s3.arap.telegram import Telegram
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

# Used with every telegram, so bound to module names: before Python 3.12 an enum member lookup is five times slower.
_FURTHER_FROM_ROBOT, _FURTHER_FROM_PC = TelegramType.FURTHER_FROM_ROBOT, TelegramType.FURTHER_FROM_PC


def further_type(from_robot: bool) -> TelegramType:
    """Return the type of every telegram but the last when a telegram with this type is split."""
    return _FURTHER_FROM_ROBOT if from_robot else _FURTHER_FROM_PC


def split_telegram(telegram: Telegram, max_telegram: int) -> tuple[Telegram, ...]:
    """Split a telegram into the minimum number of telegrams of at most `max_telegram` bytes.

    Raises LocalProtocolError if one message cannot hold that many.
    """
    room = max_telegram - HEADER_SIZE
    data = telegram.data
    parts = [data[at : at + room] for at in range(0, len(data), room)] or [b""]
    if len(parts) > MESSAGE_LIMIT:
        raise LocalProtocolError(
            f"{len(data)} bytes of data are too long; allowed: at most {MESSAGE_LIMIT} blocks of {room}"
        )
    further = further_type(telegram.from_robot)
    return (
        *(telegram._replace(type=further, data=part) for part in parts[:-1]),
        telegram._replace(data=parts[-1]),
    )


def join_blocks(blocks: Sequence[Telegram]) -> Telegram:
    """Join the telegrams of several blocks: the header of the last one, and the data of all in order.

    Raises RemoteProtocolError if they do not belong together, or if the last one announces another block.
    """
    last = blocks[-1]
    further = further_type(last.from_robot)
    if len(blocks) == 1 and last.type != further:
        return last
    for number, block in enumerate(blocks[:-1], 1):
        if (block.function, block.type) != (last.function, further):
            raise RemoteProtocolError(
                f"block {number} of {len(blocks)} is not part of a long telegram: {block}"
            )
    if last.type == further:
        raise RemoteProtocolError(f"a further block was announced but not received: {last}")
    return last._replace(data=b"".join(block.data for block in blocks))

"""Every codec decodes random, broken and complete bytes as it did before its fields were in a table.

`codecs.jsonl` was written by the codecs of that time: name, bytes, and the values or the text of the refusal. Its bytes
include complete messages, messages with one bit or letter changed, truncated ones, and random ones.
"""

import enum
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from protocol.devices.ati_can import messages as ati
from protocol.devices.egm import messages as egm
from protocol.devices.ft300 import messages as ft300
from protocol.devices.netft import records
from protocol.devices.rsi import telegram
from protocol.devices.rtde import packets
from protocol.devices.rtde.fields import OUTPUTS, Recipe
from protocol.endpoint import RemoteProtocolError

RECIPES = (
    ("timestamp", "actual_q", "robot_mode"),
    ("actual_TCP_pose", "safety_status_bits", "output_bit_register_64", "actual_digital_input_bits"),
    ("joint_mode", "payload_cog", "speed_scaling"),
)
READERS: Mapping[str, Callable[[bytes], Any]] = {
    "netft.request": records.decode_request,
    "netft.record": records.decode_record,
    "ft300.message": ft300.decode_message,
    "ft300.request": ft300.decode_request,
    "ft300.words": ft300.words_of,
    "ati_can.sample": ati.decode_sample,
    "ati_can.sample_rest": ati.decode_sample_rest,
    "ati_can.pair": ati.decode_pair,
    "ati_can.counts": ati.decode_counts,
    "ati_can.units": ati.decode_units,
    "ati_can.firmware": ati.decode_firmware,
    "rtde.version_request": packets.read_version_request,
    "rtde.accepted": packets.read_accepted,
    "rtde.controller_version": packets.read_controller_version,
    "rtde.outputs_request": packets.read_outputs_request,
    "rtde.types": packets.read_types,
    "rtde.text": packets.read_text,
    **{
        f"rtde.recipe {k + 1}": Recipe(k + 1, names, tuple(OUTPUTS[name].type for name in names)).unpack
        for k, names in enumerate(RECIPES)
    },
    "rsi.telegram": telegram.decode,
    "egm.robot": egm.decode_robot,
    "egm.answer": egm.decode_answer,
}
LINES = [
    json.loads(line)
    for line in (Path(__file__).parent / "codecs.jsonl").read_text(encoding="utf-8").splitlines()
]


def plain(value: Any) -> Any:
    """Return a value in the format of the transcript: numbers with all their digits, tuples as lists."""
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, enum.Enum):
        return value.value
    return repr(value) if isinstance(value, float) else value


@pytest.mark.parametrize("name", READERS)
def test_codec_decodes_as_before(name: str) -> None:
    mine = [line for line in LINES if line[0] == name]
    assert len(mine) == 14
    for _, data, expected in mine:
        try:
            read = plain(READERS[name](bytes.fromhex(data)))
        except RemoteProtocolError as error:
            read = {"refused": str(error)}
        assert read == expected, data

"""Recorded sessions of compiled third-party sensor drivers, replayed and read by our decoders.

Robotiq's own driver of the FT 300 finds the sensor on a serial line, asks for its version, year and number, and
streams. A driver of ATI's NETCANOEM asks a board for all that it tells, reads five samples, and takes a bias. Its CAN
socket is one to our board, which is given each frame; all else of both drivers is as it was compiled.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from protocol.can.frame import CanFrame
from protocol.devices.ati_can import messages as ati
from protocol.devices.ft300.messages import SCALES, StreamReader, decode_request, find_answer, words_of
from tools.client_transcripts import CLIENT, DEVICE, WRENCH, Transcript, read, read_frame, replayed

FOLDER = Path(__file__).with_name("drivers")
FT300 = read(FOLDER / "ft300-robotiq.txt")
BOARD = read(FOLDER / "ati-can-tri-hardware-drivers.txt")
BASE = 0x20


@pytest.mark.parametrize("transcript", [FT300, BOARD])
def test_emulated_sensor_repeats_every_byte_to_a_driver(transcript: Transcript) -> None:
    output = [step for step in transcript.steps if step.side == DEVICE]
    assert len(output) > 10
    assert replayed(transcript) == output


# --- Robotiq FT 300


def test_registers_match_the_robotiq_driver() -> None:
    """The low word of the number comes first."""
    registers = {}
    requests = [decode_request(data) for data in FT300.made_by(CLIENT, "serial")]
    answered = [data for data in FT300.made_by(DEVICE, "serial") if data[0] == 9]
    for request, data in zip(requests[1:], answered, strict=True):  # the first comes while it boots
        if request.function == 3:
            payload, _ = find_answer(data, 3, len(data)) or (b"", 0)
            assert isinstance(payload, bytes)
            registers[request.register] = words_of(payload)
    assert (requests[-1].function, requests[-1].register, requests[-1].values) == (16, 410, (0x0200,))
    version, number = (b"".join(word.to_bytes(2, "big") for word in registers[place]) for place in (500, 510))
    low, high = registers[510][2:]
    assert FT300.reads[0] == {
        "firmware": f"{version[:3].decode()}-{version[3]}.{version[4]}.{version[5]}",
        "serial": f"{number[:3].decode()}-{high << 16 | low}",
        "year": str(registers[514][0]),
    }
    assert (low, high) == (0x5678, 0x1234)


def test_stream_is_read_as_robotiqs_driver_reads_it() -> None:
    streamed = StreamReader().feed(b"".join(FT300.made_by(DEVICE, "serial")))
    rows = [
        [round(count * scale, 3) for count, scale in zip(counts, SCALES, strict=True)] for counts in streamed
    ]
    for row in FT300.reads[1:]:
        assert pytest.approx(row["wrench"]) in rows


# --- ATI NETCANOEM


def frames(side: str) -> list[CanFrame]:
    return [read_frame(data) for data in BOARD.made_by(side, "can")]


def reads(key: str) -> list[Any]:
    return [row[key] for row in BOARD.reads if key in row]


def answers(op: int) -> list[bytes]:
    return [frame.data for frame in frames(DEVICE) if frame.identifier == ati.identifier(BASE, op)]


def test_driver_requests_match_ours() -> None:
    requests = frames(CLIENT)
    ours = [
        ati.question(BASE, ati.Op.FIRMWARE),
        ati.question(BASE, ati.Op.SERIAL),
        ati.question(BASE, ati.Op.COUNTS),
    ]
    assert requests[:3] == ours
    assert ati.question(BASE, ati.Op.SLOT, 0) in requests
    rows = [frame for frame in requests if frame.identifier == ati.identifier(BASE, ati.Op.ROW)]
    assert rows == 2 * [ati.question(BASE, ati.Op.ROW, axis) for axis in range(6)]
    assert requests[-1] == ati.question(BASE, ati.Op.RESET)


def test_facts_of_the_board_are_read_as_the_driver_reads_them() -> None:
    assert reads("firmware") == [list(ati.decode_firmware(answers(ati.Op.FIRMWARE)[0]))]
    assert reads("counts") == [list(ati.decode_counts(answers(ati.Op.COUNTS)[0]))]
    assert reads("serial") == [answers(ati.Op.SERIAL)[0].rstrip(b"\0").decode()]
    assert reads("units") == [list(answers(ati.Op.UNITS)[0])]
    assert reads("adc") == [[int.from_bytes(data, "big") for data in answers(ati.Op.DIAGNOSIS)]]
    pairs = [[ati.decode_pair(data) for data in answers(op)] for op in (2, 3, 4)]
    matrix = [[value for pair in row for value in pair] for row in zip(*pairs, strict=True)]
    assert reads("matrix") == [matrix[6:]] == [matrix[:6]]


def test_gages_and_wrench_are_those_of_the_driver() -> None:
    """The wrench equals the sensor's too, within the rounding of the gages to counts."""
    (matrix,) = reads("matrix")
    starts = [ati.decode_sample(data) for data in answers(ati.Op.SAMPLE)]
    rests = [ati.decode_sample_rest(data) for data in answers(ati.Op.SAMPLE + 1)]
    assert len(starts) == len(rests) == 12, (
        "five samples told as they are, five as wrenches, two for the bias"
    )
    gages = [
        [start.gages[0], rest[0], start.gages[1], rest[1], start.gages[2], rest[2]]
        for start, rest in zip(starts, rests, strict=True)
    ]
    assert reads("gages") == gages[0:10:2]
    assert reads("status") == [start.status for start in starts[0:10:2]]
    for reports, counted in zip(reads("wrench"), gages[1:10:2], strict=True):
        assert reports == pytest.approx(list(np.array(matrix) @ counted / 1e6), abs=1e-9)
        assert reports == pytest.approx(WRENCH, abs=2e-3)
    assert reads("biased") == [[0.0] * 6]

"""Recorded sessions of third-party clients, replayed against our emulated devices and through our decoders.

The bytes of the client are not produced by our code. The values that it read from our device's bytes are in its own
output.
"""

from itertools import pairwise

import pytest

from protocol.devices.egm import decode_answer, decode_robot
from protocol.devices.ft300.messages import (
    SCALES,
    StreamReader,
    decode_request,
    find_answer,
    request_size,
    signed,
    words_of,
)
from protocol.devices.netft.http import read_answer, read_get
from protocol.devices.netft.page import parse_page
from protocol.devices.netft.records import Command, decode_record
from protocol.devices.netft.records import decode_request as decode_rdt
from protocol.devices.rsi.elements import pose_tags
from protocol.devices.rsi.telegram import decode
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.packets import (
    Kind,
    Reader,
    read_outputs_request,
    read_types,
    read_version_request,
    split_names,
)
from tools.client_scripts import SESSIONS
from tools.client_transcripts import CLIENT, DEVICE, FOLDER, Step, octets, read, replayed, write, written

TRANSCRIPTS = {path.stem: read(path) for path in sorted(FOLDER.glob("*.txt"))}


def of(device):
    return pytest.mark.parametrize("name", [name for name in TRANSCRIPTS if name.startswith(device)])


@pytest.mark.parametrize("name", TRANSCRIPTS)
def test_emulated_device_repeats_every_byte(name):
    transcript = TRANSCRIPTS[name]
    assert replayed(transcript) == [step for step in transcript.steps if step.side == DEVICE]


def test_every_session_has_its_transcript_with_the_pinned_client():
    assert {name: session.client[0].replace("==", " ") for name, session in SESSIONS.items()} == {
        name: transcript.head["client"] for name, transcript in TRANSCRIPTS.items()
    }
    for transcript in TRANSCRIPTS.values():
        assert all(before.at_ms <= after.at_ms for before, after in pairwise(transcript.steps))
        assert transcript.reads


@pytest.mark.parametrize("data", [b"", b"GET /\r\n", b'"', b"\x00\xff", bytes(range(256))])
def test_data_files_are_stored_unchanged(data):
    assert octets(written(data)) == data


def test_file_holds_all_of_a_transcript(tmp_path):
    for transcript in TRANSCRIPTS.values():
        write(transcript, tmp_path / "again")
        assert read(tmp_path / "again") == transcript


def test_unexpected_client_byte_is_detected():
    """The devices answer what they receive, so a replay is more than a repetition."""
    transcript = TRANSCRIPTS["netft-netft"]
    steps = [step._replace(data=step.data[:-1] + b"\3") if step.data else step for step in transcript.steps]
    spoilt = type(transcript)(transcript.head, steps)
    assert replayed(spoilt) != [step for step in transcript.steps if step.side == DEVICE]


# --- EGM


@of("egm")
def test_egm_is_read_as_the_client_reads_it(name):
    reports = {
        message.seqno: message for message in map(decode_robot, TRANSCRIPTS[name].made_by(DEVICE, "egm"))
    }
    for read_there in TRANSCRIPTS[name].reads:
        place = reports[read_there["seqno"]].feedback
        assert list(place.pose.position_mm) == read_there["position_mm"]
        assert list(place.pose.quaternion) == read_there["quaternion"]
        assert list(place.joints_deg) == read_there["joints_deg"]


@of("egm")
def test_egm_is_understood_as_the_client_meant_it(name):
    messages = [decode_answer(data) for data in TRANSCRIPTS[name].made_by(CLIENT, "egm")]
    assert len(messages) == len(TRANSCRIPTS[name].sends) == 12
    for message, sent in zip(messages, TRANSCRIPTS[name].sends, strict=True):
        if "offset_mm" in sent:
            assert (list(message.offset_mm), message.age_ms) == (sent["offset_mm"], 1)
            continue
        assert list(message.joints_deg) == sent.get("joints_deg", [])
        assert list(message.speed) == sent.get("speed", [])
        if "position_mm" in sent:
            assert list(message.pose.position_mm) == sent["position_mm"]
            assert list(message.pose.quaternion) == sent["quaternion"]
    # abb_robot_client counts by two
    assert {after.seqno - before.seqno for before, after in pairwise(messages)} in ({1}, {2})


# --- RTDE


def packets(transcript, side, wire):
    reader = Reader()
    for step in transcript.steps:
        if (step.side, step.wire) == (side, wire):
            reader.feed(step.data)
    result = []
    while (packet := reader.next_packet()) is not None:
        result.append(packet)
    assert reader.waiting == 0
    return result


def test_ur_rtde_requests_match_and_our_replies_are_read():
    transcript = TRANSCRIPTS["rtde-ur-rtde"]
    requests, reports = (packets(transcript, side, "rtde-1") for side in (CLIENT, DEVICE))
    assert read_version_request(requests[0].payload) == 2
    (outputs,) = (packet for packet in requests if packet.kind == Kind.OUTPUTS)
    frequency, names = read_outputs_request(outputs.payload)
    assert frequency == 25.0
    assert names[:3] == ("timestamp", "actual_TCP_pose", "actual_q")
    (types,) = (read_types(packet.payload) for packet in reports if packet.kind == Kind.OUTPUTS)
    recipe = Recipe(types.recipe, names, types.types)
    values = [recipe.values(recipe.unpack(packet.payload)) for packet in reports if packet.kind == Kind.DATA]
    assert values[1]["timestamp"] - values[0]["timestamp"] == pytest.approx(0.04)
    keys = transcript.reads[0].keys()
    rows = [[list(one) if isinstance(one, tuple) else one for one in map(row.get, keys)] for row in values]
    for read_there in transcript.reads[:-1]:
        assert list(read_there.values()) in rows


def inputs(transcript, wire):
    """Return the inputs that the client has set, each package as values by name."""
    sent, reports = (packets(transcript, side, wire) for side in (CLIENT, DEVICE))
    requests = [split_names(packet.payload) for packet in sent if packet.kind == Kind.INPUTS]
    types = [read_types(packet.payload) for packet in reports if packet.kind == Kind.INPUTS]
    recipes = {
        answer.recipe: Recipe(answer.recipe, names, answer.types)
        for names, answer in zip(requests, types, strict=True)
    }
    data = [packet.payload for packet in sent if packet.kind == Kind.DATA]
    return [recipes[payload[0]].values(recipes[payload[0]].unpack(payload)) for payload in data]


def test_ur_rtde_inputs_are_decoded():
    transcript = TRANSCRIPTS["rtde-ur-rtde"]
    values = inputs(transcript, "rtde-2")
    slider, output = transcript.sends
    assert any(row.items() >= {**slider, "speed_slider_mask": 1}.items() for row in values)
    assert any(row.items() >= {**output, "standard_digital_output_mask": 2}.items() for row in values)


def test_servoing_ur_rtde_is_decoded_and_its_text_dropped():
    transcript = TRANSCRIPTS["rtde-ur-rtde-control"]
    values = inputs(transcript, "rtde-1")
    numbers = [f"input_double_register_{number}" for number in range(6)]
    ordered = [[row[name] for name in numbers] for row in values if numbers[-1] in row]
    for sent in transcript.sends:
        assert sent["servoL"] in ordered
    assert transcript.reads == [{"offset": [0.0, 0.0, 0.2, 0.0, 0.0, 0.0]}]
    program = b"def rtde_control():\n# float register offset\n0\nend\n"
    assert set(transcript.made_by(CLIENT, "script")) == {program}


def test_ur_rtde_reads_the_dashboard():
    transcript = TRANSCRIPTS["rtde-ur-rtde"]
    output = b"".join(transcript.made_by(DEVICE, "dashboard")).decode().splitlines()
    assert transcript.reads[-1] == {
        "robotmode": output[1],
        "safetymode": output[2],
        "running": "true" in output[3],
    }


# --- Net F/T


def test_netft_is_read_as_pynetft_reads_it():
    transcript = TRANSCRIPTS["netft-pynetft"]
    (request,) = transcript.made_by(CLIENT, "page")
    assert read_get(request) == "/netftapi2.xml"
    page = parse_page(read_answer(b"".join(transcript.made_by(DEVICE, "page"))))
    records = {
        record.rdt_sequence: record for record in map(decode_record, transcript.made_by(DEVICE, "rdt"))
    }
    *samples, about = transcript.reads
    assert page.product == f"{about['product']} default"  # with the name of the calibration
    for sample in samples:
        values = [
            count * scale
            for count, scale in zip(records[sample["rdt_sequence"]].counts, page.scales, strict=True)
        ]
        assert [*sample["forces"], *sample["moments"]] == pytest.approx(values, abs=1e-9)


def test_netft_is_read_as_the_other_client_reads_it():
    transcript = TRANSCRIPTS["netft-netft"]
    records = [decode_record(data) for data in transcript.made_by(DEVICE, "rdt")]
    assert [list(record.counts) for record in records[:3]] == [one["counts"] for one in transcript.reads]


def test_requests_of_both_clients_are_understood():
    requests = {
        name: [decode_rdt(data) for data in TRANSCRIPTS[name].made_by(CLIENT, "rdt")]
        for name in ("netft-netft", "netft-pynetft")
    }
    assert [(request.command, request.records) for request in requests["netft-netft"]] == [
        *[(Command.START, 1)] * 3,
        (Command.START, 0),
        (Command.STOP, 0),
    ]
    assert requests["netft-pynetft"][0].command == Command.START
    assert requests["netft-pynetft"][-1].command == Command.STOP


# --- FT 300


def test_ft300_is_read_as_ft300python_reads_it():
    transcript = TRANSCRIPTS["ft300-ft300python"]
    registers = dict(answers(transcript))
    messages = StreamReader().feed(b"".join(transcript.made_by(DEVICE, "serial")))
    streamed = [scaled(counts) for counts in messages]
    for row in transcript.reads:
        if "streamed" in row:
            assert pytest.approx(row["streamed"]) in streamed
    reports = {
        "asked": scaled(map(signed, registers["asked"])),
        "serial": list(registers["serial"]),
        "year": registers["year"][0],
        "acceleration": [signed(word) / 1000 for word in registers["acceleration"]],
    }
    assert [*reports.items()] == [
        pair for row in transcript.reads for pair in row.items() if "streamed" not in row
    ]


def scaled(counts):
    return [count * scale for count, scale in zip(counts, SCALES, strict=True)]


def answers(transcript):
    """Return the client's Modbus requests, with the registers in our responses."""
    steps = [step for step in transcript.steps if step.data]
    requests = [
        (step.data, after.data)
        for step, after in pairwise(steps)
        if step.side == CLIENT and after.data[0] == 9
    ]
    reads = [
        (decode_request(question), answer)
        for question, answer in requests
        if request_size(question) == len(question)
    ]
    names = ("asked", "serial", "year", "acceleration")
    rows = [(request, answer) for request, answer in reads if request.function == 3]
    assert [request.register for request, _ in rows] == [180, 510, 514, 190]
    for name, (request, answer) in zip(names, rows, strict=True):
        payload, _ = find_answer(answer, request.function, len(answer))
        yield name, words_of(payload)


# --- RSI


def test_rsi_is_read_and_understood_as_rsipi_does():
    transcript = TRANSCRIPTS["rsi-rsipi"]
    reports = [decode(data) for data in transcript.made_by(DEVICE, "rsi")]
    answered = [decode(data) for data in transcript.made_by(CLIENT, "rsi")]
    assert {telegram.root for telegram in answered} == {"Sen"}
    assert {telegram.type for telegram in answered} == {"ImFree"}
    assert {telegram.ipoc for telegram in answered} <= {telegram.ipoc for telegram in reports}
    corrections = {tuple(float(telegram.values[tag]) for tag in pose_tags("RKorr")) for telegram in answered}
    (sent,) = transcript.sends
    assert corrections == {(0.0,) * 6, (sent["X"], 0.0, sent["Z"], 0.0, 0.0, 0.0)}
    (read_there,) = transcript.reads
    for element, values in read_there.items():
        assert list(values.values()) in [
            [float(telegram.values[tag]) for tag in pose_tags(element)] for telegram in reports
        ]


def test_corrections_of_rsipi_move_the_emulated_robot_by_the_sum():
    transcript = TRANSCRIPTS["rsi-rsipi"]
    answered = [decode(data) for data in transcript.made_by(CLIENT, "rsi")]
    last = decode(transcript.made_by(DEVICE, "rsi")[-1])
    total = sum(float(telegram.values["RKorr.Z"]) for telegram in answered)
    assert 600.0 + total == pytest.approx(float(last.values["RIst.Z"]), abs=0.03)


def test_step_reports_its_time():
    assert Step(12.5, CLIENT, "egm").now == pytest.approx(4321.0125)

"""The monitor: one line per block of a capture, named problems of the link, recordings and text captures."""

import asyncio
import itertools
import json
from collections import Counter
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bridge.cli import cli
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.console.printing import Printer, field_text
from hil_bridge.device_commands.s3.capture import Piece, Sender, link_pieces, parse_capture
from hil_bridge.device_commands.s3.link_monitor import Line, LinkMonitor
from hil_bridge.device_commands.s3.monitor import listen
from hil_bridge.device_commands.s3.telegram_text import telegram_text
from hil_bridge.devices.sensors.jr3.monitor import frame_text, listen_can
from hil_bridge.errors import ConfigError, TransportEnded
from hil_bridge.record import LinkLog, LinkRecord, read, read_link
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import load_config
from hil_bridge.transports import connect_can, listen_bytes
from protocol.devices.jr3 import parse_frame
from protocol.devices.s3.adlp import LinkProfile, NoticeKind, encode_block
from protocol.devices.s3.arap import KNOWN

STATUS = "10 02 00 08 01 00 13 01 00 00 10 03 18"
"""Read status order. Source: computer-link specification, section 4."""
REFUSED = encode_block(bytes.fromhex("000A0000130600000002")).hex(" ")
"""Refusal of that order, code 2."""
ANSWER = encode_block(
    bytes.fromhex("0020000013020000 0001000200030004 08020FE9E5DC1487 0817D45509972D13")
).hex(" ")
"""Status with the pose of a real robot. Source: computer-link specification, section 3."""
GOOD = f"""
# a complete query
0.000000 PC 05
0.013000 S3 06
0.013100 PC {STATUS}
0.041000 S3 06
0.041100 PC 04
0.055000 S3 05
0.055100 PC 06
0.105000 S3 {ANSWER}
0.105100 PC 06
0.107000 S3 04
"""


def lines_of(
    text: str, profile: LinkProfile | None = None, finish: bool = True
) -> tuple[list[Line], LinkMonitor]:
    monitor = LinkMonitor(profile or LinkProfile())
    for piece in parse_capture(text, "capture"):
        monitor.take(piece)
    if finish:
        monitor.finish()
    lines = []
    while (line := monitor.next_line()) is not None:
        lines.append(line)
    return lines, monitor


def texts(text: str) -> list[str]:
    return [f"{line.sender} {line.text}" for line in lines_of(text)[0]]


def test_monitor_valid_exchange_is_one_line_per_block() -> None:
    (order, answer), monitor = lines_of(GOOD)
    assert (order.at, order.sender, order.trouble) == (0.0131, Sender.PC, False)
    assert order.text == "read status, order [bid 13.0 ms, ACK 27.9 ms]"
    assert order.line_time == pytest.approx(13 * 11 / 9600)
    assert answer.sender is Sender.ROBOT
    assert answer.text == (
        "read status, response: program 1, instruction 2, tcp 3, frame 4, key auto, operation, "
        "x 0.509125 m, y -0.8365 m, z 0.656875 m, q1 0.1264038, q2 -0.682312, q3 0.1498413, q4 0.7042847 "
        "[bid 0.1 ms, ACK 0.1 ms]"
    )
    counts = monitor.counts
    assert (counts.blocks, counts.repeats, counts.unanswered, counts.garbage) == (2, 0, 0, 0)
    characters = 13 + 37 + 8
    assert counts.busy == pytest.approx(characters * 11 / 9600)


BID = "0 PC 05\n0.01 S3 06\n"


@pytest.mark.parametrize(
    ("capture", "expected"),
    [
        (f"{BID}0.02 PC {STATUS}\n0.04 S3 15\n0.05 PC {STATUS}\n0.07 S3 06\n0.08 PC 04",
         ["PC read status, order [bid 10.0 ms, NAK 20.0 ms]", "PC read status, order [repeat 1, ACK 20.0 ms]"]),
        (f"{BID}0.02 PC {STATUS}\n2.1 PC {STATUS}\n2.2 S3 06\n2.3 PC 04",
         ["PC read status, order [bid 10.0 ms, no answer]", "PC read status, order [repeat 1, ACK 100.0 ms]"]),
        (f"{BID}0.02 PC {STATUS}\n0.04 S3 06\n0.3 PC {STATUS}\n0.4 S3 06\n0.5 PC 04",
         ["PC read status, order [bid 10.0 ms, ACK 20.0 ms]",
          "PC read status, order [repeat 1, though acknowledged, ACK 100.0 ms]"]),
        (f"{BID}0.02 PC {STATUS}\n0.04 S3 0E\n1.0 S3 06\n1.1 PC 04",
         ["PC read status, order [bid 10.0 ms, WACK 20.0 ms, ACK 960.0 ms]"]),
        (f"{BID}0.02 PC {STATUS}\n0.04 S3 0F\n0.1 PC 04",
         ["PC read status, order [bid 10.0 ms, RVI 20.0 ms: acknowledged, and asks for the line]"]),
        (f"{BID}0.02 PC {STATUS}\n0.04 S3 04", ["PC read status, order [bid 10.0 ms, aborted by EOT]"]),
        (f"{BID}0.02 PC {STATUS}\n0.04 S3 05", ["PC read status, order [bid 10.0 ms, answered by a bid]"]),
        (f"{BID}0.02 PC {STATUS}\n0.04 S3 15\n0.05 PC 04",
         ["PC read status, order [bid 10.0 ms, NAK 20.0 ms]", "PC EOT: the message is given up"]),
        ("0 PC 05\n0.001 S3 05\n0.002 PC 06", ["S3 both bid at once"]),
        ("0 PC 05\n2.1 PC 05\n2.2 S3 06", ["PC ENQ: no answer"]),
        ("0 PC 05\n0.1 S3 15", ["S3 NAK: the bid is refused"]),
        ("0 PC 05\n0.1 S3 06\n0.2 PC 04", ["PC EOT: the bid is given up"]),
        (f"0 S3 05\n0.1 PC 06\n0.2 S3 {REFUSED}\n0.3 PC 06\n1.0 PC 05",
         ["S3 read status, refusal: code 2 wrong function suffix [bid 100.0 ms, ACK 100.0 ms]",
          "S3 EOT: missing before the next bid"]),
        ("0 S3 06", ["S3 ACK: there is nothing to acknowledge"]),
        ("0 S3 04", ["S3 EOT: nothing had begun"]),
        ("0 S3 15", ["S3 NAK"]),
        ("0 S3 0E\n1 S3 0F", ["S3 WACK: wait", "S3 RVI: asks for the line"]),
        (f"0 PC {STATUS}\n0.1 S3 06\n0.2 PC 04", ["PC read status, order [without an acknowledged bid, ACK 100.0 ms]"]),
        (f"{BID}0.02 PC {STATUS[:-2]}19\n0.1 S3 15",
         ["PC damaged block of 13 bytes: check character is 19, the telegram needs 18", "S3 NAK"]),
        (f"{BID}0.02 PC {STATUS.replace('08', '05', 1)}\n0.3 S3 15",
         ["PC a block broke off after 13 bytes", "S3 NAK"]),
        (f"{BID}0.02 S3 {ANSWER.replace('20', '09', 1)}\n0.3 PC 15",
         ["S3 37 bytes: damaged block: no DLE ETX at the end given by the length 9", "PC NAK"]),
        (f"{BID}0.02 PC 10 02 00 08\n0.5 S3 15", ["PC a block broke off after 4 bytes", "S3 NAK"]),
        ("0 S3 80 81\n0.01 S3 82 06\n0.02 PC 05",
         ["S3 3 bytes: no meaning", "S3 ACK: there is nothing to acknowledge"]),
        ("0 S3 80 81 82 83 84 06 04", ["S3 7 bytes: no meaning"]),
        (f"{BID}0.02 PC {STATUS}", ["PC read status, order [bid 10.0 ms, the capture ends here]"]),
        (f"{BID}0.02 PC 10 02", ["PC a block broke off after 2 bytes"]),
    ],
)  # fmt: skip
def test_monitor_names_problems(capture: str, expected: list[str]) -> None:
    assert texts(capture) == expected


def test_monitor_time_out_ends_pending_block() -> None:
    lines, monitor = lines_of(f"{BID}0.02 PC {STATUS}", finish=False)
    assert lines == []
    monitor.idle(1.9)
    assert monitor.next_line() is None
    monitor.idle(2.1)
    line = monitor.next_line()
    assert line is not None
    assert line.text.endswith("no answer]")
    assert monitor.counts.unanswered == 1


def test_monitor_infers_direction_from_blocks() -> None:
    mixed = GOOD.replace(" PC ", " ? ").replace(" S3 ", " ? ")
    lines, monitor = lines_of(mixed)
    assert [(line.sender, line.trouble) for line in lines] == [(Sender.PC, False), (Sender.ROBOT, False)]
    assert "ACK 27.9 ms" in lines[0].text
    assert monitor.counts.unanswered == 0


def test_monitor_single_direction_reports_no_problems() -> None:
    one = "\n".join(line for line in GOOD.splitlines() if " S3 " not in line).replace(" PC ", " ? ")
    assert [line.trouble for line in lines_of(one)[0]] == [False]


def test_monitor_labels_blocks_of_long_telegram() -> None:
    first = encode_block(bytes.fromhex("000E00001D0A0000000000070102")).hex()
    last = encode_block(bytes.fromhex("000A00001D0200000304")).hex()
    lines, _ = lines_of(f"0 S3 05\n0 PC 06\n0.1 S3 {first}\n0.1 PC 06\n0.2 S3 {last}\n0.2 PC 06\n0.2 S3 04")
    assert [line.text.partition(" [")[0] for line in lines] == [
        "receive program, further block follows, from S3: program 7, content 01 02",
        "receive program, response: content 03 04",
    ]
    assert not any(line.trouble for line in lines)


def test_monitor_reads_doubled_dle_by_profile() -> None:
    block = encode_block(bytes.fromhex("0008010013010010"), "double").hex()
    (line,), _ = lines_of(f"{BID}0.02 PC {block}\n0.1 S3 06\n0.2 PC 04", LinkProfile(dle_stuffing="double"))
    assert line.text.startswith("read status suffix 16, order")


def test_monitor_describes_unreadable_telegrams() -> None:
    assert telegram_text(b"\x00\x09\x01\x00\x13\x01\x00\x00", False)[0].startswith(
        "unreadable telegram: bytes 0–1"
    )
    assert telegram_text(bytes.fromhex("0009010006010000FF"), False)[0] == "read register, order: data FF"
    assert "needs" in telegram_text(bytes.fromhex("0008000013020000"), True)[0]


def test_monitor_describes_gateway_frames() -> None:
    assert frame_text(parse_frame("201#C80010270000")) == (
        "PC→JR3",
        "start async node 1: cutoff 2 Hz, period 0.01 s",
        False,
    )
    direction, text, trouble = frame_text(parse_frame("7FF#R"))
    assert (direction, trouble) == ("?", True)
    assert "7FF#R" in text


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(list(Sender)), st.binary(min_size=1, max_size=40)), max_size=20))
def test_monitor_never_fails_on_random_bytes(pieces: list[tuple[Sender, bytes]]) -> None:
    monitor = LinkMonitor(LinkProfile())
    for number, (sender, data) in enumerate(pieces):
        monitor.take(Piece(number * 0.1, sender, data))
    monitor.finish()
    monitor.take(Piece(1e3, Sender.PC, b"\x05"))
    monitor.take(Piece(1e3, Sender.ROBOT, b"\x06"))
    monitor.take(Piece(1e3, Sender.PC, bytes.fromhex(STATUS)))
    monitor.take(Piece(1e3, Sender.ROBOT, b"\x06"))
    lines = []
    while (line := monitor.next_line()) is not None:
        lines.append(line)
    assert lines[-1].text == "read status, order [bid 0.0 ms, ACK 0.0 ms]"


@given(st.lists(st.integers(min_value=1, max_value=36), max_size=8))
def test_monitor_line_is_independent_of_chunks(cuts: list[int]) -> None:
    data = bytes.fromhex(ANSWER)
    edges = [0, *sorted(set(cuts)), len(data)]
    parts = [data[begin:end] for begin, end in itertools.pairwise(edges)]
    split = "".join(f"0.105 S3 {part.hex()}\n" for part in parts)
    capture = f"0.105000 S3 {ANSWER}\n"
    assert capture in GOOD
    assert lines_of(GOOD.replace(capture, split))[0] == lines_of(GOOD)[0]


# --- captures and recordings


def test_capture_piece_round_trips() -> None:
    pieces = list(parse_capture("0.25 rx 10\t02 # why\n\n0.25 tx 0506", "c"))
    assert pieces == [Piece(0.25, Sender.ROBOT, b"\x10\x02"), Piece(0.25, Sender.PC, b"\x05\x06")]
    assert list(parse_capture("\n".join(map(str, pieces)), "c")) == pieces


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 PC 5", "line 1: '0 PC 5' is not a piece"),
        ("0 PC 05\n0 who 05", "line 2"),
        ("x PC 05", "line 1"),
        ("1 PC 05\n0.5 PC 05", "line 2: 0.5 s is before 1 s"),
    ],
)
def test_capture_invalid_line_is_named(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        list(parse_capture(text, "c"))


def test_monitor_refuses_recording_with_invalid_pieces() -> None:
    with pytest.raises(ConfigError, match="is not a piece"):
        list(link_pieces([LinkRecord(0.0, ("nonsense",))], "r"))


def test_link_log_joins_pieces() -> None:
    records: list[LinkRecord] = []
    log = LinkLog(lambda at, pieces: records.append(LinkRecord(at, pieces)))
    for number in range(70):
        log.take(100.0 + number * 1e-3, "rx", b"\x06")
    log.take(101.0, "tx", b"\x05")
    log.flush()
    log.flush()
    assert [len(record.pieces) for record in records] == [64, 6, 1]
    assert records[1].at == pytest.approx(100.064)
    assert records[0].pieces[1] == "0.001000 rx 06"
    assert list(link_pieces(records, "r"))[-1] == Piece(101.0, Sender.PC, b"\x05")


def test_link_log_separates_events_from_bytes() -> None:
    records: list[LinkRecord] = []
    log = LinkLog(lambda at, pieces: records.append(LinkRecord(at, pieces)))
    log.take(100.0, "tx", b"\x05")
    log.note(100.003, "ACK received: bid acknowledged")
    log.take(100.003, "tx", b"\x10")
    log.flush()
    assert records[0].pieces[1] == "0.003000 -- ACK received: bid acknowledged"
    assert [piece.data for piece in link_pieces(records, "r")] == [b"\x05", b"\x10"]


def test_monitor_reads_link_of_recorded_run(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    config = load_config(None, {"run.duration_s": 1.0})
    execute(config, True, Outputs(record=file), view=False)
    records, metadata = read_link(file)
    counts = Counter(
        event.split(": ")[0]
        for record in records
        for event in (piece.partition(" -- ")[2] for piece in record.pieces)
        if event
    )
    counted = json.loads(read(file).end["link"])
    assert counts == {str(kind): counted[kind] for kind in NoticeKind if counted[kind]}
    assert counts["ACK received"] >= 2 * counts["bid sent"] > 20
    assert "config" in metadata
    result = CliRunner().invoke(cli, ["monitor", str(file), "--raw"])
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert "read status, order" in lines[0]
    assert "{00 08 01 00 13 01 00 00}" in lines[0]
    assert any("move end, order" in line for line in lines)
    assert not any(" ! " in line for line in lines)
    assert "0 repeated, 0 NAK, 0 unanswered, 0 collisions, 0 bytes without meaning" in lines[-1]


def test_monitor_command_reads_captures_and_names_errors(tmp_path: Path) -> None:
    file = tmp_path / "capture.txt"
    file.write_text(GOOD)
    result = CliRunner().invoke(cli, ["monitor", str(file)])
    assert result.exit_code == 0
    first, second, total = result.output.splitlines()
    assert first.split()[:3] == ["0.013100", "+0.013100", "PC→S3"]
    assert "14.9 ms" in first
    assert second.split()[1] == "+0.091900"
    assert total.startswith("2 blocks, 0 repeated")
    for text, message in (("", "contains no traffic"), ("0 PC 0", "is not a piece")):
        file.write_text(text)
        error = CliRunner().invoke(cli, ["monitor", str(file)]).exception
        assert isinstance(error, ConfigError)
        assert message in str(error)
    file.write_bytes(b"\xff\xfe\x00")
    error = CliRunner().invoke(cli, ["monitor", str(file)]).exception
    assert isinstance(error, ConfigError)
    assert "is not valid utf-16" in str(error)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing.mcap"], "cannot read nothing.mcap: No such file or directory"),
        (["nothing"], "it names no kind"),
        (["tcp://a:1", "tcp://a:2"], "did you mean rtde+tcp://a:1 or s3+tcp://a:1?"),
        (["egm+udp-bind://0.0.0.0:1"], "only the link of an s3 can be monitored, not that of egm"),
        (["ft300+serial:///dev/pts/77"], "hil-bridge monitor RECORDING --device sensor"),
        (["s3+tcp://a:1", "s3+tcp://a:2", "s3+tcp://a:3"], "at most two URLs"),
        (["jr3+can+socketcan://can0", "s3+tcp://a:1"], "only one CAN bus can be monitored"),
    ],
)
def test_monitor_invalid_source_is_named(arguments: list[str], message: str) -> None:
    error = CliRunner().invoke(cli, ["monitor", *arguments]).exception
    assert isinstance(error, ConfigError)
    assert message in str(error)


def test_monitor_integer_is_printed_in_full() -> None:
    assert field_text({"name": "time", "value": 11421250, "unit": "us"}) == "time 11421250 us"
    assert field_text({"name": "force", "value": 11421250.0, "unit": "N"}) == "force 1.142125e+07 N"


# --- while it runs, in virtual time


def test_monitor_shows_can_frames_live(capsys: pytest.CaptureFixture[str]) -> None:
    async def main() -> None:
        clock = Clock.running()
        listening = asyncio.create_task(listen_can("can+memory:bus", Printer(raw=True)))
        gateway = await connect_can("can+memory:bus", clock)
        gateway.start(lambda frames: None, lambda cause: None)
        await asyncio.sleep(0.1)
        gateway.send([parse_frame("601#0100FEFF03000700")])
        await asyncio.sleep(0.1)
        await gateway.aclose()
        listening.cancel()
        await asyncio.wait([listening])

    run_virtual(main)
    (line,) = capsys.readouterr().out.splitlines()
    assert "JR3→PC" in line
    assert "0.1 ms   forces node 1: fx 6.103516e-05 of full scale, fy -0.0001220703" in line
    assert line.endswith("{01 00 FE FF 03 00 07 00}")


def test_monitor_receives_two_wires_until_one_ends(capsys: pytest.CaptureFixture[str]) -> None:
    pieces: list[Piece] = []

    async def main() -> None:
        clock = Clock.running()
        pc, robot = await listen_bytes("memory:pc", clock), await listen_bytes("memory:robot", clock)

        async def talk() -> None:
            for data, at in (("05", pc), ("06", robot), (STATUS, pc)):
                await asyncio.sleep(0.02)
                at.transport.send(bytes.fromhex(data))
            await asyncio.sleep(3.0)
            await pc.transport.aclose()

        talking = asyncio.create_task(talk())
        with pytest.raises(TransportEnded):
            await listen(
                ("memory:pc", "memory:robot"), LinkProfile(), KNOWN, Printer(raw=False), pieces.append
            )
        await talking
        await robot.transport.aclose()

    run_virtual(main)
    (line,) = capsys.readouterr().out.splitlines()
    assert "! read status, order [bid 20.0 ms, no answer]" in line
    assert [piece.sender for piece in pieces] == [Sender.PC, Sender.ROBOT, Sender.PC]
    assert pieces[2].at == pytest.approx(0.04)


LOG = "(1436509052.249713) can0 201#C80010270000\n(1436509052.349713) can0 20000004#0000000000000000\n"
CONSOLE = "  can0  201   [6]  C8 00 10 27 00 00\n\n  can1  12345678   [1]  07\n"


def monitor_output(folder: Path, text: str, *more: str, sensor: str = "") -> str:
    file, config = folder / "can.log", folder / "cell.toml"
    file.write_text(text)
    config.write_text(f'[sensor]\nemulated = "{sensor}"\n')
    result = CliRunner().invoke(
        cli, ["monitor", str(file), *(["--config", str(config)] if sensor else []), *more]
    )
    return result.output if result.exit_code == 0 else str(result.exception)


def test_monitor_of_candump_log_prints_frames(tmp_path: Path) -> None:
    first, second = monitor_output(tmp_path, LOG).splitlines()
    assert first.split() == ["0.000000", "+0.000000", "can0", "201#C80010270000"]
    assert second.split()[:4] == ["0.100000", "+0.100000", "bus", "!"]
    first, second = monitor_output(tmp_path, CONSOLE, "--raw", sensor="jr3").splitlines()
    assert first.split("can0")[0].split() == ["-", "-"]
    assert "start async: cutoff 2 Hz, period 0.01 s  {C8 00 10 27 00 00}" in first
    assert "can1" in second
    assert "only data frames with 11-bit identifiers" in second


def test_monitor_of_candump_log_refuses_other_options(tmp_path: Path) -> None:
    falling = "(2.0) can0 201#00\n(1.0) can0 201#00\n"
    assert "can.log: line 2: its time is before that of the previous line" in monitor_output(
        tmp_path, falling
    )
    assert "can.log: line 2: not a line of candump" in monitor_output(tmp_path, "can0  201   [0]\nhello\n")
    assert "the sensor of " in monitor_output(tmp_path, LOG, sensor="netft")
    assert "--device applies only to a recording" in monitor_output(tmp_path, LOG, "--device", "sensor")


@pytest.mark.parametrize(
    "pasted",
    [
        ["can0", "201", "[6]", "C8", "00", "10", "27", "00", "00"],
        ["can0  201   [6]  C8 00 10 27 00 00"],
        ["(1436509052.249713)", "can0", "201#C80010270000"],
        ["can0", "201#C80010270000"],
        ["(1.0) can0 201#C80010270000\n(1.1) can0 201#C80010270000"],
        ["(1.0) can0 201#C80010270000", "(1.1) can0 201#C80010270000"],
    ],
)
@pytest.mark.parametrize("kind", ["jr3-can", "jr3"])
def test_decode_accepts_lines_of_candump(kind: str, pasted: list[str]) -> None:
    result = CliRunner().invoke(cli, ["decode", kind, *pasted])
    assert result.exit_code == 0, result.exception
    assert result.output.count('"op": "start async"') == max(1, sum(text.count("(1.") for text in pasted))


def test_decode_names_invalid_line_of_candump() -> None:
    error = CliRunner().invoke(cli, ["decode", "jr3-can", "can0", "201", "[6]", "C8"]).exception
    assert isinstance(error, ConfigError)
    assert "[6] bytes are announced, but 1 are present; quote each line" in str(error)

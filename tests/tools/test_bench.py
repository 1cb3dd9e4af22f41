"""The benchmarks' own bookkeeping: figures, the file of results, the page. Nothing is timed here."""

import json

from protocol.devices.rtde import packets
from protocol.devices.s3.adlp import encode_block
from protocol.devices.s3.arap import Move, MoveKind, read_status
from tools.bench import exchanges
from tools.bench.exchanges import ANSWER, PACKET, Exchange
from tools.bench.figures import Figure, Report, Spread, Target


def test_a_figure_is_judged_by_its_value_or_by_its_ratio():
    assert Figure("speed", 120.0, "s/s", target=Target("value", 100.0, least=True)).met is True
    assert Figure("speed", 90.0, "s/s", target=Target("value", 100.0, least=True)).met is False
    late = Figure("lateness", 30.0, "µs", 100.0, "asyncio", Target("ratio", 0.25))
    assert (late.ratio, late.met) == (0.3, False)
    assert late.line() == "lateness: 30.0 µs; 100 µs (asyncio), ratio 0.300 ×; ≤ 0.25 ×: NOT met"


def test_a_ratio_beside_its_target_is_told_to_the_digit_that_decides():
    target = Target("ratio", 1.03)
    ratios = [Figure("f", value, "ms", 1.0, "floor", target).cells()[3] for value in (1.028, 1.032, 1.06)]
    assert ratios == ["1.028 ×", "1.032 ×", "1.06 ×"]


def test_a_target_without_its_baseline_is_not_judged():
    assert Figure("lateness", 30.0, "µs", target=Target("ratio", 0.25)).met is None


def test_results_come_back_from_their_file_as_they_went():
    report = Report(
        (
            Figure("a", 1.5, "µs", 3.0, "C", Target("ratio", 2.0, aim=1.5)),
            Figure("b", 100.0, "s/s", target=Target("value", 40.0, least=True)),
        ),
        ("vcan: none here",),
    )
    assert Report.from_json(json.loads(json.dumps(report.as_json()))) == report


def test_the_hundredth_part_lies_above_the_99th_percentile():
    spread = Spread([float(value) for value in range(1, 201)])
    assert (spread.p50, spread.p99) == (100.5, 198.0)


def test_any_part_of_a_spread_lies_at_its_place():
    spread = Spread([float(value) for value in range(1, 2001)])
    assert (spread.at(0.999), spread.at(1.0), spread.at(0.0)) == (1998.0, 2000.0, 1.0)


def stamped(*messages: tuple[float, int, bytes]) -> bytes:
    """A file of the relay."""
    return b"".join(exchanges.RECORD.pack(at, way, len(data)) + data for at, way, data in messages)


def number(value: int) -> bytes:
    return value.to_bytes(8, "little") + b"rest"


def test_a_packet_that_is_passed_over_waits_until_a_later_one_is_answered():
    data = stamped(
        (0.5, PACKET, number(6)),  # before the first answer
        (1.0, PACKET, number(7)),
        (1.25, ANSWER, number(7)),
        (2.0, PACKET, number(8)),
        (3.0, PACKET, number(9)),
        (3.5, ANSWER, number(9)),
        (3.75, ANSWER, number(9)),  # once too often
        (4.0, PACKET, number(10)),  # behind the last answer
    )
    seen = exchanges.seen(data, exchanges.numbered)
    assert seen.exchanges == (Exchange(1.0, 0.25), Exchange(2.0, 1.5, own=False), Exchange(3.0, 0.5))
    assert seen.sizes == (12, 12)


def test_packages_of_rtde_are_told_apart_however_they_come():
    packet, answer = (packets.encode(packets.Kind.DATA, bytes(size)) for size in (20, 10))
    other = packets.encode(packets.Kind.START, b"\x01")
    data = stamped(
        (0.0, PACKET, other),
        (0.5, ANSWER, answer),  # for no packet
        (1.0, PACKET, packet + packet[:5]),
        (1.25, PACKET, packet[5:]),
        (1.5, ANSWER, other + answer),
        (2.0, ANSWER, answer),
    )
    seen = exchanges.seen(data, exchanges.rtde)
    assert seen.exchanges == (Exchange(1.0, 0.5), Exchange(1.25, 0.75))
    assert seen.sizes == (23, 13)


def test_orders_of_an_s3_count_from_the_end_of_the_status_answer():
    enq, ack, eot = b"\x05", b"\x06", b"\x04"
    move = encode_block(
        Move(MoveKind.POINT, (0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.05).to_telegram().encode()
    )
    status = encode_block(read_status().encode())
    data = stamped(
        (1.0, PACKET, eot),
        (1.25, ANSWER, enq),
        (1.3, PACKET, ack),
        (1.5, ANSWER, move[:20]),
        (1.625, ANSWER, move[20:]),
        (2.0, PACKET, eot),
        (2.25, ANSWER, enq + status),
        (3.0, PACKET, eot),
        (3.5, ANSWER, enq + move),
    )
    assert exchanges.seen(data, exchanges.s3).exchanges == (Exchange(1.0, 0.625), Exchange(3.0, 0.5))

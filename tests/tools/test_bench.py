"""Tests of the benchmarks' bookkeeping: figures, the file of results, the page. Nothing is timed here."""

import json

from protocol.devices.rtde import packets
from protocol.devices.s3.adlp import encode_block
from protocol.devices.s3.arap import Move, MoveKind, read_status
from tools.bench import exchanges
from tools.bench.exchanges import ANSWER, PACKET, Exchange
from tools.bench.figures import Figure, Report, Spread, Target


def test_figure_is_judged_by_value_or_ratio():
    assert Figure("speed", 120.0, "s/s", target=Target("value", 100.0, least=True)).met is True
    assert Figure("speed", 90.0, "s/s", target=Target("value", 100.0, least=True)).met is False
    late = Figure("lateness", 30.0, "µs", 100.0, "asyncio", Target("ratio", 0.25))
    assert (late.ratio, late.met) == (0.3, False)
    assert late.line() == "lateness: 30.0 µs; 100 µs (asyncio), ratio 0.300 ×; ≤ 0.25 ×: NOT met"


def test_ratio_near_target_has_enough_digits():
    target = Target("ratio", 1.03)
    ratios = [Figure("f", value, "ms", 1.0, "floor", target).cells()[3] for value in (1.028, 1.032, 1.06)]
    assert ratios == ["1.028 ×", "1.032 ×", "1.06 ×"]


def test_target_without_baseline_is_not_judged():
    assert Figure("lateness", 30.0, "µs", target=Target("ratio", 0.25)).met is None


def test_results_survive_round_trip():
    report = Report(
        (
            Figure("a", 1.5, "µs", 3.0, "C", Target("ratio", 2.0, aim=1.5)),
            Figure("b", 100.0, "s/s", target=Target("value", 40.0, least=True)),
        ),
        ("vcan: none here",),
    )
    assert Report.from_json(json.loads(json.dumps(report.as_json()))) == report


def test_one_percent_is_above_99th_percentile():
    spread = Spread([float(value) for value in range(1, 201)])
    assert (spread.p50, spread.p99) == (100.5, 198.0)


def test_quantiles_of_spread():
    spread = Spread([float(value) for value in range(1, 2001)])
    assert (spread.at(0.999), spread.at(1.0), spread.at(0.0)) == (1998.0, 2000.0, 1.0)


def relay_file(*messages: tuple[float, int, bytes]) -> bytes:
    """Return a file of the relay."""
    return b"".join(
        exchanges.RECORD.pack(at, direction, len(data)) + data for at, direction, data in messages
    )


def number(value: int) -> bytes:
    return value.to_bytes(8, "little") + b"rest"


def test_skipped_packet_waits_for_later_answer():
    data = relay_file(
        (0.5, PACKET, number(6)),  # before the first answer
        (1.0, PACKET, number(7)),
        (1.25, ANSWER, number(7)),
        (2.0, PACKET, number(8)),
        (3.0, PACKET, number(9)),
        (3.5, ANSWER, number(9)),
        (3.75, ANSWER, number(9)),  # one answer too many
        (4.0, PACKET, number(10)),  # after the last answer
    )
    observed = exchanges.read_exchanges(data, exchanges.numbered_messages)
    assert observed.exchanges == (Exchange(1.0, 0.25), Exchange(2.0, 1.5, own=False), Exchange(3.0, 0.5))
    assert observed.sizes == (12, 12)


def test_rtde_packages_are_separated():
    packet, answer = (packets.encode(packets.Kind.DATA, bytes(size)) for size in (20, 10))
    other = packets.encode(packets.Kind.START, b"\x01")
    data = relay_file(
        (0.0, PACKET, other),
        (0.5, ANSWER, answer),  # for no packet
        (1.0, PACKET, packet + packet[:5]),
        (1.25, PACKET, packet[5:]),
        (1.5, ANSWER, other + answer),
        (2.0, ANSWER, answer),
    )
    observed = exchanges.read_exchanges(data, exchanges.rtde)
    assert observed.exchanges == (Exchange(1.0, 0.5), Exchange(1.25, 0.75))
    assert observed.sizes == (23, 13)


def test_s3_orders_count_from_end_of_status_answer():
    enq, ack, eot = b"\x05", b"\x06", b"\x04"
    move = encode_block(
        Move(MoveKind.POINT, (0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.05).to_telegram().encode()
    )
    status = encode_block(read_status().encode())
    data = relay_file(
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
    assert exchanges.read_exchanges(data, exchanges.s3).exchanges == (
        Exchange(1.0, 0.625),
        Exchange(3.0, 0.5),
    )

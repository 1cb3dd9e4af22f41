"""Latency of the bridge's answers to a robot, compared with echo servers that compute nothing.

The emulated cell is one process and the bridge another, as an operator starts them. Between the robot and the
bridge, a small C program forwards every packet and stamps it (`c/relay.c`). It also sends packets of the same size,
at the same rate, to the echo servers, and stamps those packets. Echo servers and bridge take turns.

`python -m tools.bench.answers 3` tracks for only 3 s and prints the figures.
"""

import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from tools.bench import exchanges, machine
from tools.bench.bridge import (
    AWAKE,
    PATIENCE_S,
    STOLEN,
    CompletedRun,
    RunFailed,
    emulated_cell,
    processors_awake,
    run_bridge,
    slow_tool,
    started,
    write_config,
)
from tools.bench.exchanges import Chunk, Exchange, Message
from tools.bench.figures import Figure, Report, Spread

HERE = Path(__file__).parent
TRACK_S = 60.0
MICRO, MEGA = 1e6, 1e6
PARTS = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "largest": 1.0}
NO_COMPILER = (
    "there is no C compiler here (`cc`), so the program that stamps packets from outside is missing, and with it the "
    "echoes; what the bridge stamps itself is left"
)
QUICK_S3: Mapping[str, Any] = {"robot": {"turnaround_ms": 0.0, "turnaround_spread_ms": 0.0}}
"""Settings of an S3 whose controller needs no processing time."""


class Way(NamedTuple):
    """Robot to measure, with equivalent packets for the echo servers."""

    title: str
    kind: str
    wire: str
    cycle_s: float
    packet: int
    """Size of a packet, bytes."""
    answer: int
    messages: Callable[[Iterable[Chunk]], Iterator[Message]]


WAYS = (
    Way(
        "orders over TCP (s3)", "s3", "tcp", 0.01, exchanges.ORDER_BYTES, exchanges.ORDER_BYTES, exchanges.s3
    ),
    Way("500 Hz over TCP (rtde)", "rtde", "tcp", 0.002, 240, 84, exchanges.rtde),
    Way("250 Hz over UDP (egm)", "egm", "udp", 0.004, 380, 140, exchanges.egm),
)
"""Robots to measure. An S3 is polled at the sample rate of its sensor, 100 Hz; its line is not paced here."""


@dataclass
class Turns:
    """Answer times of both echo servers in all their turns, s."""

    c: list[float] = field(default_factory=list)
    plain: list[float] = field(default_factory=list)


class TrackedRun(NamedTuple):
    """Result of a run of the bridge."""

    exchanges: Sequence[Exchange]
    """Packets and answers during tracking; empty if no program stamped them."""
    ended: CompletedRun
    record_mb: float
    """Size of the recording, MB; 0 without a recording."""

    @property
    def times(self) -> list[float]:
        """Answer times, s."""
        return [one.taken for one in self.exchanges]


@dataclass(frozen=True)
class Bench:
    """Measurement setup for one robot."""

    way: Way
    place: Path
    track_s: float
    report_step: Callable[[str], None]
    relay: Path | None = field(default_factory=partial(machine.compile_program, "relay"))

    def echo(self, turns: Turns, seconds: float) -> None:
        """Give each echo server a turn."""
        if self.relay is not None:
            self.report_step(f"{self.way.title}: echoes")
            file = self.place / "seen"
            asyncio_echo = (sys.executable, HERE / "asyncio_echo.py")
            turns.plain += echo_times(self.relay, self.way, asyncio_echo, file, seconds)
            turns.c += echo_times(self.relay, self.way, (self.relay, "echo"), file, seconds)

    def track(self, record: bool = True, awake: bool = False) -> TrackedRun:
        """Run the bridge and return the result. Raises RunFailed."""
        file, recording = self.place / "seen", self.place / "run.mcap"
        for old in (file, recording):
            old.unlink(missing_ok=True)
        settings = slow_tool(self.way.kind, self.track_s)
        if self.way.kind == "s3":
            settings["cell"] = {"s3": QUICK_S3}
        config = write_config(self.place / "run.toml", settings)
        with self._cell(config, file) as devices:
            if awake:
                write_config(config, {**settings, "realtime": {"keep_awake": True}})
            ended = run_bridge(config, devices, recording if record else None, self.track_s + PATIENCE_S)
        phases = ended.summary["phases_s"]
        seen = [] if self.relay is None else exchanges_while_tracking(file.read_bytes(), self.way, phases)
        return TrackedRun(seen, ended, recording.stat().st_size / MEGA if record else 0.0)

    @contextmanager
    def _cell(self, config: Path, file: Path) -> Iterator[dict[str, str]]:
        """Return the options with which a bridge connects to an emulated cell, through the relay if there is one."""
        with ExitStack() as stack:

            def pass_on(wire: str, port: str) -> str:
                """Return the port at which the relay stands before another one."""
                return (
                    stack.enter_context(started(self.relay, "pass", wire, port, file))[1]
                    if self.relay
                    else port
                )

            if self.way.wire == "udp":
                port = str(free_port())
                door = f"egm+udp://127.0.0.1:{pass_on('udp', port)}"
                devices = stack.enter_context(emulated_cell(config, "--robot-port", door))
                devices["robot"] = f"egm+udp-bind://127.0.0.1:{port}"
            else:
                door = f"{self.way.kind}+tcp-listen://127.0.0.1:0"
                devices = stack.enter_context(emulated_cell(config, "--robot-port", door))
                url, mark, query = devices["robot"].partition("?")
                host, _, port = url.rpartition(":")
                devices["robot"] = f"{host}:{pass_on('tcp', port)}{mark}{query}"
            yield devices

    def measure(self) -> Iterator[Figure]:
        """Measure all figures of the robot with the machine in its normal state. Raises RunFailed."""
        turns = Turns()
        self.echo(turns, self.track_s / 3.0)
        self.report_step(f"{self.way.title}: bridge")
        run = self.track()
        if self.relay is not None:
            self.echo(turns, self.track_s / 3.0)
            self.report_step(f"{self.way.title}: bridge without a recorder")
            without = self.track(record=False)
            self.echo(turns, self.track_s / 3.0)
            yield from compared_figures(self.way, run, turns, "")
            recorded, bare = (spread(each.times).at(0.999) for each in (run, without))
            yield Figure(f"{self.way.title}, p99.9", recorded, "µs", bare, "without a recorder")
        yield from bridge_figures(self.way, run, "")

    def measure_awake(self) -> Iterator[Figure]:
        """Measure the same figures while a thread prevents the processors from sleeping. Raises RunFailed."""
        turns = Turns()
        self.echo(turns, self.track_s / 2.0)
        self.report_step(f"{self.way.title}{AWAKE}")
        run = self.track(awake=True)
        if self.relay is not None:
            self.echo(turns, self.track_s / 2.0)
            yield from compared_figures(self.way, run, turns, AWAKE)
        yield from bridge_figures(self.way, run, AWAKE)


def echo_times(relay: Path, way: Way, echo: Sequence[str | Path], file: Path, seconds: float) -> list[float]:
    """Return the answer times of an echo server, s."""
    sizes = str(way.packet), str(way.answer)
    with started(*echo, way.wire, *sizes) as (_, port):
        beats = str(round(way.cycle_s * 1e9)), str(round(seconds / way.cycle_s))
        command = (relay, "send", way.wire, port, file, *sizes, *beats)
        subprocess.run(command, check=True, timeout=seconds + PATIENCE_S)
    return [
        one.taken
        for one in exchanges.read_exchanges(file.read_bytes(), exchanges.numbered_messages).exchanges
    ]


def free_port() -> int:
    """Return a UDP port that is currently free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def exchanges_while_tracking(data: bytes, way: Way, phases_s: Mapping[str, float]) -> list[Exchange]:
    """Return the exchanges during tracking. Raises RunFailed if there are none.

    Tracking is assumed to end before the last exchange, by the time that the bridge took to retract.
    """
    found = exchanges.read_exchanges(data, way.messages).exchanges
    if not found:
        raise RunFailed("the relay saw no answered packet")
    end = found[-1].at - phases_s.get("retract", 0.0)
    return [one for one in found if end - phases_s["track"] <= one.at <= end]


def spread(times: Iterable[float]) -> Spread:
    """Return the percentiles of answer times, µs."""
    return Spread([time * MICRO for time in times])


def late_per_10000(times: Sequence[float], way: Way) -> float:
    """Return how many answers in 10 000 took longer than the robot's cycle."""
    return 1e4 * sum(time > way.cycle_s for time in times) / len(times)


def compared_figures(way: Way, run: TrackedRun, turns: Turns, how: str) -> Iterator[Figure]:
    """Yield the figures of the bridge, with the figures of the echo servers as baselines."""
    for name, part in PARTS.items():
        for theirs, against in ((turns.c, "C echo"), (turns.plain, "asyncio echo")):
            ours, base = spread(run.times).at(part), spread(theirs).at(part)
            yield Figure(f"{way.title}, {name}{how}", ours, "µs", base, against)
    title = f"{way.title}, late ones (above {way.cycle_s * 1e3:g} ms) of 10 000{how}"
    yield Figure(title, late_per_10000(run.times, way), "", late_per_10000(turns.c, way), "C echo")
    passed = 1e4 * sum(not one.own for one in run.exchanges) / len(run.exchanges)
    yield Figure(f"{way.title}, passed over of 10 000{how}", passed, "")


def bridge_figures(way: Way, run: TrackedRun, how: str) -> Iterator[Figure]:
    """Yield the figures that are based on the bridge's own time stamps, its recording, and the actual rate of the
    robot.
    """
    summary = run.ended.summary
    answers, link, duration_s = summary["answers"], summary["link"], sum(summary["phases_s"].values())
    if answers:  # not for an S3, which is polled
        for name, key in (("p50", "p50_ms"), ("p99", "p99_ms"), ("largest", "max_ms")):
            yield Figure(f"{way.title}, inside the bridge, {name}{how}", answers[key] * 1e3, "µs")
        title = f"{way.title}, inside the bridge, late ones of 10 000{how}"
        yield Figure(title, 1e4 * link.get("late answers", 0) / link["packets"], "")
        title = f"{way.title}, packets a second over the whole run{how}"
        yield Figure(title, link["packets"] / duration_s, "1/s", 1.0 / way.cycle_s, "as asked")
    yield Figure(f"{way.title}, {STOLEN} while the bridge ran{how}", run.ended.stolen_s, "s")
    yield Figure(f"{way.title}, recording of a minute{how}", 60.0 * run.record_mb / duration_s, "MB")


def measure(report_step: Callable[[str], None], seconds: float = TRACK_S) -> Report:
    """Measure all robots with the machine in its normal state, and with its processors kept awake."""
    figures: list[Figure] = []
    left_out = [] if machine.compile_program("relay") else [NO_COMPILER]

    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        for way in WAYS:
            bench = Bench(way, Path(name), seconds, report_step)
            try:
                figures += bench.measure()
                with processors_awake(left_out) as ready:
                    figures += bench.measure_awake() if ready else ()
            except RunFailed as error:
                left_out.append(f"{way.title}: {error}")
    return Report(tuple(figures), tuple(left_out))


if __name__ == "__main__":
    found = measure(lambda step: print(f"… {step}", flush=True), float(sys.argv[1]))
    print("\n".join((*(figure.line() for figure in found.figures), *found.left_out)))

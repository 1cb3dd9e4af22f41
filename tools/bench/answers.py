"""Answers: how soon a robot that drives the cycle is answered by the whole bridge, beside echoes that decide nothing.

The emulated cell is one process, the bridge another, as a person would start them. Between the robot and the bridge a
small C program forwards every packet and stamps it (`c/relay.c`). It also sends packets of the same size, at the same
rate, to the echoes, and stamps those. Echoes and bridge take turns.

`python -m tools.bench.answers 3` tracks for 3 s only and shows the figures.
"""

import json
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from hil_bridge.clock.realtime import RealTime, real_time_thread
from hil_bridge.errors import ConfigError
from tools.bench import exchanges, machine
from tools.bench.exchanges import Chunk, Exchange, Message
from tools.bench.figures import Figure, Report, Spread
from tools.bench.slow_tool import SLOW_TOOL

HERE = Path(__file__).parent
TRACK_S = 60.0
PATIENCE_S = 120.0
"""Longest time of all that a run does beside tracking, s."""
MICRO, MEGA = 1e6, 1e6
AWAKE = ", processors kept awake"
STOLEN = "processor time that the host kept for itself while the bridge ran"
PARTS = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "largest": 1.0}
NO_COMPILER = (
    "there is no C compiler here (`cc`), so the program that stamps packets from outside is missing, and with it the "
    "echoes; what the bridge stamps itself is left"
)
HIL_BRIDGE = (sys.executable, "-m", "hil_bridge")


class Way(NamedTuple):
    """A robot, and the same packets for the echoes."""

    title: str
    kind: str
    wire: str
    cycle_s: float
    packet: int
    """Size of a packet, bytes."""
    answer: int
    messages: Callable[[Iterable[Chunk]], Iterator[Message]]


WAYS = (
    Way("500 Hz over TCP (rtde)", "rtde", "tcp", 0.002, 240, 84, exchanges.rtde),
    Way("250 Hz over UDP (egm)", "egm", "udp", 0.004, 380, 140, exchanges.egm),
)


class RunFailed(Exception):
    """A program of the benchmark did not come to its end."""


@dataclass
class Turns:
    """Answers of both echoes over all of their turns, s."""

    c: list[float] = field(default_factory=list)
    plain: list[float] = field(default_factory=list)


class Tracked(NamedTuple):
    """A run of the bridge."""

    exchanges: Sequence[Exchange]
    """Packets and answers while it tracked; none where nothing stamped them."""
    summary: Mapping[str, Any]
    record_mb: float
    """Size of its recording, MB; 0 without."""
    stolen_s: float

    @property
    def times(self) -> list[float]:
        """How long the answers took, s."""
        return [one.taken for one in self.exchanges]

    @property
    def duration_s(self) -> float:
        """From the begin of the run to its end, s."""
        return float(sum(self.summary["phases_s"].values()))


@contextmanager
def started(*command: str | Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A program, and the first line that it says. It is ended if it has not ended by itself."""
    with subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            if not (line := process.stdout.readline().strip()):
                raise RunFailed(f"{Path(command[0]).name} said nothing and ended with {process.wait()}")
            yield process, line
        finally:
            process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(10.0)
            process.kill()


def echoed(relay: Path, way: Way, echo: Sequence[str | Path], file: Path, seconds: float) -> list[float]:
    """How long an echo took for its answers, s."""
    sizes = str(way.packet), str(way.answer)
    with started(*echo, way.wire, *sizes) as (_, port):
        beats = str(round(way.cycle_s * 1e9)), str(round(seconds / way.cycle_s))
        command = (relay, "send", way.wire, port, file, *sizes, *beats)
        subprocess.run(command, check=True, timeout=seconds + PATIENCE_S)
    return [one.taken for one in exchanges.seen(file.read_bytes(), exchanges.numbered).exchanges]


def echo_turn(relay: Path, way: Way, turns: Turns, file: Path, seconds: float) -> None:
    """A turn of each echo."""
    turns.plain += echoed(relay, way, (sys.executable, HERE / "asyncio_echo.py"), file, seconds)
    turns.c += echoed(relay, way, (relay, "echo"), file, seconds)


def free_port() -> int:
    """A UDP port that is free now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def cell(way: Way, config: Path, relay: Path | None, file: Path) -> Iterator[dict[str, str]]:
    """Options for a bridge to an emulated cell in a process of its own, the relay between where there is one."""
    emulate = (*HIL_BRIDGE, "emulate", "cell", config, "--json")
    with ExitStack() as stack:

        def begun(*command: str | Path) -> str:
            return stack.enter_context(started(*command))[1]

        if way.wire == "udp":
            port = str(free_port())
            door = port if relay is None else begun(relay, "pass", "udp", port, file)
            options = json.loads(begun(*emulate, "--robot-port", f"egm+udp://127.0.0.1:{door}"))
            options["robot"] = f"egm+udp-bind://127.0.0.1:{port}"
        else:
            options = json.loads(begun(*emulate))
            port = options["robot"].partition("?")[0].rpartition(":")[2]
            door = port if relay is None else begun(relay, "pass", "tcp", port, file)
            options["robot"] = options["robot"].replace(f":{port}?", f":{door}?")
        yield options


class How(NamedTuple):
    """The circumstances of a run."""

    record: bool = True
    awake: bool = False
    """The processors are kept from sleeping."""


AS_USUAL = How()


def tracked(relay: Path | None, way: Way, place: Path, seconds: float, how: How = AS_USUAL) -> Tracked:
    """A run of the bridge. Raises RunFailed."""
    record, awake = how
    file, config, recording, told = (
        place / name for name in ("seen", "run.toml", "run.mcap", "summary.json")
    )
    text = SLOW_TOOL % (seconds, way.kind)
    config.write_text(text, encoding="utf-8")
    for old in (file, recording):
        old.unlink(missing_ok=True)
    with cell(way, config, relay, file) as options:
        if awake:
            config.write_text(f"{text}[realtime]\nkeep_awake = true\n", encoding="utf-8")
        devices = [part for name, value in options.items() for part in (f"--{name}", value)]
        keep = ["--record", recording] if record else ["--no-record"]
        command = [*HIL_BRIDGE, "run", config, *devices, "--no-view", *keep, "--summary", told, "--overwrite"]
        stolen = machine.stolen_s()
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=seconds + PATIENCE_S, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise RunFailed(f"the run has not ended within {error.timeout:g} s") from error
        stolen = machine.stolen_s() - stolen
    if done.returncode:
        raise RunFailed(f"the run ended with {done.returncode}: {done.stderr.strip()}")
    summary = json.loads(told.read_text(encoding="utf-8"))
    seen = [] if relay is None else while_tracking(file.read_bytes(), way, summary["phases_s"])
    return Tracked(seen, summary, recording.stat().st_size / MEGA if record else 0.0, stolen)


def while_tracking(data: bytes, way: Way, phases_s: Mapping[str, float]) -> list[Exchange]:
    """The exchanges of the tracking. It ends as long before the last one as the bridge took to retract."""
    found = exchanges.seen(data, way.messages).exchanges
    end = found[-1].at - phases_s.get("retract", 0.0)
    return [one for one in found if end - phases_s["track"] <= one.at <= end]


def spread(times: Iterable[float]) -> Spread:
    """Their spread, µs."""
    return Spread([time * MICRO for time in times])


def late(times: Sequence[float], way: Way) -> float:
    """How many of 10 000 took longer than the robot's cycle."""
    return 1e4 * sum(time > way.cycle_s for time in times) / len(times)


def beside(way: Way, run: Tracked, turns: Turns, how: str) -> Iterator[Figure]:
    """The bridge beside the echoes."""
    for name, part in PARTS.items():
        for theirs, against in ((turns.c, "C echo"), (turns.plain, "asyncio echo")):
            ours, base = spread(run.times).at(part), spread(theirs).at(part)
            yield Figure(f"{way.title}, {name}{how}", ours, "µs", base, against)
    title = f"{way.title}, late ones (above {way.cycle_s * 1e3:g} ms) of 10 000{how}"
    yield Figure(title, late(run.times, way), "", late(turns.c, way), "C echo")
    passed = 1e4 * sum(not one.own for one in run.exchanges) / len(run.exchanges)
    yield Figure(f"{way.title}, passed over of 10 000{how}", passed, "")


def inside(way: Way, run: Tracked, how: str) -> Iterator[Figure]:
    """Stamps of the bridge itself over the whole run, its recording, and the robot's rate as it was."""
    answers, link = run.summary["answers"], run.summary["link"]
    for name, key in (("p50", "p50_ms"), ("p99", "p99_ms"), ("largest", "max_ms")):
        yield Figure(f"{way.title}, inside the bridge, {name}{how}", answers[key] * 1e3, "µs")
    title = f"{way.title}, inside the bridge, late ones of 10 000{how}"
    yield Figure(title, 1e4 * link.get("late answers", 0) / link["packets"], "")
    yield Figure(f"{way.title}, {STOLEN}{how}", run.stolen_s, "s")
    rate = run.summary["link"]["packets"] / run.duration_s
    title = f"{way.title}, packets a second over the whole run{how}"
    yield Figure(title, rate, "1/s", 1.0 / way.cycle_s, "as asked")
    yield Figure(f"{way.title}, recording of a minute{how}", 60.0 * run.record_mb / run.duration_s, "MB")


def measured(way: Way, place: Path, seconds: float, say: Callable[[str], None]) -> Iterator[Figure]:
    """All about one robot on the machine as it is. Raises RunFailed."""
    relay, turns, file = machine.compiled("relay"), Turns(), place / "seen"

    def echoes() -> None:
        if relay is not None:
            say(f"{way.title}: echoes")
            echo_turn(relay, way, turns, file, seconds / 3.0)

    echoes()
    say(f"{way.title}: bridge")
    run = tracked(relay, way, place, seconds)
    if relay is not None:
        echoes()
        say(f"{way.title}: bridge without a recorder")
        without = tracked(relay, way, place, seconds, How(record=False))
        echoes()
        yield from beside(way, run, turns, "")
        recorded, bare = (spread(each.times).at(0.999) for each in (run, without))
        yield Figure(f"{way.title}, p99.9", recorded, "µs", bare, "without a recorder")
    yield from inside(way, run, "")


def kept_awake(way: Way, place: Path, seconds: float, say: Callable[[str], None]) -> Iterator[Figure]:
    """With processors that do not sleep. Raises RunFailed, and ConfigError where the machine refuses."""
    relay, turns, file = machine.compiled("relay"), Turns(), place / "seen"
    with real_time_thread(RealTime(keep_awake=True)):
        say(f"{way.title}{AWAKE}")
        if relay is not None:
            echo_turn(relay, way, turns, file, seconds / 2.0)
        run = tracked(relay, way, place, seconds, How(awake=True))
        if relay is not None:
            echo_turn(relay, way, turns, file, seconds / 2.0)
            yield from beside(way, run, turns, AWAKE)
    yield from inside(way, run, AWAKE)


def measure(say: Callable[[str], None], seconds: float = TRACK_S) -> Report:
    """Both robots, as the machine is and with its processors kept awake."""
    figures: list[Figure] = []
    left_out = [] if machine.compiled("relay") else [NO_COMPILER]
    with tempfile.TemporaryDirectory(prefix="hil-bridge-bench-") as name:
        for way in WAYS:
            for part in (measured, kept_awake):
                try:
                    figures += part(way, Path(name), seconds, say)
                except RunFailed as error:
                    left_out.append(f"{way.title}: {error}")
                except ConfigError as error:
                    if str(error) not in left_out:
                        left_out.append(str(error))
    return Report(tuple(figures), tuple(left_out))


if __name__ == "__main__":
    found = measure(lambda step: print(f"… {step}", flush=True), float(sys.argv[1]))
    print("\n".join((*(figure.line() for figure in found.figures), *found.left_out)))

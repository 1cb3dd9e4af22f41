"""`hil-bridge latency`: where a recorded run's time went, and the same for an emulation."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hil_bridge.console.options import json_option, output_option, overwrite_option, tell_json
from hil_bridge.console.paths import FILE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hil_bridge.record import Recording
    from hil_bridge.record.analysis.answers import Answers
    from hil_bridge.record.analysis.latency import Latency, Part
    from hil_bridge.settings.configuration import Config
    from protocol.devices.s3.adlp import LinkProfile


@click.command(short_help="Tell where the time from force to motion goes.")
@click.argument("recording", type=FILE)
@output_option("SITE.toml", "Write settings for an emulation that is as late.")
@json_option
@overwrite_option
def latency(recording: Path, out: Path | None, as_json: bool, overwrite: bool) -> None:
    """Tell where the time between a force and the motion that answers it went in a recorded run.

    With -o the site's turnaround and the jitter of its sensor become a configuration: `hil-bridge run SITE.toml`
    then draws them again, by the seed, in an emulated cell with the same gateway or board.
    """
    from hil_bridge.errors import ConfigError
    from hil_bridge.errors.text_files import harmless
    from hil_bridge.record import read
    from hil_bridge.record.analysis.answers import answers_of
    from hil_bridge.record.analysis.latency import latency_of
    from hil_bridge.record.analysis.summary import end_of
    from hil_bridge.record.device_facts import devices_of
    from hil_bridge.record.files import write_whole
    from hil_bridge.record.reader import NO_CYCLE

    record = read(recording)
    if not record.cycles and out is None:
        if as_json:
            tell_json(None)
        else:
            click.echo(f"no times: {NO_CYCLE}")
        return
    found = latency_of(record)
    if found is None:
        robot = devices_of(record).robot
        if robot.hops is None and robot.kind not in ("", "s3"):
            raise ConfigError(
                f"{recording}: a {robot.kind} does not tell how its stamps divide a cycle (RobotFacts.hops)"
            )
        raise ConfigError(f"{recording} holds no cycle that was stamped at every hop; record a longer run")
    robot = devices_of(record).robot
    answers = answers_of(record.cycles, robot, end_of(record).link)
    lines = [*_lines(found), *(_answer_lines(answers) if answers is not None else ())]
    if record.truncated:
        lines.append("the recording is cut short or damaged: this is what came before")
    if out is not None:  # before the first output: a reader such as `head` may have closed the pipe
        text, left_out = _site(record)
        write_whole(out, text.encode(), overwrite)
        lines.append(f"wrote {out}{left_out and f'; {left_out}'}")
    if as_json:
        tell_json({**_values(found, answers), "truncated": record.truncated})
        return
    for line in lines:
        click.echo(harmless(line))


def _values(found: "Latency", answers: "Answers | None") -> "dict[str, Any]":
    """The table as values, ms."""

    def row(part: "Part") -> "dict[str, Any]":
        hop = part.hop
        return {"hop": hop.name, "whose": hop.owner, "meaning": hop.words, **part.times.as_ms()}

    told: dict[str, Any] = {
        "name": found.name,
        "chain": [row(part) for part in found.chain],
        "beside": [row(part) for part in found.beside],
        "total": found.total.as_ms(),
        "largest": found.largest.hop.name,
        "not_stamped": [
            {"meaning": one.words, "ms": one.seconds * 1e3, "source": one.source} for one in found.constants
        ],
        "answers": None,
    }
    if answers is not None:
        told["answers"] = {
            **answers.times.as_ms(),
            "late": answers.late,
            "packets": answers.packets,
            "cycle_ms": answers.cycle_s * 1e3,
        }
    return told


def _site(record: "Recording") -> tuple[str, str]:
    """A configuration file whose emulated cell is as late as the recorded one, and what it leaves out, if anything."""
    from hil_bridge.devices.sensors.jr3.latency import NOT_EMULATED, is_emulated
    from hil_bridge.devices.sensors.jr3.settings import Jr3Settings
    from hil_bridge.errors import ConfigError
    from hil_bridge.runs.replay import recorded_config
    from hil_bridge.settings.devices import robot_in, sensor_in

    config = recorded_config(record, {})
    robot, sensor = robot_in(config).kind.name, sensor_in(config).kind
    if robot != "s3" or sensor.settings is not Jr3Settings:
        raise ConfigError(
            f"-o writes settings of an emulated s3 and a JR3; this was a {robot} with a {sensor.name}: leave -o out"
        )
    return site_settings(record, _line(config), sensor.name), "" if is_emulated(sensor.name) else NOT_EMULATED


def site_settings(record: "Recording", line: "LinkProfile", sensor: str) -> str:
    """A configuration file whose emulated cell is as late as the recorded one.

    `line` is the line as it was, `sensor` what stood before the sensor, as `sensor.emulated` names it. Raises
    ConfigError for a recording that is too short or was not stamped.
    """
    from hil_bridge.devices.robots.s3 import latency as robot
    from hil_bridge.devices.sensors.jr3 import latency as jr3
    from hil_bridge.record.analysis.site_latency import (
        as_configuration,
        frame_quantiles_ms,
        robot_quantiles_ms,
    )

    sections = robot.late_settings(robot_quantiles_ms(record), line)
    note, more = jr3.late_settings(sensor, lambda: frame_quantiles_ms(record))
    notes = (*robot.NOTES, note, "In a file that has a section already, its lines go there.")
    return as_configuration(notes, {**sections, **more})


def _lines(found: "Latency") -> "Iterator[str]":
    yield f"{'hop':<19}{'whose':<10}{'p50':>8}{'p90':>8}{'p99':>8}{'max':>8}  ms"
    for part in found.chain:
        yield _row(part)
    total = found.total
    yield f"{found.name:<29}" + _figures(total.p50_s, total.p90_s, total.p99_s, total.max_s)
    yield f"largest: {found.largest_words}"
    if found.beside:
        yield "beside it:"
        for part in found.beside:
            yield _row(part)
    for constant in found.constants:
        yield f"not stamped: {constant.words}, {constant.seconds * 1e3:.1f} ms ({constant.source})"


def _answer_lines(answers: "Answers") -> "Iterator[str]":
    yield f"answers: {answers.sentence}"
    if answers.consequence:
        yield f"of a late answer: {answers.consequence}"


def _row(part: "Part") -> str:
    hop, times = part.hop, part.times
    figures = _figures(times.p50_s, times.p90_s, times.p99_s, times.max_s)
    return f"{hop.name:<19}{hop.owner:<10}{figures}  {hop.words}"


def _figures(*seconds: float) -> str:
    return "".join(f"{value * 1e3:8.2f}" for value in seconds)


def _line(config: "Config") -> "LinkProfile":
    """The line as it was: a URL may have set it."""
    from hil_bridge.devices.robots.s3.room import robot_wire
    from hil_bridge.settings.devices import robot_in

    robot = robot_in(config)
    link: LinkProfile = robot.settings.client.link
    return robot_wire(robot.url, link)[1] if robot.url else link

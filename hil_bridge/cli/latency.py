"""`hil-bridge latency`: latency budget of a recorded run, and settings for an emulation with the same latency."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hil_bridge.console.options import echo_json, json_option, output_option, overwrite_option
from hil_bridge.console.paths import FILE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from hil_bridge.devices.emulator_fit import LateSensor, LateSettings
    from hil_bridge.record import Recording
    from hil_bridge.record.analysis.answers import Answers
    from hil_bridge.record.analysis.latency import Latency, Part


@click.command(short_help="Show the latency from force to motion, by part.")
@click.argument("recording", type=FILE)
@output_option("SITE.toml", "Write settings for an emulation that is as late.")
@json_option
@overwrite_option
def latency(recording: Path, out: Path | None, as_json: bool, overwrite: bool) -> None:
    """Break down the time from a force to the motion that answers it, by part, for a recorded run.

    -o writes the site's turnaround and the jitter of its sensor as a configuration: `hil-bridge run SITE.toml`
    then draws from them, by the seed, in an emulated cell with the same gateway or board.
    """
    from hil_bridge.errors import ConfigError
    from hil_bridge.errors.text_files import harmless
    from hil_bridge.record import read
    from hil_bridge.record.analysis.answers import answers_of
    from hil_bridge.record.analysis.latency import latency_of
    from hil_bridge.record.analysis.summary import end_of
    from hil_bridge.record.device_facts import devices_of
    from hil_bridge.record.files import write_atomically
    from hil_bridge.record.reader import NO_CYCLE

    record = read(recording)
    if not record.cycles and out is None:
        if as_json:
            echo_json(None)
        else:
            click.echo(f"no times: {NO_CYCLE}")
        return
    budget = latency_of(record)
    if budget is None:
        robot = devices_of(record).robot
        if robot.hops is None and robot.kind not in ("", "s3"):
            raise ConfigError(
                f"{recording}: the kind {robot.kind!r} does not declare the hops of a cycle (RobotFacts.hops)"
            )
        raise ConfigError(f"{recording} has no cycle with a time stamp at every hop; record a longer run")
    robot = devices_of(record).robot
    answers = answers_of(record.cycles, robot, end_of(record).link)
    lines = [*_lines(budget), *(_answer_lines(answers) if answers is not None else ())]
    if record.truncated:
        lines.append("the recording is cut short or damaged; the figures cover what precedes that")
    if out is not None:  # before the first output: a reader such as `head` may have closed the pipe
        text, left_out = _site(record)
        write_atomically(out, text.encode(), overwrite)
        lines.append(f"wrote {out}{left_out and f'; {left_out}'}")
    if as_json:
        echo_json({**_values(budget, answers), "truncated": record.truncated})
        return
    for line in lines:
        click.echo(harmless(line))


def _values(budget: "Latency", answers: "Answers | None") -> "dict[str, Any]":
    """Return the table as values in ms."""

    def row(part: "Part") -> "dict[str, Any]":
        hop = part.hop
        return {"hop": hop.name, "whose": hop.owner, "meaning": hop.words, **part.times.as_ms()}

    values: dict[str, Any] = {
        "name": budget.name,
        "chain": [row(part) for part in budget.chain],
        "beside": [row(part) for part in budget.beside],
        "total": budget.total.as_ms(),
        "largest": budget.largest.hop.name,
        "not_stamped": [
            {"meaning": one.words, "ms": one.seconds * 1e3, "source": one.source} for one in budget.constants
        ],
        "answers": None,
    }
    if answers is not None:
        values["answers"] = {
            **answers.times.as_ms(),
            "late": answers.late,
            "packets": answers.packets,
            "cycle_ms": answers.cycle_s * 1e3,
        }
    return values


def _site(record: "Recording") -> tuple[str, str]:
    """Return a configuration whose emulated cell has the latency of the recorded one, and a description of what it
    omits, if anything.
    """
    from hil_bridge.errors import ConfigError
    from hil_bridge.runs.replay import recorded_config
    from hil_bridge.settings.devices import robot_in, sensor_in

    config = recorded_config(record, {})
    robot, sensor = robot_in(config), sensor_in(config)
    late_robot = None if robot.kind.emulation is None else robot.kind.emulation.late
    late_sensor = None if sensor.kind.emulation is None else sensor.kind.emulation.late
    if late_robot is None or late_sensor is None:
        raise ConfigError(
            "-o writes settings only for an emulated s3 with a jr3; "
            f"this was {robot.kind.name} with {sensor.kind.name}: leave -o out"
        )
    return site_settings(record, lambda times: late_robot(times, robot.url, robot.settings), late_sensor)


def site_settings(
    record: "Recording",
    late_robot: "Callable[[Mapping[str, Sequence[float]]], LateSettings]",
    late_sensor: "LateSensor",
) -> tuple[str, str]:
    """Return a configuration file whose emulated cell has the latency of the recorded one, and a description of
    what it omits, if anything.

    Raises ConfigError if the recording is too short or has no time stamps.
    """
    from hil_bridge.record.analysis.site_latency import (
        as_configuration,
        frame_quantiles_ms,
        robot_quantiles_ms,
    )

    robot = late_robot(robot_quantiles_ms(record))
    sensor = late_sensor(lambda: frame_quantiles_ms(record))
    notes = (*robot.notes, *sensor.notes, "If a file already has a section, add the lines to it.")
    left_out = "; ".join(filter(None, (robot.left_out, sensor.left_out)))
    return as_configuration(notes, {**robot.sections, **sensor.sections}), left_out


def _lines(budget: "Latency") -> "Iterator[str]":
    yield f"{'hop':<19}{'whose':<10}{'p50':>8}{'p90':>8}{'p99':>8}{'max':>8}  ms"
    for part in budget.chain:
        yield _row(part)
    total = budget.total
    yield f"{budget.name:<29}" + _figures(total.p50_s, total.p90_s, total.p99_s, total.max_s)
    yield f"largest: {budget.largest_text}"
    if budget.beside:
        yield "in parallel:"
        for part in budget.beside:
            yield _row(part)
    for constant in budget.constants:
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

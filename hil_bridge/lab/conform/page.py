"""Page of a conformance test: one file that an author of a client can attach to a bug report."""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from html import escape
from pathlib import PurePath
from typing import Any

from hil_bridge.lab.conform.reports import evidence, lateness, not_modelled, printable, released
from hil_bridge.lab.conform.trial import SUITE_VERSION, ScenarioResult, Trial
from hil_bridge.lab.conform.verdict import Outcome
from hil_bridge.show.charts.end_panel import unbreakable
from hil_bridge.show.pages import document
from hil_bridge.show.pages.timeline import timeline
from hil_bridge.show.report.identity import EMULATED
from hil_bridge.show.report.markup import across, cells, fold, pairs, prose
from hil_bridge.show.report.markup import command as render_command
from protocol.marks import settings

_SIGNS = {Outcome.PASSED: ("good", "✓"), Outcome.FAILED: ("bad", "✗"), Outcome.SKIPPED: ("none", "–")}
_EMULATED = (
    "The device was emulated: its states after a fault are assumed, and the verdict says nothing about the safety "
    "of people."
)


def conform_page(
    trial: Trial[Any], results: Sequence[ScenarioResult[Any]], client: Sequence[str], tested_at: datetime
) -> str:
    """Render the page. `client` contains the options and the command of the client, which the page repeats."""
    failed = [one for one in results if one.verdict.outcome is Outcome.FAILED]
    title = f"Client test: {trial.thing} {trial.kind}"
    command = client[client.index("--") + 1 :]
    short = shlex.join(PurePath(word).name if word.startswith("/") else word for word in command)
    tested = f"tested {tested_at.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"
    style, outcome = ("bad", "failed") if failed else ("good", "passed")
    if all(one.verdict.outcome is Outcome.SKIPPED for one in results):
        style, outcome = "plain", "not tested"
    cautions = "".join(
        f'<p class="bar caution"><b>Caution:</b>{escape(text)}.</p>' for text in lateness(results)
    )
    badge = outcome + ", timing uncertain" * any(lateness(failed or results))
    notes = "".join(f'<p class="quiet">Note: {escape(text)}.</p>' for text in not_modelled(results))
    rules = [(one.name, f"{one.value!s} {one.info.unit}", one.info.meaning) for one in settings(trial.rules)]
    body = f"""<header class="headline"><h1>{escape(title)}</h1><span class="badges">
<span class="badge {style}">{badge}</span><span class="badge plain">{EMULATED}</span></span></header>
<p class="quiet small">Client <code title="{escape(shlex.join(command))}">{escape(short)}</code>, {tested}
with hil-bridge {escape(released())}, suite {SUITE_VERSION}.</p>
<p class="point">{prose(unbreakable(_verdict(results, failed)))}</p>
{cautions}
{_table(results) if len(results) > 1 else ""}{notes}
{"".join(_failure(trial, one, client) for one in failed)}
{fold(f"<h2>Rules</h2>{cells(('rule', 'value', 'meaning'), rules, 'narrow')}")}
<p class="quiet">{_EMULATED}</p>"""
    return document(f"{title}, {outcome}", body, charts=False)


def repeat_command(trial: Trial[Any], only: str, client: Sequence[str]) -> str:
    """Return the command that repeats one scenario with the same rules."""
    rules = trial.rules
    words = ["hil-bridge", "conform", trial.kind, "--only", only]
    for one in fields(rules):  # type: ignore[arg-type]
        value = getattr(rules, one.name)
        if value != one.default:
            words += (
                [f"--{one.name.replace('_', '-')}"]
                if value is True
                else ["--set", f"{one.name}={value:.12g}"]
            )
    return shlex.join([*words, *client])


def _verdict(results: Sequence[ScenarioResult[Any]], failed: Sequence[ScenarioResult[Any]]) -> str:
    """Return the verdict in one sentence, with the first mistake of a single failure; the table has the others."""
    if len(results) == 1 and not failed:
        return f"{results[0].verdict.outcome.capitalize()}: {results[0].verdict.reason}."
    if not failed:
        skipped = [one.name for one in results if one.verdict.outcome is Outcome.SKIPPED]
        if len(skipped) == len(results):
            return "No scenario could be judged."
        without = f"; skipped: {', '.join(skipped)}" if skipped else ""
        return f"The client passed {len(results) - len(skipped)} of {len(results)} scenarios{without}."
    *others, last = (f"`{one.name}`" for one in failed)
    names = f"{', '.join(others)} and {last}" if others else last
    if len(results) == 1:
        return f"Failed: {failed[0].verdict.reason}."
    mistake = f": {failed[0].verdict.faults[0]}" if len(failed) == 1 else ""
    return f"The client failed {names}, {len(failed)} of {len(results)} scenarios{mistake}."


def _table(results: Sequence[ScenarioResult[Any]]) -> str:
    head = "".join(f"<th>{name}</th>" for name in ("", "scenario", "fault", "result"))
    lines = "".join(f"<tr>{_row(one)}</tr>" for one in results)
    return f'<table class="verdicts"><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>'


def _row(one: ScenarioResult[Any]) -> str:
    style, sign = _SIGNS[one.verdict.outcome]
    reasons = "<br>".join(map(escape, one.verdict.faults or (one.verdict.reason,)))
    name = escape(one.name)
    linked = f'<a href="#{name}">{name}</a>' if one.verdict.outcome is Outcome.FAILED else name
    return (
        f'<td class="{style}">{sign} {one.verdict.outcome}</td><td>{linked}</td>'
        f'<td class="note">{escape(one.meaning)}</td><td>{reasons}</td>'
    )


def _failure(trial: Trial[Any], one: ScenarioResult[Any], client: Sequence[str]) -> str:
    """Render a failed scenario: the time line, how to repeat it, and the evidence."""
    return f"""<section id="{escape(one.name)}"><h2>{escape(one.name)}: {escape(one.meaning)}</h2>
{timeline(trial.timeline(one.name, one.seen))}
{render_command("Repeat it", repeat_command(trial, one.name, client))}
{"".join(_details(one))}</section>"""


def _details(one: ScenarioResult[Any]) -> Iterator[str]:
    """Yield the client's output and the evidence, folded."""
    if one.output.strip():
        lines = "\n".join(map(printable, one.output.rstrip().splitlines()))
        yield f"<details><summary>Output of the client</summary><pre>{escape(lines)}</pre></details>"
    values = pairs((name, str(value)) for name, value in evidence(one).items())
    yield f"<details><summary>Evidence</summary>{across(values)}</details>"

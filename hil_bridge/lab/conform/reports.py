"""Reports of the scenarios: a table for people, JSON, and JUnit for build servers."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import msgspec

from hil_bridge.clock.heartbeat import MOST_S
from hil_bridge.lab.conform.trial import SUITE_VERSION, Played
from hil_bridge.lab.conform.verdict import Outcome
from hil_bridge.lab.junit import JunitCase, Verdict, encode_junit
from protocol.unmodelled import relied_on

_VERDICTS = {Outcome.PASSED: Verdict.PASSED, Outcome.FAILED: Verdict.FAILED, Outcome.SKIPPED: Verdict.SKIPPED}
_OUTPUT_LINES = 20
"""Chosen: lines of a client's output that the table shows behind a scenario that failed."""


def _released() -> str:
    try:
        return version("hil-bridge")
    except PackageNotFoundError:
        return "unknown"


def table(played: Sequence[Played[Any]]) -> Iterator[str]:
    """Lines for people: one a scenario, and the output of those that failed."""
    width = max(len(one.name) for one in played)
    for one in played:
        yield f"{one.name:{width}}  {one.verdict.outcome:7}  {one.verdict.reason}"
    for one in played:
        if one.verdict.outcome is Outcome.FAILED and one.output.strip():
            yield ""
            yield f"output of the client in {one.name}, its end:"
            for line in one.output.rstrip().splitlines()[-_OUTPUT_LINES:]:
                yield f"  {_plain(line)}"


def not_modelled(played: Sequence[Played[Any]]) -> Iterator[str]:
    """One line with all things that the client relied on and the emulated device does not model; none without any."""
    things = dict.fromkeys(thing for one in played for thing in one.not_modelled)
    if things:
        yield relied_on(list(things))


def lateness(played: Sequence[Played[Any]]) -> Iterator[str]:
    """One line where this computer was too busy in a scenario; none where it never was."""
    late = {one.name: one.seen.late_s for one in played if one.seen.late_s >= MOST_S}
    if late:
        yield (
            f"this process was late by up to {max(late.values()) * 1e3:.0f} ms in {', '.join(late)}: "
            "on a busy computer a verdict may change; end other programs, and repeat it"
        )


def totals(played: Sequence[Played[Any]]) -> str:
    """One line: how many passed, failed and were skipped."""
    counts = {outcome: sum(one.verdict.outcome is outcome for one in played) for outcome in Outcome}
    return ", ".join(f"{count} {outcome}" for outcome, count in counts.items())


def evidence(one: Played[Any]) -> dict[str, Any]:
    """The evidence by name; unknown values are left out."""
    found = {key: value for key, value in asdict(one.seen).items() if value not in (None, "", [])}
    return {key: round(value, 6) if isinstance(value, float) else value for key, value in found.items()}


def as_json(what: tuple[str, str], command: Sequence[str], rules: Any, played: Sequence[Played[Any]]) -> str:
    """All of it as JSON; `what` is robot or sensor, and its kind."""
    found = {
        what[0]: what[1],
        "command": list(command),
        "hil_bridge": _released(),
        "suite": SUITE_VERSION,
        "rules": asdict(rules),
        "scenarios": [
            {
                "name": one.name,
                "meaning": one.meaning,
                "outcome": one.verdict.outcome.value,
                "reason": one.verdict.reason,
                "seconds": round(one.seconds, 3),
                "evidence": evidence(one),
                "not_modelled": [asdict(thing) for thing in one.not_modelled],
                "output": one.output,
            }
            for one in played
        ],
    }
    return msgspec.json.format(msgspec.json.encode(found), indent=2).decode() + "\n"


def as_junit(kind: str, played: Sequence[Played[Any]]) -> bytes:
    """All of it as JUnit XML: one test case a scenario, its evidence as properties."""
    cases = [
        JunitCase(
            f"conform.{kind}",
            one.name,
            one.seconds,
            _VERDICTS[one.verdict.outcome],
            one.verdict.reason,
            properties=[*_evidence_texts(one), *(("not_modelled", str(thing)) for thing in one.not_modelled)],
            output=one.output,
        )
        for one in played
    ]
    return encode_junit(f"hil-bridge conform {kind}", cases)


def _evidence_texts(one: Played[Any]) -> Iterator[tuple[str, str]]:
    for key, value in evidence(one).items():
        yield key, json.dumps(value) if isinstance(value, list | tuple) else str(value)


def _plain(text: str) -> str:
    """A line of a stranger's output that does nothing to the terminal."""
    return "".join(sign if sign.isprintable() else "\ufffd" for sign in text)

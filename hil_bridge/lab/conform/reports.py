"""Reports of the scenarios: a text table, JSON, and JUnit for build servers."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import msgspec

from hil_bridge.clock.heartbeat import MOST_S
from hil_bridge.lab.conform.trial import SUITE_VERSION, ScenarioResult
from hil_bridge.lab.conform.verdict import Outcome
from hil_bridge.lab.junit import JunitCase, Verdict, encode_junit
from protocol.unmodelled import describe_unmodelled

_VERDICTS = {Outcome.PASSED: Verdict.PASSED, Outcome.FAILED: Verdict.FAILED, Outcome.SKIPPED: Verdict.SKIPPED}
_OUTPUT_LINES = 20
"""Number of output lines printed for a failed scenario. Chosen."""


def released() -> str:
    """Return the version of hil-bridge."""
    try:
        return version("hil-bridge")
    except PackageNotFoundError:
        return "unknown"


def table(results: Sequence[ScenarioResult[Any]]) -> Iterator[str]:
    """Yield one text line per scenario, followed by the client output of the failed scenarios."""
    width = max(len(one.name) for one in results)
    for one in results:
        yield f"{one.name:{width}}  {one.verdict.outcome:7}  {one.verdict.reason}"
    for one in results:
        if one.verdict.outcome is Outcome.FAILED and one.output.strip():
            yield ""
            yield f"end of the client's output in {one.name}:"
            for line in one.output.rstrip().splitlines()[-_OUTPUT_LINES:]:
                yield f"  {printable(line)}"


def not_modelled(results: Sequence[ScenarioResult[Any]]) -> Iterator[str]:
    """Yield a line that lists the features that the client used and the emulated device does not model, if there
    are any.
    """
    things = dict.fromkeys(thing for one in results for thing in one.not_modelled)
    if things:
        yield describe_unmodelled(list(things))


def lateness(results: Sequence[ScenarioResult[Any]]) -> Iterator[str]:
    """Yield a warning if this computer was too busy in a scenario."""
    late = {one.name: one.seen.late_s for one in results if one.seen.late_s >= MOST_S}
    if late:
        yield (
            f"this computer was too busy in {', '.join(late)}: hil-bridge was late by up to "
            f"{max(late.values()) * 1e3:.0f} ms, which may change a verdict; close other programs and run again"
        )


def totals(results: Sequence[ScenarioResult[Any]]) -> str:
    """Return the numbers of passed, failed and skipped scenarios as one line of text."""
    counts = {outcome: sum(one.verdict.outcome is outcome for one in results) for outcome in Outcome}
    return ", ".join(f"{count} {outcome}" for outcome, count in counts.items())


def evidence(one: ScenarioResult[Any]) -> dict[str, Any]:
    """Return the evidence of a scenario by name, without unknown values."""
    known = {key: value for key, value in asdict(one.seen).items() if value not in (None, "", [])}
    return {key: _plain(value) for key, value in known.items()}


def _plain(value: Any) -> Any:
    """Convert a value to plain types, which other processes can receive, with floats rounded to 1 µm and 1 µs."""
    match value:
        case str():
            return str(value)
        case float():
            return round(value, 6)
        case list() | tuple():
            return [_plain(one) for one in value]
        case dict():
            return {key: _plain(one) for key, one in value.items()}
        case _:
            return value


def as_json(
    what: tuple[str, str], command: Sequence[str], rules: Any, results: Sequence[ScenarioResult[Any]]
) -> str:
    """Encode the report as JSON; `what` contains the type of the device, robot or sensor, and its kind."""
    report = {
        what[0]: what[1],
        "command": list(command),
        "hil_bridge": released(),
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
            for one in results
        ],
    }
    return msgspec.json.format(msgspec.json.encode(report), indent=2).decode() + "\n"


def as_junit(kind: str, results: Sequence[ScenarioResult[Any]]) -> bytes:
    """Encode the report as JUnit XML: one test case per scenario, with its evidence as properties."""
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
        for one in results
    ]
    return encode_junit(f"hil-bridge conform {kind}", cases)


def _evidence_texts(one: ScenarioResult[Any]) -> Iterator[tuple[str, str]]:
    for key, value in evidence(one).items():
        yield key, json.dumps(value) if isinstance(value, list | tuple) else str(value)


def printable(text: str) -> str:
    """Replace non-printable characters in a line of a client's output."""
    return "".join(sign if sign.isprintable() else "\ufffd" for sign in text)

"""Comparison of runs on one page."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from hil_bridge.errors import ConfigError
from hil_bridge.record import EventKind, EventRecord, Recording
from hil_bridge.record.analysis.definition import difference
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.show.report.compare import BEGIN, compare_page, names_of
from tests.record.written_recordings import cycle_of

EVIL = "</script><script>alert(1)</script>"


def run(force_n: float, touch: int, settings: dict[str, Any]) -> Recording:
    """Return a run of a hundred cycles of 0.1 s; the first `touch` of them approach."""
    cycles = tuple(
        cycle_of(
            cycle=k,
            phase="track" if k >= touch else "approach",
            started_at=100.0 + 0.1 * k,
            status_at=math.nan,
            sensor_at=math.nan,
            controlled_at=100.0 + 0.1 * k + 0.05,
            sent_at=math.nan,
            answered_at=100.0 + 0.1 * k + 0.08,
            sensor_sequence=k,
            force=force_n if k >= touch else 0.0,
            force_reference=10.0,
            wrench=(3.0, 4.0, -force_n if k >= touch else 0.0, 0.0, 0.0, 0.0),
            depth=0.001 * k,
            depth_commanded=0.001 * k,
        )
        for k in range(100)
    )
    events = (EventRecord(109.0, EventKind.STOP, EVIL),) if force_n > 10.0 else ()
    return Recording(cycles, events=events, metadata={"controller": "pi", "config": json.dumps(settings)})


def test_compare_aligns_runs_at_contact() -> None:
    first = run(9.0, 20, {"limits": {"force_limit_n": 50.0}, "run": {"seed": 1}})
    second = run(12.0, 40, {"limits": {"force_limit_n": 50.0}, "run": {"seed": 2}, "more": EVIL})
    page = compare_page({"a": first, EVIL: second})
    assert page.count("<script") == 2
    (text,) = re.findall(r'id="data-runs">(.*?)</script>', page, re.DOTALL)
    reported = json.loads(text)
    for index, (recording, force, touch) in enumerate(((first, 9.0, 20), (second, 12.0, 40))):
        source = reported["sources"][f"run{index}"]
        assert source["x"] == pytest.approx([0.1 * (k - touch) + 0.05 for k in range(100)], abs=1e-5)
        assert source["force"] == [cycle.force for cycle in recording.cycles]
        assert max(source["force"]) == force
        assert set(source["lateral"]) == {5.0}
    assert [series["label"] for series in reported["charts"][0]["series"]] == ["a", "target", EVIL]
    assert [mark["text"] for mark in reported["marks"]] == [f"{EVIL}: stop: {EVIL}"]
    assert reported["charts"][0]["limits"] == [
        {"value": 50.0, "label": "force limit"},
    ]
    rows = re.findall(
        r"<tr><td>([\w.<>]+)</td><td>(.*?)</td><td>(.*?)</td></tr>",
        page.partition("Settings that differ")[2].partition("How they ended")[0],
    )
    assert [row[0] for row in rows] == ["run.<wbr>seed", "more"], "equal values are omitted"
    assert rows[0][1:] == ("1", "2")
    from_begin = json.loads(
        re.findall(
            r'id="data-runs">(.*?)</script>', compare_page({"a": first, "b": second}, BEGIN), re.DOTALL
        )[0]
    )
    assert from_begin["sources"]["run1"]["x"][0] == pytest.approx(0.05)


def test_compare_folds_many_settings() -> None:
    first, second = (run(9.0, 20, {"cell": {f"n{k}": k + more for k in range(7)}}) for more in (0, 1))
    page = compare_page({"a": first, "b": second})
    assert '<details class="fold"><summary><h2>Settings that differ: 7</h2></summary>' in page


def test_compare_begins_with_charts_and_figures() -> None:
    first = run(9.0, 20, {"run": {"seed": 1}, "task": {"force_n": 9.0}})
    second = run(9.0, 20, {"run": {"seed": 2}, "task": {"force_n": 9.0}, "cell": {"new": 1}})
    page = compare_page({"a": first, "b": second})
    parts = (
        '<p class="point">Rise time 0.00\u00a0s in <code>a</code>, 0.00\u00a0s in <code>b</code>; overshoot',
        "runs completed; <code>run.seed</code> differs.</p>",
        'data-charts="data-runs" data-first="1"',
        '<td class="text quiet">overshoot</td>',
        "<td>run.<wbr>seed</td><td>1</td><td>2</td>",
        '<details class="fold"><summary><h2>Settings that only some runs have: 1</h2></summary>',
        "<td>cell.<wbr>new</td><td>–</td><td>1</td>",
        "<td>outcome</td>",
        '<details class="fold"><summary><h2>Other figures</h2></summary>',
        '<td class="text quiet">mean contact force</td>',
    )
    assert sorted(parts, key=page.index) == [*parts]
    assert "no setting differs" in compare_page({"a": first, "b": first})


def test_compare_of_two_runs_has_differences() -> None:
    first, second, third = (run(force_n, 20, {}) for force_n in (8.0, 9.5, 9.0))
    page = compare_page({"a": first, "b": second})
    values = (("count", "a", "2.00 N"), ("count best", "b", "0.50 N"), ("count", "b − a", "−1.50 N"))
    line = '<td class="text">RMS error</td>' + "".join(
        f'<td class="{style}" data-title="{title}">{text}</td>' for style, title, text in values
    )
    assert "<th>b − a</th>" in page
    bar = '<td class="bars" data-title="farther from 0"><i class="change"><b style='
    bar += '"left:12%;width:38%;background:var(--c1)">'
    assert line + bar in page
    error = re.search(r'">steady mean error</td>(.*?)</tr>', page)
    assert error is not None
    assert "+1.50 N" in error[1]
    assert bar in error[1], "−2.0 N is farther from 0 than −0.5 N"
    assert "<th>b − a</th>" not in compare_page({"a": first, "b": second, "c": third})


def test_difference_is_that_of_displayed_values() -> None:
    assert difference(0.8149, 1.0861, FIGURES["rms_error_n"]) == "+0.28 N"
    assert difference(9.951, 11.249, FIGURES["rms_error_n"]) == "+1.25 N"
    assert difference(12.44, 1.56, FIGURES["overshoot_percent"]) == "−10.8 points"


def test_compare_names_controller_and_warns_of_other_task() -> None:
    first, second = (run(9.0, 20, {"task": {"force_n": force_n}}) for force_n in (9.0, 14.0))
    second = replace(second, metadata={**second.metadata, "controller": "predictive"})
    page = compare_page({"a": first, "b": second})
    caution = "target force 9\u00a0N in <code>a</code>, 14\u00a0N in <code>b</code>"
    assert page.index(f'<p class="bar caution"><b>Different tasks:</b>{caution}.') < page.index(
        "data-charts="
    )
    assert page.count("</i>b: predictive</th>") == 3, "both tables of figures, and the ends"
    assert '"label":"a: pi"' in page
    same = compare_page({"a": first, "b": first})
    assert "No value is marked as best: the tasks differ." in page
    assert "count best" not in page
    assert "bar caution" not in same.rpartition("</style>")[2]
    assert "</i>a</th>" in same


@pytest.mark.parametrize(
    ("changed", "labels", "largest", "view"),
    [
        (12.0, ["a", "target", "b"], 75.0, [-0.5, 3.0]),
        (11.0, ["a", "a, target", "b", "b, target"], 9.0, None),
    ],
)
def test_compare_draws_percent_of_constant_targets(
    changed: float, labels: list[str], largest: float, view: list[float] | None
) -> None:
    first = run(9.0, 20, {})
    cycles = [structs.replace(one, force_reference=12.0) for one in first.cycles]
    cycles[-1] = structs.replace(cycles[-1], force_reference=changed)
    page = compare_page({"a": first, "b": replace(first, cycles=tuple(cycles))})
    (text,) = re.findall(r'id="data-runs">(.*?)</script>', page, re.DOTALL)
    drawn = json.loads(text)
    assert [one["label"] for one in drawn["charts"][0]["series"]] == labels
    assert max(drawn["sources"]["run1"]["force"]) == largest
    targets = [one["force_reference"] for one in drawn["sources"].values() if "force_reference" in one]
    assert [{*one[:20]} for one in targets] == [{None}] * (len(labels) - 2), "no target before the contact"
    assert drawn["axes"]["time"].get("view") == view


def test_compare_describes_faults_in_words() -> None:
    fault = {"after_s": 3.0, "fault": "emergency-stop", "for_s": None, "on": "robot", "phase": "track"}
    late = {"fault": "noise", "on": "sensor", "when": "force > 8", "for_s": 0.5, "parameters": {"sigma": 2}}
    first, second = run(9.0, 20, {"faults": [fault, late]}), run(9.0, 20, {"faults": []})
    text = "emergency-stop at the robot, 3 s into track; noise at the sensor, when force &gt; 8, for 0.5 s, sigma 2"
    assert f"<td>faults</td><td>{text}</td><td>none</td>" in compare_page({"a": first, "b": second})


def test_compare_describes_steps_and_numbers_in_words() -> None:
    inner = [{"do": "approach", "limits": {"force_limit_n": None}}, {"do": "track"}]
    step = [{"do": "move"}, {"do": "repeat", "times": 4, "step": inner}]
    first = run(9.0, 20, {"task": {"step": step}, "frame": {"travel": [0.0, 1.5, -2.0]}})
    second = run(9.0, 20, {"task": {"step": []}, "frame": {"travel": [1.0, 0.0, 0.0]}})
    page = compare_page({"a": first, "b": second})
    assert "<td>task.<wbr>step</td><td>move, repeat 4 times (approach, track)</td><td>none</td>" in page
    assert "<td>frame.<wbr>travel</td><td>0, 1.5, -2</td><td>1, 0, 0</td>" in page


def test_compare_names_are_short_and_unique() -> None:
    assert names_of([Path("x/a.mcap"), Path("x/b.mcap")]) == ["a", "b"]
    assert names_of([Path("x/run.mcap"), Path("y/run.mcap")]) == ["x/run", "y/run"]
    with pytest.raises(ConfigError, match="the same file twice"):
        names_of([Path("a.mcap"), Path("a.mcap")])
    with pytest.raises(ConfigError, match="takes 2 to 8 recordings, not 1"):
        compare_page({"a": run(9.0, 1, {})})


@pytest.mark.parametrize(
    ("figure", "better", "worse"),
    [
        ("rms_error_n", 0.5, 0.6),
        ("steady_mean_error_n", -0.1, 0.2),
        ("sine_gain", 1.1, 0.8),
        ("settle_s", 3.0, math.inf),
    ],
)
def test_figure_costs_more_if_worse(figure: str, better: float, worse: float) -> None:
    costs = [FIGURES[figure].cost(value) for value in (better, worse)]
    assert None not in costs
    assert costs[0] < costs[1]  # type: ignore[operator]
    assert FIGURES["force_mean_steady_n"].cost(1.0) is None

"""Requirements laid against tests: by marks of pytest, by JUnit files of any tool, as text, table and page."""

import csv
import hashlib
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.lab.junit import RECORDING, REQUIREMENT
from hil_bridge.lab.requirements import (
    State,
    Tried,
    as_page,
    matrix_of,
    read_requirements,
    read_tests,
)
from hil_bridge.testing import plugin
from tests.near_surface import NEAR

pytest_plugins = "pytester"
LIST = "id,owner,text\nR-1,A,The tool holds its force\nR-2,B,A lost wire stops the run\nR-3,B,Nothing\nR-4,B,Not run\n"
TESTS = f"""
import pytest
NEAR = {NEAR!r}

@pytest.mark.hil_requirement("R-1", "R-9")
def test_force(hil_simulate):
    result = hil_simulate({{**NEAR, "run": {{"duration_s": 0.3}}}})
    assert result.outcome == "completed"

@pytest.mark.hil_requirement("R-2")
def test_wire(hil_simulate):
    fault = {{"on": "robot", "fault": "emergency-stop", "phase": "track"}}
    result = hil_simulate({{**NEAR, "run": {{"duration_s": 1.0}}, "faults": [fault]}})
    assert result.outcome == "completed", "=the run went on"

@pytest.mark.hil_requirement("R-4")
@pytest.mark.skip(reason="no robot here")
def test_later():
    pass

def test_without_a_requirement():
    pass
"""
PLUGIN = (
    "-p",
    "hil_bridge.testing.plugin",
    "-p",
    "no:xdist",
    "-p",
    "no:asyncio",
    "-q",
    "--junitxml=tests.xml",
)


@pytest.fixture
def results(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a list and of the JUnit file of a test run."""
    (pytester.path / "list.csv").write_text(LIST)
    pytester.makepyfile(test_mine=TESTS)
    result = pytester.runpytest_inprocess(*PLUGIN, "--hil-recordings=kept")
    result.assert_outcomes(passed=2, failed=1, skipped=1)
    monkeypatch.chdir(pytester.path)
    return pytester.path


def test_names_of_the_plugin_are_those_that_are_read() -> None:
    assert (plugin.REQUIREMENT, plugin.RECORDING) == (REQUIREMENT, RECORDING)


def test_marks_of_tests_become_a_matrix(results: Path) -> None:
    tests = {test.name: test for test in read_tests(results / "tests.xml")}
    matrix = matrix_of(read_requirements(results / "list.csv"), tests.values())
    states = {row.requirement.name: row.state for row in matrix.rows}
    assert states == {"R-1": State.PASSED, "R-2": State.FAILED, "R-3": State.NO_TEST, "R-4": State.SKIPPED}
    assert [name for name, _ in matrix.strangers] == ["R-9"]
    assert not matrix.shown
    kept = [Path(path) for test in tests.values() for path in test.recordings]
    assert len(kept) == 2
    assert all(path.parent.name == "kept" and path.is_file() for path in kept)


def test_a_run_tells_its_end_and_its_faults_in_the_junit_file(results: Path) -> None:
    text = (results / "tests.xml").read_text()
    assert 'name="hil_run.0.outcome" value="completed"' in text
    assert 'name="hil_run.0.outcome" value="stopped"' in text
    assert 'name="hil_run.0.cause"' in text
    assert 'name="hil_run.0.fault" value="robot: emergency-stop' in text


def test_the_command_writes_table_and_page(results: Path) -> None:
    arguments = ["requirements", "list.csv", "tests.xml", "--page", "matrix.html", "--csv", "matrix.csv"]
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == 4
    assert done.output.splitlines()[0] == "1 of 4 requirements passed"
    assert "R-2  failed: test_mine.test_wire: AssertionError" in done.output
    assert "R-9  is not in the list; test_mine.test_force names it" in done.output
    rows = list(csv.DictReader((results / "matrix.csv").read_text().splitlines()))
    assert [(row["requirement"], row["state"], row["verdict"]) for row in rows] == [
        ("R-1", "passed", "passed"),
        ("R-2", "failed", "failed"),
        ("R-3", "no test", ""),
        ("R-4", "skipped", "skipped"),
    ]
    page = (results / "matrix.html").read_text()
    assert 'href="kept/test_mine.py.test_wire-0.mcap"' in page
    for name in ("list.csv", "tests.xml"):
        digest = hashlib.sha256((results / name).read_bytes()).hexdigest()
        assert f'<td>SHA-256 of {name}</td><td class="value">{digest}</td>' in page
    assert isinstance(CliRunner().invoke(cli, arguments).exception, ConfigError), (
        "no file is overwritten unasked"
    )


def test_all_shown_ends_with_0(tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text("text,id\nshort,R-1\n")
    (tmp_path / "any.xml").write_text(
        '<testsuite><testcase name="t"><properties><property name="hil_requirement">R-1</property></properties>'
        "</testcase></testsuite>"
    )
    done = CliRunner().invoke(cli, ["requirements", str(tmp_path / "list.csv"), str(tmp_path / "any.xml")])
    assert (done.exit_code, done.output) == (0, "1 of 1 requirements passed\n")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"name,text\nR-1,x\n", "needs the columns id and text"),
        (b"id,text\n,x\n", "line 2: a requirement needs an id"),
        (b"id,text\nR-1,x\nR-1,y\n", "line 3: R-1 is there twice"),
        (b"id,text\n", "has no requirement"),
        (b"", "needs the columns id and text"),
        (b"id,text\n\xff\xfe,x\n", "is no CSV file in UTF-8"),
        (b'id,text\n"R-1,x\n', "is no CSV file in UTF-8"),
    ],
)
def test_a_list_that_is_none_is_answered_in_one_line(tmp_path: Path, content: bytes, told: str) -> None:
    path = tmp_path / "list.csv"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=told):
        read_requirements(path)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"<html></html>", "is no JUnit file: it begins with <html>"),
        (b"no xml", "is no XML"),
        (b"", "is no XML"),
        (b'<!DOCTYPE a [<!ENTITY b "b">]><testsuite/>', "declares a document type"),
        (b'<?xml version="1.0" encoding="none"?><testsuite/>', "is no XML"),
    ],
)
def test_results_that_are_none_are_answered_in_one_line(tmp_path: Path, content: bytes, told: str) -> None:
    path = tmp_path / "tests.xml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=told):
        read_tests(path)


def test_words_of_others_do_nothing_to_a_page_or_a_spreadsheet(tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text('id,text\nR-1,"=1+1<script>"\n')
    test = Tried("<b>", State.FAILED, "<img src=x>", ("R-1",), ('a"b.mcap',))
    matrix = matrix_of(read_requirements(tmp_path / "list.csv"), [test])
    page = as_page("mine", matrix, tmp_path / "page.html", [("<b>", "<img>")]).decode()
    for words in ("<script>", "<b>", "<img", 'a"b'):
        assert words not in page.partition("<h1>")[2]

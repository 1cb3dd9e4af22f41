"""A run as a notebook shows it, and the interface inside an event loop that runs already."""

import asyncio
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from hil_bridge import api

SHORT: dict[str, Any] = {"run": {"duration_s": 0.5}}


@pytest.fixture(scope="module")
def result() -> api.Result:
    return api.simulate(SHORT)


def parsed(html: str) -> ElementTree.Element:
    """HTML that is well-formed, as all of ours is: a browser guesses nothing."""
    return ElementTree.fromstring(f"<div>{html.replace('<br>', '<br/>')}</div>")


def test_reprs_are_one_short_line(result: api.Result) -> None:
    for thing in (result, result.recording, result.arrays.truths, api.load(SHORT)):
        assert "\n" not in repr(thing)
        assert len(repr(thing)) < 300
    assert repr(result).startswith("<Result: completed")
    assert repr(result.recording).startswith("<Recording: completed; ")
    assert repr(api.load(SHORT)) == "Config(run=RunConfig(duration_s=0.5))"
    assert repr(api.load()) == "Config()"


def test_html_of_a_run_has_its_end_its_force_and_its_figures(result: api.Result) -> None:
    page = parsed(result._repr_html_())
    words = " ".join(page.itertext())
    assert "predictive: completed" in words
    assert "left: retracted" in words
    assert page.find(".//{http://www.w3.org/2000/svg}svg") is not None
    labels = [row[0].text for row in page.iter("tr")]
    assert "largest force" in labels
    assert "<script" not in result._repr_html_()


def test_html_of_a_run_without_a_cycle_says_so() -> None:
    stopped = api.Recording(())
    assert "before its first control cycle" in stopped._repr_html_()
    with pytest.raises(api.ConfigError, match="it has no charts"):
        stopped.plot()


def test_html_of_arrays_and_settings(result: api.Result) -> None:
    table = parsed(result.arrays._repr_html_())
    assert f"{len(result.cycles)} records" in " ".join(table.itertext())
    assert len(list(table.iter("tr"))) == 9
    settings = parsed(api.load(SHORT)._repr_html_())
    assert [[cell.text for cell in row] for row in settings.iter("tr")][1] == [
        "run.duration_s",
        "0.5",
        "30.0",
    ]
    assert "every setting has its default" in api.load()._repr_html_()


def test_plots_and_report_are_those_of_the_pages(result: api.Result, tmp_path: Path) -> None:
    assert len(result.plot("force").axes) == 1
    assert len(result.plot().axes) > 3
    with pytest.raises(api.ConfigError, match="no chart 'forces' of this run; there are force"):
        result.plot("forces")
    page = result.report(tmp_path / "report")
    assert page.name == "report.html"
    with pytest.raises(api.ConfigError, match="is there already"):
        result.report(tmp_path / "report")


def test_frames_of_pandas_and_polars_have_a_column_each(result: api.Result) -> None:
    pandas, polars = result.arrays.to_pandas(), result.arrays.to_polars()
    assert list(pandas.columns) == list(polars.columns)
    assert len(pandas) == len(polars) == len(result.cycles)
    assert pandas["force"].tolist() == result.arrays.force.tolist()
    assert polars["position_z"].to_list() == result.arrays.position[:, 2].tolist()
    assert pandas["explanation_feedback_m"].notna().any()
    for other in (result.arrays.truths, result.arrays.sensors, result.arrays.events, result.arrays.steps):
        assert len(other.to_pandas()) == other.count
        assert len(other.to_polars()) == other.count


def test_a_frame_of_a_library_that_is_missing_is_refused_in_words(
    result: api.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "polars", None)
    with pytest.raises(api.ConfigError, match="polars is not installed here: pip install polars"):
        result.arrays.to_polars()


def test_all_of_it_works_or_explains_itself_inside_a_loop(result: api.Result) -> None:
    async def cell() -> float:
        async with api.open_devices(SHORT) as devices:
            await devices.sensor.ready()
            return devices.clock.now()

    async def notebook() -> None:
        assert api.simulate(SHORT).arrays.force.tolist() == result.arrays.force.tolist()
        assert (await api.simulate_async(SHORT)).arrays.force.tolist() == result.arrays.force.tolist()
        assert api.run_virtual(cell) > 7000.0
        with pytest.raises(api.ConfigError, match="await the coroutine itself"):
            api.run_real(cell())

    asyncio.run(notebook())

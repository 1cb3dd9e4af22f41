"""Display of a run in a notebook, and the interface inside a running event loop."""

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


def parse_html(html: str) -> ElementTree.Element:
    """Parse HTML, which must be well-formed."""
    return ElementTree.fromstring(f"<div>{html.replace('<br>', '<br/>')}</div>")


def test_notebook_reprs_are_one_short_line(result: api.Result) -> None:
    for value in (result, result.recording, result.arrays.truths, api.load(SHORT)):
        assert "\n" not in repr(value)
        assert len(repr(value)) < 300
    assert repr(result).startswith("<Result: completed")
    assert repr(result.recording).startswith("<Recording: completed; ")
    assert repr(api.load(SHORT)) == "Config(run=RunConfig(duration_s=0.5))"
    assert repr(api.load()) == "Config()"


def test_notebook_html_of_run_has_end_force_and_figures(result: api.Result) -> None:
    page = parse_html(result._repr_html_())
    text = " ".join(page.itertext())
    assert "predictive: completed" in text
    assert "left: retracted" in text
    assert page.find(".//{http://www.w3.org/2000/svg}svg") is not None
    labels = [row[0].text for row in page.iter("tr")]
    assert "largest force" in labels
    assert "<script" not in result._repr_html_()


def test_notebook_html_of_run_without_cycle() -> None:
    stopped = api.Recording(())
    assert "before its first control cycle" in stopped._repr_html_()
    with pytest.raises(api.ConfigError, match="it has no charts"):
        stopped.plot()


def test_notebook_html_of_arrays_and_settings(result: api.Result) -> None:
    table = parse_html(result.arrays._repr_html_())
    assert f"{len(result.cycles)} records" in " ".join(table.itertext())
    assert len(list(table.iter("tr"))) == 9
    settings = parse_html(api.load(SHORT)._repr_html_())
    assert [[cell.text for cell in row] for row in settings.iter("tr")][1] == [
        "run.duration_s",
        "0.5",
        "30.0",
    ]
    assert "every setting has its default" in api.load()._repr_html_()


def test_notebook_plots_and_report_match_pages(result: api.Result, tmp_path: Path) -> None:
    assert len(result.plot("force").axes) == 1
    assert len(result.plot().axes) > 3
    with pytest.raises(api.ConfigError, match="unknown chart 'forces'; this run has force"):
        result.plot("forces")
    page = result.report(tmp_path / "report")
    assert page.name == "report.html"
    with pytest.raises(api.ConfigError, match="already exists"):
        result.report(tmp_path / "report")


def test_notebook_data_frames_have_column_per_field(result: api.Result) -> None:
    pandas, polars = result.arrays.to_pandas(), result.arrays.to_polars()
    assert list(pandas.columns) == list(polars.columns)
    assert len(pandas) == len(polars) == len(result.cycles)
    assert pandas["force"].tolist() == result.arrays.force.tolist()
    assert polars["position_z"].to_list() == result.arrays.position[:, 2].tolist()
    assert pandas["explanation_feedback_m"].notna().any()
    for other in (result.arrays.truths, result.arrays.sensors, result.arrays.events, result.arrays.steps):
        assert len(other.to_pandas()) == other.count
        assert len(other.to_polars()) == other.count


def test_notebook_missing_library_is_refused_with_remedy(
    result: api.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "polars", None)
    with pytest.raises(api.ConfigError, match="polars is not installed; run: pip install polars"):
        result.arrays.to_polars()


def test_notebook_functions_work_inside_running_loop(result: api.Result) -> None:
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

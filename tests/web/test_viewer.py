"""`hil-bridge view` in a real browser: a recording with its slider, and the results of a running campaign."""

import asyncio
import sys
from pathlib import Path

import pytest

from hil_bridge.lab.campaign.page import page as render_page
from hil_bridge.lab.campaign.store import Store
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.record.foreign import BagChoices
from hil_bridge.record.ros.bag_reader import read_bag
from hil_bridge.show.pages import Axis, Chart, Charts, Series, document, in_script, room
from hil_bridge.show.report import write_report
from tests.bags import WRENCH, press, pressed, wrench
from tests.near_surface import EMERGENCY_STOP, WHOLE
from tests.recordings import Recordings
from tools.chromium import Page
from tools.web_run import Serving

FAILED = 4
"""Exit code of a campaign in which a run did not meet its criteria."""
STUDY = """
[campaign]
name = "study"
seeds = { from = 1, to = 6 }
[campaign.matrix]
task.force_n = [8.0, 10.0]
[campaign.criteria]
outcome = "completed"
force_true_max_n = { below = 1 }
[config.run]
duration_s = 0.3
[config.sensor]
emulated = "ft300"
[config.task]
retract_mm = 2.0
[config.cell]
start_position_mm = [900.0, -100.0, 591.0]
"""


def text(name: str) -> str:
    return f"document.getElementById('{name}')?.textContent"


async def campaign(folder: Path, *options: str) -> int:
    """Run the study; return its exit code."""
    command = [sys.executable, "-m", "hil_bridge", "campaign", "study.toml", "--output", "study.sqlite"]
    quiet = asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(*command, *options, cwd=folder, stdout=quiet, stderr=quiet)
    return await process.wait()


def slide(at_s: float) -> str:
    return f"""(() => {{ const at = document.getElementById('at'); at.value = {at_s};
      at.dispatchEvent(new Event('input')); }})()"""


@pytest.mark.full
async def test_browser_plays_back_a_recording(
    page: Page, serving: list[Serving], recordings: Recordings, tmp_path: Path
) -> None:
    """The page starts at the end, with the cause; the slider shows each moment, and playback continues from there."""
    recording = recordings.path(WHOLE, faults=[EMERGENCY_STOP])
    viewer = Serving(tmp_path, "view", str(recording))
    serving.append(viewer)
    await page.open(viewer.url)
    await page.until("document.getElementById('slider')?.hidden === false")
    await page.until(f"{text('phase')} === 'stopped'")
    assert "EMULATED" in await page.value(text("cell"))
    assert await page.value("document.getElementById('end').hidden")
    outcome = (await page.value(text("outcome"))).replace("\u00a0", " ")
    assert outcome.strip().startswith("At the end: Injected fault: robot emergency stop.")
    assert "The robot cannot move: emergency stop, in standby." in outcome
    stopped = await page.value(text("elapsed"))
    assert stopped.startswith("at ")
    assert f"Stopped after {stopped.removeprefix('at ')}" in outcome
    await page.until("document.body.classList.contains('ended')")
    length_s = float(await page.value("document.getElementById('at').max"))
    await page.value(slide(length_s / 2))
    await page.until(f"['approach', 'track'].includes({text('phase')})")
    assert not await page.value("document.body.classList.contains('ended')")
    assert await page.value("document.getElementById('cause').hidden")
    before = await page.value(text("elapsed"))
    await page.value("document.getElementById('play').click()")
    await page.until(f"{text('elapsed')} !== '{before}'")
    await page.until(f"Number(document.getElementById('at').value) > {length_s / 2 + 0.5}")
    await page.value("document.getElementById('play').click()")
    position = float(await page.value("document.getElementById('at').value"))
    assert await page.value(text("play")) == "▶"
    await asyncio.sleep(0.3)
    assert float(await page.value("document.getElementById('at').value")) == pytest.approx(position, abs=1e-6)
    await page.value(slide(length_s))
    await page.until(f"{text('phase')} === 'stopped' && document.querySelector('#list .alarm')")
    assert page.errors == []


async def test_report_band_is_one_legend_entry(page: Page, recordings: Recordings, tmp_path: Path) -> None:
    """Its entry shows both edges, and toggles both. Times have their unit at every chart, and minus signs are
    typographic.
    """
    recording = recordings(WHOLE)
    report = write_report(recording, summarise(recording), tmp_path)
    await page.open(report.as_uri())
    await page.until("document.querySelectorAll('.uplot canvas').length > 0")
    legend = """[...document.querySelector('[data-chart=force]').querySelectorAll('.u-series')]
      .filter(one => one.offsetParent).map(one => one.querySelector('.u-label').textContent)"""
    assert await page.value(legend) == ["true force", "measured force", "target", "full stream"]
    output = "document.querySelector('[data-chart=force] .u-series:last-child').classList.contains('u-off')"
    edge = "document.querySelectorAll('[data-chart=force] .u-series')[{}].classList.contains('u-off')"
    count = await page.value("document.querySelectorAll('[data-chart=force] .u-series').length")
    await page.value("document.querySelector('[data-chart=force] .u-series:last-child th').click()")
    assert await page.value(output)
    assert await page.value(edge.format(count - 2))
    assert page.errors == []


@pytest.mark.full
async def test_browser_displays_external_bag(page: Page, serving: list[Serving], tmp_path: Path) -> None:
    """Charts, figures and choices are those of its saved report, without a slider or a cell."""
    raw = [wrench(at, (0.0, 0.0, -50.0, 0.0, 0.0, 0.0)) for at, _ in press()[0]]
    bag = pressed(tmp_path / "press", more={"/ft/raw": (WRENCH, raw)})
    choices = BagChoices(topics={"wrench": "/ft/wrench"}, contact_n=2.0)
    viewer = Serving(tmp_path, "view", "press", "--topic", "wrench=/ft/wrench", "--contact", "2")
    serving.append(viewer)
    await page.open(viewer.url)
    charts = "document.querySelectorAll('.uplot canvas').length"
    await page.until(f"{charts} > 3")
    output = await page.value("document.getElementById('body').innerText")
    count = await page.value(charts)
    assert await page.value("document.title") == "bag: press"
    assert await page.value(text("link")) == ""
    assert not await page.value("!!document.getElementById('slider')")
    errors = list(page.errors)
    recording = read_bag(bag, choices)
    report = write_report(recording, summarise(recording), tmp_path / "report")
    await page.open(report.as_uri())
    await page.until(f"{charts} === {count}")
    assert output.split() == (await page.value("document.body.innerText")).split()
    assert "force above 2 N" in output
    assert "EMULATED" not in output
    assert errors == []


async def test_categorical_axis_shows_only_its_names(page: Page, tmp_path: Path) -> None:
    """Positions between two names have no label, and the value under the cursor is the name."""
    axis = Axis("results", "", names=["before", "between", "after"])
    chart = Chart("passed", "Runs that passed", "%", [Series("all", "share", "all cells")], axis="place")
    charts = Charts({"place": axis}, [chart], {"all": {"x": [0.0, 1.0, 2.0], "share": [80.0, 90.0, 100.0]}})
    (tmp_path / "names.html").write_text(document("names", room("names", charts)))
    await page.open((tmp_path / "names.html").as_uri())
    await page.until("document.querySelectorAll('.uplot canvas').length === 1")
    data = in_script(charts)
    code = f"""(() => {{ const made = HilCharts.draw(document.body.appendChild(document.createElement('div')), {data});
      return [0, 1, 1.5, 2].map(x => made.at('place', x)); }})()"""
    assert await page.value(code) == ["before", "between", "", "after"]
    assert page.errors == []


@pytest.mark.full
async def test_browser_displays_running_campaign(page: Page, serving: list[Serving], tmp_path: Path) -> None:
    """The page counts runs that another process adds while it is open. Its body equals that of the saved page."""
    (tmp_path / "study.toml").write_text(STUDY)
    assert await campaign(tmp_path, "--seeds", "1:2") == FAILED
    viewer = Serving(tmp_path, "view", "study.sqlite")
    serving.append(viewer)
    await page.open(viewer.url)
    body = "(document.getElementById('body')?.textContent ?? '')"
    await page.until(f"{body}.includes('4 of 4 runs done')")
    more = asyncio.create_task(campaign(tmp_path))
    await page.until(f"{body}.includes('12 of 12 runs done')")
    assert await more == FAILED
    await page.until(f"{body}.includes('2 starts')")  # it has ended, and its time is displayed
    paths = "document.getElementById('body').innerHTML.split('The run ').length"
    await page.until(f"{paths} === 13")  # the paragraph of each failing run, from its recording
    output = await page.value("document.getElementById('body').innerText")
    errors = list(page.errors)
    with Store.open(tmp_path / "study.sqlite") as store:
        (tmp_path / "study.html").write_text(render_page(store))
    await page.open((tmp_path / "study.html").as_uri())
    await page.until("document.readyState === 'complete' && document.querySelector('.badge')")
    saved = await page.value("document.body.innerText")
    assert [line for line in output.split() if "study-failed" not in line] == [
        line for line in saved.split() if "study-failed" not in line
    ]
    assert "12 of 12 failed" in output
    assert errors == []

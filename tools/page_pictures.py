"""Take the pictures of pages and charts in docs/pictures. It takes about two minutes.

    python -m tools.page_pictures [FOLDER]

The page shows a run in real time with an emergency stop. The reports, and the maps and charts of a program, show runs
in virtual time. The pictures are taken with the system's Chromium.
"""

import argparse
import asyncio
import signal
import sys
import tempfile
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

import hil_bridge
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.show.charts.map_painter import paint_map
from hil_bridge.show.charts.maps import path_map, removed_map
from hil_bridge.show.charts.painter import STYLE, paint
from hil_bridge.show.charts.run import run_charts
from hil_bridge.show.picture_files import save_figure
from hil_bridge.show.report import write_report
from tools.chromium import Page, browser
from tools.web_run import WebRun

PLACE = Path(__file__).resolve().parent.parent / "docs" / "pictures"
SCREEN, ENDED, PAPER, PHONE = (1440, 1000), (1440, 1250), (1240, 1100), (390, 1700)
"""Width and height, px."""
STOPPED = """
[cell]
start_position_mm = [900.0, -100.0, 591.0]
[task]
retract_mm = 1.0
[[faults]]
on = "robot"
fault = "emergency-stop"
phase = "track"
after_s = 18.0
"""
"""Settings of the run on the page: a short approach, and a stop after which the robot refuses to retract."""
TRACKED = "hilPage.charts.sources.cycle.x.at(-1) - hilPage.charts.sources.cycle.x[0] > 14"
LOST = [{"on": "sensor-wire", "fault": "off", "phase": "track", "after_s": 2.0}]
"""Fault that docs/how-to/why-a-run-stopped.md explains."""
REPORTS = {
    "report": (PAPER, {"run": {"duration_s": 20.0}}, []),
    "report-phone": (PHONE, {"run": {"duration_s": 10.0}}, LOST),
}
"""Size, settings and faults of each report."""
DOME = PLACE.parents[1] / "examples" / "tasks" / "polish-dome.toml"
MAPS = {
    "dome-path": (path_map, "normal", (640, 260)),
    "dome-removed": (removed_map, "orientation", (560, 220)),
}
"""Map and chart of the program on the dome, each with its height, px."""
_DRAWN_S = 0.5
"""Time for the charts to be drawn, s. Chosen."""


async def take_run(page: Page, folder: Path, place: Path) -> None:
    """Take pictures of three pages: a run that continues, a run that has stopped, and a page on a telephone."""
    run = WebRun(folder, ("--duration", "40"), STOPPED)
    try:
        await page.open(run.origin, *SCREEN)
        await page.until(f"window.hilPage && hilPage.charts.sources.cycle?.x.length && {TRACKED}")
        await page.screenshot(place / "web-live.png")
        await page.until("!document.getElementById('outcome').hidden")
        await page.size(*ENDED)
        await asyncio.sleep(_DRAWN_S)
        await page.screenshot(place / "web-fault.png")
        await page.size(*PHONE, phone=True)
        await page.scheme("dark")
        await asyncio.sleep(_DRAWN_S)
        await page.screenshot(place / "web-phone.png")
        await page.scheme("light")
    finally:
        if run.process.poll() is None:
            run.process.send_signal(signal.SIGINT)
        run.ended()


async def take_reports(page: Page, folder: Path, place: Path) -> None:
    """Take pictures of the reports."""
    for name, (size, settings, faults) in REPORTS.items():
        result = hil_bridge.simulate(hil_bridge.load(settings, faults=faults, seed=7))
        written = write_report(result.recording, summarise(result.recording), folder / name)
        await page.open(written.as_uri(), *size, phone=size is PHONE)
        await page.until("document.querySelectorAll('.uplot canvas').length > 0")
        await asyncio.sleep(_DRAWN_S)
        await page.screenshot(place / f"{name}.png")


def draw_maps(place: Path) -> None:
    """Draw the maps of a program, each above its chart."""
    recording = hil_bridge.simulate(DOME).recording
    charts = run_charts(recording)
    with matplotlib.rc_context(STYLE):
        for name, (describe, chart_id, heights) in MAPS.items():
            figure = Figure(figsize=(10.0, sum(heights) / 100.0), dpi=100)
            figure.set_layout_engine("constrained")
            above, below = figure.subplots(2, 1, height_ratios=heights)
            described = describe(recording)
            assert described is not None
            paint_map(above, described, 1000.0)
            paint(below, next(chart for chart in charts.charts if chart.id == chart_id), charts)
            below.set_xlabel("time since the run began, s")
            (place / f"{name}.png").write_bytes(save_figure(figure, "png"))


async def take_all(place: Path) -> None:
    """Take all pictures."""
    with tempfile.TemporaryDirectory() as folder:
        async with browser() as page:
            await take_run(page, Path(folder), place)
            await take_reports(page, Path(folder), place)


def main() -> int:
    """Take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=PLACE)
    place = parser.parse_args().folder
    draw_maps(place)
    asyncio.run(take_all(place))
    return 0


if __name__ == "__main__":
    sys.exit(main())

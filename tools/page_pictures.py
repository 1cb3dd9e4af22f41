"""Take the pictures of pages in docs/pictures: the page of a run, and reports. It takes about a minute.

    python -m tools.page_pictures [FOLDER]

The page is that of a run in real time with an emergency stop; the reports are of runs in virtual time. Chromium is the
system's own.
"""

import argparse
import asyncio
import signal
import sys
import tempfile
from pathlib import Path

import hil_bridge
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.show.report import write_report
from tools.chromium import Page, browser
from tools.web_run import WebRun

PLACE = Path(__file__).resolve().parent.parent / "docs" / "pictures"
SCREEN, PHONE = (1440, 1000), (390, 1500)
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
"""The run of the page: a short way to the surface, and a stop that the robot refuses to retract from."""
TRACKED = "hilPage.charts.sources.cycle.x.at(-1) - hilPage.charts.sources.cycle.x[0] > 14"
LOST = [{"on": "sensor-wire", "fault": "off", "phase": "track", "after_s": 2.0}]
"""The fault of docs/how-to/why-a-run-stopped.md."""
REPORTS = {
    "report": (SCREEN, {"run": {"duration_s": 30.0}}, []),
    "report-phone": (PHONE, {"run": {"duration_s": 10.0}}, LOST),
}
"""Size, settings and faults of each report."""
_DRAWN_S = 0.5
"""Time for the charts to be drawn, s. Chosen."""


async def take_run(page: Page, folder: Path, place: Path) -> None:
    """The page of a run that goes on, that has stopped, and that on a telephone."""
    run = WebRun(folder, ("--duration", "40"), STOPPED)
    try:
        await page.open(run.origin, *SCREEN)
        await page.until(f"window.hilPage && hilPage.charts.sources.cycle?.x.length && {TRACKED}")
        await page.screenshot(place / "web-live.png")
        await page.until("!document.getElementById('outcome').hidden")
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
    """The reports."""
    for name, (size, settings, faults) in REPORTS.items():
        result = hil_bridge.simulate(hil_bridge.load(settings, faults=faults, seed=7))
        written = write_report(result.recording, summarise(result.recording), folder / name)
        await page.open(written.as_uri(), *size, phone=size is PHONE)
        await page.until("document.querySelectorAll('.uplot canvas').length > 3")
        await asyncio.sleep(_DRAWN_S)
        await page.screenshot(place / f"{name}.png")


async def take_all(place: Path) -> None:
    """All pictures."""
    with tempfile.TemporaryDirectory() as folder:
        async with browser() as page:
            await take_run(page, Path(folder), place)
            await take_reports(page, Path(folder), place)


def main() -> int:
    """Take them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=PLACE)
    asyncio.run(take_all(parser.parse_args().folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())

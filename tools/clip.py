"""Make the clip of README and of the site's first page, docs/pictures/stop.webp. It takes about a minute.

    python -m tools.clip [FILE]

A run in virtual time follows a surface until the emergency stop on the panel of its emulated robot is pressed. The
frames are pictures of the page that `hil-bridge view --save` writes, at the times of the recording, taken with the
system's Chromium.
"""

import argparse
import asyncio
import io
import json
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from PIL import Image

import hil_bridge
from emulators.cell import TrueState
from hil_bridge.record import Recording, TruthRecord
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.show.charts.facts import start_time
from hil_bridge.show.report import cell_page
from protocol.faults import FaultStage
from tools.chromium import Page, browser

PLACE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "stop.webp"
SIZE = (830, 556)
"""Width and height of the clip, px. The width is that of a README on GitHub."""
FRAMES_PER_S = 12
BEFORE_S, AFTER_S = 4.0, 4.5
"""Time before the stop, and time for which the last frame stays, s."""
QUALITY = 80
SETTINGS = {
    "robot": {"emulated": "egm"},
    "task": {"speed_mm_s": 15.0, "retract_mm": 25.0, "retract_speed_mm_s": 20.0},
    "cell": {
        "start_position_mm": (900.0, -100.0, 603.0),
        "surface": {"kind": "sinusoidal", "amplitude_mm": 3.0, "period_mm": 60.0},
    },
}
TRACKED_S, PRESSED_S = 6.0, 1.2
"""Time on the surface before the stop, and time until the stop is released, s. An arm in emergency stop cannot
retract.
"""
FOLLOWS = "An emulated robot follows a surface with 10 N."
PRESSED = "The emergency stop on the robot's panel is pressed."
RELEASED = "It is released, and the tool retracts."
SCRIPT, STYLE = (Path(__file__).with_suffix(kind) for kind in (".js", ".css"))
"""What the tool adds to the page: caption, panel, and the functions `setUp` and `show`."""


class Frame(NamedTuple):
    """Moment of the clip."""

    at: float
    """Time in the recording, s."""
    caption: str
    """Text above the picture; empty for the sentence with which the page begins."""
    pressed: bool
    alarm: bool


def frames_of(recording: Recording) -> Iterator[Frame]:
    """Return the frames of the clip, from the recorded events of the stop."""
    zero = start_time(recording)
    faults = {event.fault.stage: event.at - zero for event in recording.events if event.fault is not None}
    begins, ends = faults[FaultStage.BEGINS], faults[FaultStage.ENDS]
    last = max(truth.at for truth in recording.truths) - zero
    for k in range(int((last - begins + BEFORE_S) * FRAMES_PER_S)):
        at = begins - BEFORE_S + k / FRAMES_PER_S
        caption = FOLLOWS if at < begins else PRESSED if at < ends else RELEASED
        yield Frame(at, caption, begins <= at < ends, begins <= at < ends)
    yield Frame(last, "", False, True)


async def take_frames(page: Page, recording: Recording, folder: Path) -> list[Image.Image]:
    """Take a picture of each frame."""
    file = folder / "cell.html"
    file.write_text(cell_page(recording, summarise(recording)))
    await page.open(file.as_uri(), *SIZE)
    await page.until("window.hilCell && hilCell.frames > 0")
    frames = list(frames_of(recording))
    await page.value(SCRIPT.read_text())
    await page.value(f"clip.setUp({json.dumps(STYLE.read_text())}, {frames[0].at}, {frames[-1].at})")
    pictures = []
    for frame in frames:
        await page.value(f"clip.show({', '.join(map(json.dumps, frame))})")
        await page.screenshot(folder / "frame.png")
        pictures.append(Image.open(io.BytesIO((folder / "frame.png").read_bytes())).convert("RGB"))
    return pictures


async def record_stop() -> Recording:
    """Run, press the emergency stop on the panel, and return the recording.

    It contains the ground truth of the retraction too, which has no control cycles: the robot refuses their orders.
    """
    states: list[tuple[float, TrueState]] = []
    async with hil_bridge.simulation(SETTINGS, seed=7) as run:
        await run.reached("track")
        await run.clock.sleep_until(run.clock.now() + TRACKED_S)
        run.panel.inject("robot", "emergency-stop", for_s=PRESSED_S)
        ended = run.start()
        while not ended.done():
            await run.clock.sleep_until(run.clock.now() + 0.5 / FRAMES_PER_S)
            states.append((run.clock.now(), run.truth()))
    recording = run.result.recording
    last = recording.truths[-1]
    later = [_truth_of(last.cycle, at, state) for at, state in states if at > last.at]
    return replace(recording, truths=(*recording.truths, *later))


def _truth_of(cycle: int, at: float, state: TrueState) -> TruthRecord:
    joints = tuple(map(math.degrees, state.joints or ()))
    return TruthRecord(
        cycle,
        at,
        math.nan,
        math.nan,
        state.position,
        state.contact_force,
        joints,
        quaternion=state.quaternion,
    )


async def make_clip(file: Path) -> None:
    """Run, take the frames and write the clip."""
    recording = hil_bridge.run_virtual(record_stop)
    with tempfile.TemporaryDirectory() as folder:
        async with browser() as page:
            first, *others = await take_frames(page, recording, Path(folder))
    lasts = [round(1000 / FRAMES_PER_S)] * len(others) + [round(1000 * AFTER_S)]
    first.save(file, save_all=True, append_images=others, duration=lasts, loop=0, quality=QUALITY, method=6)


def main() -> int:
    """Make the clip."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?", type=Path, default=PLACE)
    asyncio.run(make_clip(parser.parse_args().file))
    return 0


if __name__ == "__main__":
    sys.exit(main())

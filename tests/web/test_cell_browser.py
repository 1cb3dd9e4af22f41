"""The cell in three dimensions in a real browser: what it shows is what the recording says."""

import asyncio
import math
from importlib.resources import files
from pathlib import Path

import pytest

from hil_bridge.record.analysis.summary import summarise
from hil_bridge.show.charts.cell import cell_picture
from hil_bridge.show.charts.facts import start_time
from hil_bridge.show.pages import cell_room, document
from hil_bridge.show.report import cell_page
from tests.near_surface import CLOSE, merged
from tests.recordings import Recordings
from tools.chromium import Page

RUN = merged(CLOSE, {"run": {"duration_s": 3.0}})
"""Settings of a run that reaches a steady force."""
DRAWN = "window.hilCell && hilCell.frames > 0"
TIP = "(hilCell.show({}), hilCell.draw(performance.now()), hilCell.tip)"
SHOWN = 0.02
"""Largest distance between displayed and recorded tool, as a share of the distance from the base."""

DRAG = """(() => {
  const {canvas} = hilCell, {left, top, width} = canvas.getBoundingClientRect();
  canvas.setPointerCapture = () => {};
  const at = x => ({pointerId: 1, clientX: left + x, clientY: top + 99});
  const send = (name, x) => canvas.dispatchEvent(new PointerEvent(name, at(x)));
  send("pointerdown", width - 100); send("pointermove", width - 50); send("pointerup", width - 50);
})()"""
"""Drag by 50 px in the right view."""
PLAIN = """(() => {
  const place = document.body.appendChild(document.createElement("div"));
  const {model, rows, start, at} = hilData("data-cell");
  const cell = HilCell.draw(place, model, {plain: true}), colours = new Set();
  cell.rows(rows, start); cell.show(at); cell.draw(performance.now());
  const {data} = cell.space.ctx.getImageData(0, 0, cell.canvas.width, cell.canvas.height);
  for (let k = 0; k < data.length; k += 40) colours.add(data.slice(k, k + 3).join());
  return [cell.space.kind, colours.size];
})()"""

_LIVE = files("hil_bridge.show.web").joinpath("static", "page.js").read_text()
KEEP = int(_LIVE.partition("KEEP_ROWS = ")[2].partition(",")[0])
"""Number of rows that the live page keeps."""
HOUR = """(() => {
  const place = document.body.appendChild(document.createElement("div"));
  const {model, rows, start} = hilData("data-cell"), sizes = [], last = {};
  const cell = HilCell.draw(place, model, {bar: false, keep: KEEP});
  for (const [name, value] of Object.entries(rows.cycle)) last[name] = Array.isArray(value) ? value.at(-1) : value;
  for (let minute = 0; minute < 60; minute++) {
    const x = Array.from({length: 1500}, (_, n) => 60 * minute + 0.04 * n);
    const position_x = x.map(t => 50 * Math.sin(Math.PI * (t % 60) / 30));
    cell.rows({cycle: {...last, x, position_x, in_contact: 1, force: 10, force_reference: 10}}, start);
    if (minute % 20 < 19) continue;
    cell.path = null;
    cell.draw(performance.now());
    sizes.push([cell.tables.cycle.x.length, cell.path.mesh.count]);
  }
  cell.destroy();
  return sizes;
})()"""
"""Rows of an hour, 25 a second, in the live picture: how many it keeps, and how much a frame draws."""


@pytest.fixture
def saved(recordings: Recordings, tmp_path: Path) -> Path:
    recording = recordings(RUN)
    path = tmp_path / "cell.html"
    path.write_text(cell_page(recording, summarise(recording)))
    return path


async def test_scene_shows_tool_where_record_says(page: Page, saved: Path, recordings: Recordings) -> None:
    """The tip of the arm, from its joints, and the pixels of the tool above it."""
    recording = recordings(RUN)
    zero = start_time(recording)
    await page.open(saved.as_uri())
    await page.until(DRAWN)
    for truth in recording.truths[:: len(recording.truths) // 5]:
        tip = await page.value(TIP.format(truth.at - zero))
        assert math.dist(tip, truth.position) < SHOWN * math.hypot(*truth.position)
        assert math.dist(tip, truth.position) < 1e-3, "1 mm: rows are as dense as the cycles"
    # a point inside the tool, 60 mm above its tip, in the view of the tool: the pixel has the tool's colour
    pixel = """(() => { const c = hilCell; c.show(hilData("data-cell").at); c.draw(performance.now());
      const view = c.views.find(one => one.name === "tool");
      const p = HilSpace.point(c.tool, [0, 0, -0.06]), at = HilSpace.projected(view.eye, p, view.box);
      const {gl} = c.space, rgba = new Uint8Array(4);
      gl.readPixels(at.x, c.canvas.height - at.y, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
      return [...rgba].slice(0, 3); })()"""
    if await page.value("hilCell.space.kind") == "webgl":
        red, green, blue = await page.value(pixel)
        assert max(red, green, blue) < 150, "a tool is darker than table, work piece and background"
        assert red <= green <= blue
    assert page.errors == []


async def test_scene_plays_resizes_and_turns(page: Page, saved: Path) -> None:
    await page.open(saved.as_uri())
    await page.until(DRAWN)
    begin = await page.value("(hilCell.at = Number(hilCell.slider.min), hilCell.play(), hilCell.frames)")
    await page.until(f"hilCell.at > Number(hilCell.slider.min) + 0.3 && hilCell.frames > {begin} + 3")
    await page.value("(hilCell.pause(), hilCell.draw(performance.now()))")
    assert await page.value("document.querySelector('.hil-play').textContent") == "▶"
    assert float(await page.value("hilCell.slider.value")) == pytest.approx(
        await page.value("hilCell.at"), abs=1e-6
    )
    assert await page.value("hilCell.views.map(one => one.name).join()") == "cell,tool"
    yaw = await page.value("hilCell.cameras.tool.yaw")
    await page.value(DRAG)
    assert await page.value("hilCell.cameras.tool.yaw") == pytest.approx(yaw - 0.4)
    await page.size(390, 800, phone=True)
    await page.until("hilCell.views.map(one => one.name).join() === 'tool,cell' && !hilCell.inset.hidden")
    await page.value("hilCell.inset.click()")
    await page.until("hilCell.views[0].name === 'cell'")
    await page.scheme("dark")
    await asyncio.sleep(0.2)
    assert page.errors == []


async def test_scene_without_webgl_is_a_picture(page: Page, saved: Path) -> None:
    await page.open(saved.as_uri())
    await page.until(DRAWN)
    kind, count = await page.value(PLAIN)
    assert kind == "plain"
    assert count > 40, "a background alone has one colour"
    assert page.errors == []


async def test_live_scene_of_an_hour_is_bounded(page: Page, saved: Path) -> None:
    """A frame after an hour draws as much as one after twenty minutes."""
    await page.open(saved.as_uri())
    await page.until(DRAWN)
    first, *later = await page.value(HOUR.replace("KEEP", str(KEEP)))
    assert first[0] == KEEP < 20 * 1500
    assert first[1] > 0
    assert later == [first, first]


async def test_folded_scene_is_drawn_when_link_opens_it(
    page: Page, recordings: Recordings, tmp_path: Path
) -> None:
    room = cell_room(cell_picture(recordings(RUN)))
    body = f'<a href="#here">open</a><details><summary>cell</summary><div id="here">{room}</div></details>'
    path = tmp_path / "folded.html"
    path.write_text(document("folded", body, charts=False, cell=True))
    await page.open(path.as_uri())
    await page.until("document.readyState === 'complete'")
    assert await page.value("document.querySelectorAll('canvas').length") == 0
    await page.value("document.querySelector('a').click()")
    await page.until(DRAWN)
    assert await page.value("hilCell.canvas.width") > 300
    assert page.errors == []


async def test_scene_draws_while_paths_are_coloured(page: Page, saved: Path) -> None:
    await page.open(saved.as_uri())
    await page.until(DRAWN)
    for name, ends in (("deviation", True), ("force", False)):
        await page.value(f"(hilCell.paint('{name}'), hilCell.draw(performance.now()))")
        low, high = await page.value("hilCell.range")
        assert (low == -high) is ends
        assert await page.value("hilCell.path.mesh.count") > 0
    ticks = await page.value("[...document.querySelectorAll('.hil-ticks span')].map(one => one.textContent)")
    assert len(ticks) == 3
    assert all(len(tick.strip("−").replace(".", "")) <= 4 for tick in ticks)
    assert page.errors == []

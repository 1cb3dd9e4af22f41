"""The cell in three dimensions in a real browser: what it shows is what the recording says."""

import asyncio
import math
import re
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

CAMERA = """(() => { hilCell.draw(performance.now());
  const {target, yaw, pitch, distance} = hilCell.cameras.tool; return [...target, yaw, pitch, distance]; })()"""
LIVE_HOUR = """(() => {
  const add = () => document.body.appendChild(document.createElement("div"));
  const {model, rows, start} = hilData("data-cell"), empty = {...hilData("data-run"), sources: {}};
  const charts = HilCharts.draw(add(), empty, {keep: KEEP_S, follow: FOLLOW_S, first: FIRST});
  const cell = HilCell.draw(add(), model, {bar: false, keep: KEEP_ROWS}), last = {};
  let now = 0;
  for (const [name, value] of Object.entries(rows.cycle)) last[name] = Array.isArray(value) ? value.at(-1) : value;
  const feed = seconds => {
    const x = Array.from({length: 25 * seconds}, (_, n) => now + 0.04 * n);
    const force = x.map(t => 10 + Math.sin(t)), position_x = x.map(t => 50 * Math.sin(Math.PI * t / 30));
    now += seconds;
    charts.append({cycle: {x, force, depth: position_x}});
    cell.rows({cycle: {...last, x, position_x, force, in_contact: 1, force_reference: 10}}, start);
  };
  const frames = async count => {   // draw frames while rows arrive
    for (const end = cell.frames + count; cell.frames < end;) {
      feed(0.2);
      await new Promise(done => setTimeout(done, 200));
    }
  };
  window.hour = {feed, frames};
})()"""
"""Charts and picture of the live page: rows of some seconds, 25 a second, and frames while rows arrive."""
FRAMES, LEAST_PER_S = 8, 4.0
"""Number of measured frames, and the smallest frame rate for which their processor time allows, 1/s. Chosen."""
GROWTH_MB = 4.0
"""Largest growth of the scripts' memory from 20 to 60 minutes, MB. Chosen: keeping every row would take more."""

_LIVE = files("hil_bridge.show.web").joinpath("static", "page.js").read_text()
_CONSTANTS = dict(re.findall(r"\b([A-Z_]+) = (\d+)[,;]", _LIVE))
KEEP = int(_CONSTANTS["KEEP_ROWS"])
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


@pytest.mark.full
@pytest.mark.timeout(400)
async def test_live_page_of_an_hour_keeps_memory_and_frames(page: Page, saved: Path) -> None:
    await page.open(saved.as_uri())
    await page.until(DRAWN)
    await page.value(re.sub("KEEP_S|FOLLOW_S|FIRST|KEEP_ROWS", lambda name: _CONSTANTS[name[0]], LIVE_HOUR))
    sizes, rates = [], []
    for _ in range(3):
        for _ in range(20):
            await page.value("hour.feed(60)")
        before = await page.metrics()
        await page.value(f"hour.frames({FRAMES})")
        after = await page.metrics()
        sizes.append(after["JSHeapUsedSize"] / 1e6)
        rates.append(FRAMES / (after["TaskDuration"] - before["TaskDuration"]))
    assert sizes[-1] - sizes[0] < GROWTH_MB, sizes
    assert rates[-1] > LEAST_PER_S, rates
    assert page.errors == []


async def test_scene_keys_turn_move_zoom_and_reset(page: Page, saved: Path) -> None:
    await page.open(saved.as_uri())
    await page.until(DRAWN)
    await page.value("hilCell.canvas.focus()")
    *target, yaw, pitch, distance = begin = await page.value(CAMERA)
    await page.press("ArrowLeft")
    await page.press("ArrowUp")
    assert await page.value(CAMERA) == pytest.approx([*target, yaw + 0.1, pitch + 0.08, distance])
    await page.press("ArrowRight", shift=True)
    await page.press("ArrowUp", shift=True)
    *moved, turned, tilted, same = await page.value(CAMERA)
    assert math.dist(moved, target) == pytest.approx(math.sqrt(2) * 0.05 * distance)
    assert [turned, tilted, same] == pytest.approx([yaw + 0.1, pitch + 0.08, distance])
    await page.press("+")
    assert (await page.value(CAMERA))[-1] == pytest.approx(0.85 * distance)
    await page.press("0")
    assert await page.value(CAMERA) == pytest.approx(begin)
    assert page.errors == []


async def test_saved_page_fills_window_above_legend(page: Page, saved: Path) -> None:
    """The legend is outside the drawing, and the cell takes what the rest leaves of the window."""
    await page.open(saved.as_uri(), 1440, 1200)
    await page.until(DRAWN)
    box = "document.querySelector('{}').getBoundingClientRect().{}"
    assert await page.value(f"{box.format('.hil-legend', 'top')} >= {box.format('.hil-stage', 'bottom')}")
    assert await page.value("document.documentElement.scrollHeight") == 1200
    assert await page.value(box.format(".hil-stage", "height")) > 500
    assert await page.value("hilCell.canvas.clientHeight === hilCell.stage.clientHeight")


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


async def test_path_has_colours_of_error_unless_it_is_flat(page: Page, saved: Path) -> None:
    await page.open(saved.as_uri())
    await page.until(DRAWN)
    assert await page.value("hilCell.now") == "deviation"
    flat = "for (const one of Object.values(hilCell.tables)) if (one.target) one.force = one.target.slice()"
    await page.value(f"(() => {{ {flat}; hilCell.path = null; hilCell.draw(performance.now()); }})()")
    assert await page.value("[hilCell.now, hilCell.select.value]") == ["force", "force"]


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

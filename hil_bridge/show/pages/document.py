"""Page as one self-contained file with scripts, style and data."""

import base64
import hashlib
from collections.abc import Mapping
from html import escape
from typing import Any

import msgspec

from hil_bridge.show.pages.assets import asset, cell_script, chart_script, style
from hil_bridge.show.pages.description import Charts

_DATA = """
const hilData = id => JSON.parse(document.getElementById(id).textContent);
const hilDrawn = {};
addEventListener("beforeprint", () => document.querySelectorAll("details.fold").forEach(one => { one.open = true; }));
addEventListener("click", event => {   // a link into a fold opens it
  const link = event.target.closest("a[href^='#']");
  const fold = link && document.querySelector(link.hash)?.closest("details");
  if (fold) fold.open = true;
});
"""
_DRAW = """
for (const place of document.querySelectorAll("[data-charts]")) {
  const first = place.dataset.first ? Number(place.dataset.first) : null;
  hilDrawn[place.dataset.charts] = HilCharts.draw(place, hilData(place.dataset.charts), {first});
}
"""
_DRAW_CELL = """
for (const place of document.querySelectorAll("[data-cell]")) {
  const folded = place.closest("details:not([open])"), draw = () => {
    const {model, rows, start, at} = hilData(place.dataset.cell);
    const charts = hilDrawn[place.dataset.marks];
    const cell = HilCell.draw(place, model, {moved: t => { if (charts) charts.here(t); }});
    cell.rows(rows, start);
    if (charts) cell.bounds(...charts.extent("time"));
    cell.show(at);
    window.hilCell = cell;
  };
  if (folded) folded.addEventListener("toggle", draw, {once: true}); else draw();
}
"""
_ESCAPES = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
"""Characters that could end a script element or a line of the script, with their JSON escapes."""


def in_script(value: object) -> str:
    """Encode a value as JSON that is safe inside a script element. NaN becomes null."""
    encoded = msgspec.json.encode(value).decode()
    for character, escaped in _ESCAPES.items():
        encoded = encoded.replace(character, escaped)
    return encoded


def room(name: str, charts: Charts, first: int | None = None) -> str:
    """Render charts for the body of a document. `name` consists of letters and must be unique in the document.

    With `first`, only this many charts are visible until the reader asks for the others.
    """
    folded = "" if first is None else f' data-first="{first}"'
    return (
        f'<script type="application/json" id="data-{name}">{in_script(charts)}</script>\n'
        f'<div data-charts="data-{name}"{folded}><noscript>The charts need JavaScript.</noscript></div>'
    )


def cell_room(picture: Mapping[str, Any], charts: str = "") -> str:
    """Render the cell in three dimensions for the body of a document, from model, rows and first time.

    `charts` is the name of the `room` whose charts mark the displayed time. Inside a closed `details` element, the
    cell is drawn when the reader opens it.
    """
    return (
        f'<script type="application/json" id="data-cell">{in_script(picture)}</script>\n'
        f'<div data-cell="data-cell" data-marks="data-{charts}"></div>'
    )


def document(title: str, body: str, charts: bool = True, cell: bool = False) -> str:
    """Render the page around an HTML body, with the script that draws each `room` if the page has charts, and the
    `cell_room` if it has a cell.

    The content security policy of the page allows only this script, and no external resources.
    """
    parts = [_DATA] if charts or cell else []
    parts += [chart_script(), _DRAW] if charts else []
    parts += [asset("copy.js")] if " data-copy" in body else []
    parts += [cell_script(), _DRAW_CELL] if cell else []
    script = "\n".join(parts)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    allowed = f"'sha256-{digest}'" if script else "'none'"
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {allowed}"
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{style()}</style>'
    return skeleton(title, head, f"{body}\n<script>{script}</script>" if script else body)


def skeleton(title: str, head: str, body: str) -> str:
    """Render the common skeleton of pages around head and body, both HTML."""
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
{head}</head><body>
{body}
</body></html>
"""

"""A page as one file: scripts, style and data inside, no address of anything else."""

import base64
import hashlib
from html import escape

import msgspec

from hil_bridge.show.pages.assets import chart_script, style
from hil_bridge.show.pages.description import Charts

_DRAW = """
for (const place of document.querySelectorAll("[data-charts]")) {
  const told = document.getElementById(place.dataset.charts).textContent;
  HilCharts.draw(place, JSON.parse(told));
}
"""
_ESCAPES = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
"""Characters that could end a script element, or a line of one, and the way in which JSON writes them."""


def in_script(value: object) -> str:
    """A value as JSON that can stand inside a script element, whatever texts it holds. NaN becomes null."""
    told = msgspec.json.encode(value).decode()
    for character, escaped in _ESCAPES.items():
        told = told.replace(character, escaped)
    return told


def room(name: str, charts: Charts) -> str:
    """Charts at this place of a document's body. Each of a document has a name of its own, of letters."""
    return (
        f'<script type="application/json" id="data-{name}">{in_script(charts)}</script>\n'
        f'<div data-charts="data-{name}"><noscript>The charts need JavaScript.</noscript></div>'
    )


def document(title: str, body: str, charts: bool = True) -> str:
    """The page around a body of HTML, with the script that draws `room` unless it has no charts. No script runs but
    ours, and nothing is loaded from anywhere.
    """
    script = f"{chart_script()}\n{_DRAW}" if charts else ""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    allowed = f"'sha256-{digest}'" if charts else "'none'"
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {allowed}"
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{style()}</style>'
    return skeleton(title, head, f"{body}\n<script>{script}</script>" if charts else body)


def skeleton(title: str, head: str, body: str) -> str:
    """The skeleton of every page around its head and its body, both HTML."""
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
{head}</head><body>
{body}
</body></html>
"""

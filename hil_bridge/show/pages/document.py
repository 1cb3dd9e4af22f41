"""Page as one self-contained file with scripts, style and data."""

import base64
import hashlib
from html import escape

import msgspec

from hil_bridge.show.pages.assets import chart_script, style
from hil_bridge.show.pages.description import Charts

_DRAW = """
for (const place of document.querySelectorAll("[data-charts]")) {
  const encoded = document.getElementById(place.dataset.charts).textContent;
  HilCharts.draw(place, JSON.parse(encoded));
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


def room(name: str, charts: Charts) -> str:
    """Render charts for the body of a document. `name` consists of letters and must be unique in the document."""
    return (
        f'<script type="application/json" id="data-{name}">{in_script(charts)}</script>\n'
        f'<div data-charts="data-{name}"><noscript>The charts need JavaScript.</noscript></div>'
    )


def document(title: str, body: str, charts: bool = True) -> str:
    """Render the page around an HTML body, with the script that draws each `room` if the page has charts.

    The content security policy of the page allows only this script, and no external resources.
    """
    script = f"{chart_script()}\n{_DRAW}" if charts else ""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    allowed = f"'sha256-{digest}'" if charts else "'none'"
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {allowed}"
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{style()}</style>'
    return skeleton(title, head, f"{body}\n<script>{script}</script>" if charts else body)


def skeleton(title: str, head: str, body: str) -> str:
    """Render the common skeleton of pages around head and body, both HTML."""
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
{head}</head><body>
{body}
</body></html>
"""

"""Shared parts of browser pages: one document, no external addresses, escaped texts."""

import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.show.pages import Axis, Chart, Charts, Mark, Series, assets, document, room

HOSTILE = "</script><script>alert(1)</script><!-- \u2028\u2029 & \" ' \\"


class _Elements(HTMLParser):
    """Parser that collects every element with its attributes, and the text of each script."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data: str) -> None:
        if self.elements and self.lasttag == "script":
            self.scripts[-1] += data


def _page() -> str:
    charts = Charts(
        axes={"time": Axis(HOSTILE, "s")},
        charts=[Chart(HOSTILE, HOSTILE, "N", series=[Series("cycle", HOSTILE, HOSTILE)])],
        sources={"cycle": {"x": [0.0, 1.0, 2.0], HOSTILE: [1.5, math.nan, None]}},
        marks=[Mark(1.0, HOSTILE, "stop")],
    )
    return document(HOSTILE, room("run", charts))


def test_page_escapes_hostile_text_in_title_and_data() -> None:
    page = _page()
    parser = _Elements()
    parser.feed(page)
    assert [tag for tag, _ in parser.elements].count("script") == 2
    reported = json.loads(parser.scripts[0])
    assert reported["marks"] == [{"x": 1.0, "text": HOSTILE, "kind": "stop"}]
    assert reported["sources"]["cycle"] == {"x": [0.0, 1.0, 2.0], HOSTILE: [1.5, None, None]}
    assert "\u2028" not in page.split("<body>")[1].split("</script>")[0]


def test_page_policy_allows_only_its_script() -> None:
    parser = _Elements()
    parser.feed(_page())
    for tag, attributes in parser.elements:
        assert not {"src", "href", "srcset", "action"} & set(attributes), (tag, attributes)
    assert not re.search(r"url\(|@import|https?://(?!github\.com/leeoniya/uPlot)", assets.style())
    (policy,) = [a["content"] for t, a in parser.elements if t == "meta" and "http-equiv" in a]
    assert policy is not None
    assert policy.startswith("default-src 'none';")
    assert "script-src 'sha256-" in policy


def test_every_page_contains_uplot_licence() -> None:
    assert "Copyright (c) 2021 Leon Sorokin" in _page()
    assert "The above copyright notice and this permission notice shall be included" in _page()


def test_missing_uplot_is_reported_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assets.asset.cache_clear()
    monkeypatch.setattr(assets, "files", lambda _package: tmp_path)
    with pytest.raises(
        ConfigError, match=r"^.*vendor/uPlot\.iife\.js is missing: install .* with pip[^\n]*$"
    ):
        assets.asset("uPlot.iife.js")
    assets.asset.cache_clear()

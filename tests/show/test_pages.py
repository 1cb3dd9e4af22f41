"""The parts that pages in a browser share: one document, no addresses, texts that stay texts."""

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
    """Every element with its attributes, and the text of each script."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data: str) -> None:
        if self.found and self.lasttag == "script":
            self.scripts[-1] += data


def _page() -> str:
    charts = Charts(
        axes={"time": Axis(HOSTILE, "s")},
        charts=[Chart(HOSTILE, HOSTILE, "N", series=[Series("cycle", HOSTILE, HOSTILE)])],
        sources={"cycle": {"x": [0.0, 1.0, 2.0], HOSTILE: [1.5, math.nan, None]}},
        marks=[Mark(1.0, HOSTILE, "stop")],
    )
    return document(HOSTILE, room("run", charts))


def test_a_hostile_text_stays_a_text_in_title_and_data() -> None:
    page = _page()
    parser = _Elements()
    parser.feed(page)
    assert [tag for tag, _ in parser.found].count("script") == 2
    told = json.loads(parser.scripts[0])
    assert told["marks"] == [{"x": 1.0, "text": HOSTILE, "kind": "stop"}]
    assert told["sources"]["cycle"] == {"x": [0.0, 1.0, 2.0], HOSTILE: [1.5, None, None]}
    assert "\u2028" not in page.split("<body>")[1].split("</script>")[0]


def test_a_page_loads_nothing_and_runs_no_other_script() -> None:
    parser = _Elements()
    parser.feed(_page())
    for tag, attributes in parser.found:
        assert not {"src", "href", "srcset", "action"} & set(attributes), (tag, attributes)
    assert not re.search(r"url\(|@import|https?://(?!github\.com/leeoniya/uPlot)", assets.style())
    (policy,) = [a["content"] for t, a in parser.found if t == "meta" and "http-equiv" in a]
    assert policy is not None
    assert policy.startswith("default-src 'none';")
    assert "script-src 'sha256-" in policy


def test_the_licence_of_the_drawing_library_goes_with_every_page() -> None:
    assert "Copyright (c) 2021 Leon Sorokin" in _page()
    assert "The above copyright notice and this permission notice shall be included" in _page()


def test_an_installation_without_the_library_says_so_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assets.asset.cache_clear()
    monkeypatch.setattr(assets, "files", lambda _package: tmp_path)
    with pytest.raises(
        ConfigError, match=r"^.*vendor/uPlot\.iife\.js is missing: install .* with pip[^\n]*$"
    ):
        assets.asset("uPlot.iife.js")
    assets.asset.cache_clear()

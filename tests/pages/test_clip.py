"""Clip at the top of README."""

from pathlib import Path

from PIL import Image, ImageSequence

from tools.clip import PLACE, SIZE


def test_clip_is_short_and_small() -> None:
    with Image.open(PLACE) as clip:
        lasts_ms = []
        for frame in ImageSequence.Iterator(clip):
            frame.load()
            lasts_ms.append(frame.info["duration"])
        assert clip.size == SIZE
        assert clip.info["loop"] == 0
    assert 5_000 < sum(lasts_ms) <= 15_000
    assert PLACE.stat().st_size <= 1_000_000
    for page in ("README.md", "docs/index.md"):
        assert f"pictures/{PLACE.name}" in (Path(__file__).parents[2] / page).read_text()

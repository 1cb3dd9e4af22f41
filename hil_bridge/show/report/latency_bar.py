"""Stacked bar of the latency hops between a force and the motion in response."""

from itertools import cycle

from hil_bridge.devices.facts import Owner
from hil_bridge.record.analysis.latency import Latency, Part
from hil_bridge.show.pages.svg import box, drawing, line, number, round_numbers, text

SIZE_PX = (1060, 205)
_LEFT, _RIGHT = 12, 12
_BAR = (96, 44)
"""Top and height of the bar, px."""
_COLOURS = {Owner.DEVICE: "c5", Owner.BUS: "c1", Owner.SOFTWARE: "c6", Owner.LINE: "c2", Owner.ROBOT: "c3"}
_LETTER = 6.6
"""Width of a character, px."""
_LEVELS = (84, 66, 48)
"""Vertical positions of the rows for labels above the bar, px, used in turn so that the labels of three
neighbouring hops do not overlap.
"""
_LABELLED_SHARE = 0.02
"""Smallest share of the axis at which a hop gets a label."""
_AXIS_LIMIT = 2.0
"""Longest total latency on the axis, as a multiple of the sum of medians. An outlier must not flatten the hops."""


def latency_bar(latency: Latency) -> str:
    """Draw the medians of the hops, and below them the percentiles of the total."""
    end = sum(part.times.p50_s for part in latency.chain) * 1e3
    limit = 1.04 * max(end, min(latency.total.p99_s * 1e3, _AXIS_LIMIT * end), 1e-3)
    room = SIZE_PX[0] - _LEFT - _RIGHT

    def at(milliseconds: float) -> float:
        return _LEFT + room * milliseconds / limit

    top, height = _BAR
    parts = [line((at(v), top), (at(v), top + height + 27), "grid") for v in round_numbers(0.0, limit, room)]
    parts += [*_owners(latency), *_hops(latency, at(1.0) - at(0.0))]
    low, high = latency.total.p50_s * 1e3, min(latency.total.p99_s * 1e3, limit)
    total_top = top + height + 16
    parts.append(line((at(low), total_top), (at(high), total_top), "text", 1.4))
    percentiles = {"p50": latency.total.p50_s, "p90": latency.total.p90_s, "p99": latency.total.p99_s}
    for seconds in percentiles.values():
        if seconds * 1e3 <= limit:
            place = at(seconds * 1e3)
            parts.append(line((place, total_top - 5), (place, total_top + 5), "text", 1.6))
    label = (
        "total: " + ", ".join(f"{name} {seconds * 1e3:.0f}" for name, seconds in percentiles.items()) + " ms"
    )
    left = at(low) - _LEFT > _LETTER * len(label) + 8
    parts.append(
        text(
            (at(low) - 8 if left else at(high) + 8, total_top + 4), label, "end" if left else "start", "text"
        )
    )
    for value in round_numbers(0.0, limit, room):
        parts.append(text((at(value), top + height + 40), number(value), "middle"))
    parts.append(
        text((_LEFT + room / 2, SIZE_PX[1] - 6), f"{latency.name}: medians of the hops, ms", "middle")
    )
    return drawing(SIZE_PX, parts, "Median of each hop between the force and the motion")


def by_owner(latency: Latency) -> dict[Owner, float]:
    """Return the sum of the median hop durations of each owner, s, in order of appearance."""
    sums: dict[Owner, float] = {}
    for part in latency.chain:
        sums[part.hop.owner] = sums.get(part.hop.owner, 0.0) + part.times.p50_s
    return sums


def _owners(latency: Latency) -> list[str]:
    """Draw the legend: each colour with the sum of its owner."""
    parts, left = [], float(_LEFT)
    for owner, seconds in by_owner(latency).items():
        label = f"{owner} {seconds * 1e3:.1f} ms"
        parts += [box((left, 6, 12, 12), _COLOURS[owner]), text((left + 17, 16), label, colour="text")]
        left += 17 + _LETTER * len(label) + 18
    return parts


def _hops(latency: Latency, scale: float) -> list[str]:
    """Draw the hops end to end with their median durations; `scale` is in px per ms."""
    parts, left, levels = [], float(_LEFT), cycle(_LEVELS)
    top, height = _BAR
    room = SIZE_PX[0] - _LEFT - _RIGHT
    for part in latency.chain:
        width = part.times.p50_s * 1e3 * scale
        parts.append(
            box((left, top, width - 1, height), _COLOURS[part.hop.owner], f"{part.hop.words}: {_words(part)}")
        )
        middle = left + width / 2
        if width > _LETTER * len(_words(part)) + 8:
            parts.append(text((middle, top + height / 2 + 4), _words(part), "middle", "back", bold=True))
        elif width > _LABELLED_SHARE * room:
            level, half = next(levels), _LETTER * len(_words(part)) / 2
            parts += [
                line((middle, level + 3), (middle, top), "quiet", 0.8),
                text((max(middle, _LEFT + half), level), _words(part), "middle", "text"),
            ]
        left += width
    return parts


def _words(part: Part) -> str:
    return f"{part.hop.name.replace('_', ' ')} {part.times.p50_s * 1e3:.1f} ms"

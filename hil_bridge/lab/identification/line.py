"""Transmission errors in a recording: lost and damaged packets, per thousand."""

import math
from collections.abc import Iterator

import numpy as np
from scipy.special import betaincinv

from hil_bridge.devices.facts import MISSING, PACKETS
from hil_bridge.lab.identification.blocks import Estimate
from hil_bridge.lab.identification.gaps import LOST_GAP
from hil_bridge.lab.identification.observations import Observations
from hil_bridge.lab.identification.values import Part, Quantity, Value, Why

_PAUSE_S = 1.0
"""Interval above which a gap counts as a pause, not as a loss, s. Chosen."""
_TAIL = 0.025
"""Probability of each tail of a 95 % interval."""

FRAMES_LOST = Quantity("line.sensor.lost", Part.LINE, "frames of the sensor lost", "‰")
PACKETS_LOST = Quantity("line.robot.lost", Part.LINE, "packets of the robot lost", "‰")
CYCLES_LOST = PACKETS_LOST._replace(words="cycles of the robot missing")
"""Quantity for the missing cycles of a robot whose link is lossless, used instead of `PACKETS_LOST`."""
REPEATED = Quantity("line.robot.repeated", Part.LINE, "messages repeated", "‰")
DAMAGED = Quantity("line.robot.damaged", Part.LINE, "blocks of the robot damaged", "‰")
LATE = Quantity("line.robot.late", Part.LINE, "packets of the robot stale", "‰")
"""Labels of the counters of the robot's link, see `devices.robots`."""
_STALE = "stale packets"
_BLOCKS = "blocks received"
_BAD = ("bad block", "bad checksum", "gap in block")
_SENT = "messages sent"
_AGAIN = ("block repeated", "bid repeated")


def line_values(observations: Observations) -> Iterator[Value]:
    """Yield all values identified for the links to robot and sensor."""
    yield _frames(observations)
    packets = observations.packets
    if packets is None:
        why = Why.NO_COUNTERS if observations.cycles else Why.OF_TABLE
        yield from (quantity.unseen(why) for quantity in (PACKETS_LOST, LATE, DAMAGED, REPEATED))
        return
    came = packets.get(PACKETS)
    missing = packets.get(MISSING, 0.0)
    lossy = observations.robot.counter_label(MISSING) == MISSING
    yield _share(
        PACKETS_LOST if lossy else CYCLES_LOST,
        missing,
        came and came + missing,
        f"{'packets' if lossy else 'cycles'} missing according to the robot's sequence numbers",
    )
    yield _share(LATE, packets.get(_STALE, 0.0), came, "packets older than the newest one")
    blocks = packets.get(_BLOCKS)
    bad = sum(packets.get(name, 0.0) for name in _BAD)
    yield _share(
        DAMAGED, bad, blocks and blocks + bad, "blocks with a wrong check character or format, or a gap"
    )
    sent = packets.get(_SENT)
    again = sum(packets.get(name, 0.0) for name in _AGAIN)
    yield _share(REPEATED, again, sent and sent + again, "repeated bids and blocks")


def _frames(observations: Observations) -> Value:
    """Identify lost frames from the gaps in the stream, because not every sensor numbers its frames."""
    if observations.stream is None or not observations.cycles:
        return FRAMES_LOST.unseen(Why.NO_FORCE if observations.cycles else Why.OF_TABLE)
    times = observations.stream.times
    times = times[
        (times >= observations.cycles[0].started_at) & (times <= observations.cycles[-1].answered_at)
    ]
    gaps = np.diff(times)
    if len(gaps) < 2:
        return FRAMES_LOST.unseen(Why.NO_SAMPLES)
    usual = float(np.median(gaps))
    long = gaps[(gaps > LOST_GAP * usual) & (gaps < _PAUSE_S)]
    facts = observations.stream.facts
    is_polled = facts is not None and facts.period is None  # one lost answer takes a complete timeout
    lost = float(len(long)) if is_polled else float(np.sum(np.round(long / usual) - 1.0))
    return _share(
        FRAMES_LOST, lost, len(gaps) + lost, "gaps in the stream longer than 1.5 times the usual interval"
    )


def _share(quantity: Quantity, count: float, total: float | None, method: str) -> Value:
    """Return a share with its Clopper-Pearson interval, both per thousand."""
    if not total or not math.isfinite(count + total) or not 0.0 <= count <= total:
        return quantity.unseen(Why.NO_COUNTERS)
    low = float(betaincinv(count, total - count + 1.0, _TAIL)) if count else 0.0
    high = float(betaincinv(count + 1.0, total - count, 1.0 - _TAIL)) if count < total else 1.0
    estimate = Estimate(count / total, low, high, "Clopper-Pearson, for independent errors")
    return quantity.value(estimate.times(1e3), method)

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
"""Chosen: interval above which a gap is a pause, not a loss."""
_TAIL = 0.025
"""Tail probability of a 95 % interval."""

FRAMES_LOST = Quantity("line.sensor.lost", Part.LINE, "frames of the sensor lost", "‰")
PACKETS_LOST = Quantity("line.robot.lost", Part.LINE, "packets of the robot lost", "‰")
CYCLES_LOST = PACKETS_LOST._replace(words="cycles of the robot missing")
"""The same of a robot whose wire loses nothing."""
REPEATED = Quantity("line.robot.repeated", Part.LINE, "messages that had to be sent again", "‰")
DAMAGED = Quantity("line.robot.damaged", Part.LINE, "blocks of the robot damaged", "‰")
LATE = Quantity("line.robot.late", Part.LINE, "packets of the robot stale", "‰")
"""Labels of the link counters, see `devices.robots`."""
_STALE = "stale packets"
_BLOCKS = "blocks received"
_BAD = ("bad block", "bad checksum", "gap in block")
_SENT = "messages sent"
_AGAIN = ("block repeated", "bid repeated")


def line_values(seen: Observations) -> Iterator[Value]:
    """Yield all values of the links."""
    yield _frames(seen)
    packets = seen.packets
    if packets is None:
        why = Why.NO_COUNTERS if seen.cycles else Why.OF_TABLE
        yield from (quantity.unseen(why) for quantity in (PACKETS_LOST, LATE, DAMAGED, REPEATED))
        return
    came = packets.get(PACKETS)
    missing = packets.get(MISSING, 0.0)
    lossy = seen.robot.counter_label(MISSING) == MISSING
    yield _share(
        PACKETS_LOST if lossy else CYCLES_LOST,
        missing,
        came and came + missing,
        f"{'packets' if lossy else 'cycles'} that the robot's own number says are missing",
    )
    yield _share(LATE, packets.get(_STALE, 0.0), came, "packets that are older than the newest")
    blocks = packets.get(_BLOCKS)
    bad = sum(packets.get(name, 0.0) for name in _BAD)
    yield _share(DAMAGED, bad, blocks and blocks + bad, "blocks with a wrong check character, form or gap")
    sent = packets.get(_SENT)
    again = sum(packets.get(name, 0.0) for name in _AGAIN)
    yield _share(REPEATED, again, sent and sent + again, "bids and blocks that were repeated")


def _frames(seen: Observations) -> Value:
    """Identify losses from the gaps of the stream: not every sensor numbers its frames."""
    if seen.stream is None or not seen.cycles:
        return FRAMES_LOST.unseen(Why.NO_FORCE if seen.cycles else Why.OF_TABLE)
    times = seen.stream.times
    times = times[(times >= seen.cycles[0].started_at) & (times <= seen.cycles[-1].answered_at)]
    gaps = np.diff(times)
    if len(gaps) < 2:
        return FRAMES_LOST.unseen(Why.NO_SAMPLES)
    usual = float(np.median(gaps))
    long = gaps[(gaps > LOST_GAP * usual) & (gaps < _PAUSE_S)]
    facts = seen.stream.facts
    asked = facts is not None and facts.period is None  # one lost answer is a whole time-out
    lost = float(len(long)) if asked else float(np.sum(np.round(long / usual) - 1.0))
    return _share(
        FRAMES_LOST, lost, len(gaps) + lost, "gaps in the stream of more than one and a half usual times"
    )


def _share(quantity: Quantity, count: float, total: float | None, method: str) -> Value:
    """Return a share with its Clopper-Pearson interval, per thousand."""
    if not total or not math.isfinite(count + total) or not 0.0 <= count <= total:
        return quantity.unseen(Why.NO_COUNTERS)
    low = float(betaincinv(count, total - count + 1.0, _TAIL)) if count else 0.0
    high = float(betaincinv(count + 1.0, total - count, 1.0 - _TAIL)) if count < total else 1.0
    estimate = Estimate(count / total, low, high, "Clopper and Pearson, as if each were struck by itself")
    return quantity.value(estimate.times(1e3), method)

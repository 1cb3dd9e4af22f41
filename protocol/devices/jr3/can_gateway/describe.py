"""Description of gateway frames as text and as plain values for display."""

from protocol.can.frame import CanFrame
from protocol.can.text import parse_frame
from protocol.devices.jr3.can_gateway.messages import (
    ACKNOWLEDGED,
    FROM_GATEWAY,
    FULL_SCALES,
    LAYOUTS,
    Op,
    split,
)

__all__ = ["describe", "parse_frame"]


def describe(frame: CanFrame) -> dict[str, object]:
    """Describe one frame as plain values: op, node, direction, fields with units, and problems."""
    number, node = split(frame.identifier)
    result: dict[str, object] = {
        "identifier": frame.identifier_text,
        "op": None,
        "node": node or None,
        "direction": None,
        "acknowledged": False,
        "fields": [],
    }
    problems: list[str] = []
    result["problems"] = problems
    if frame.error or frame.extended or frame.remote:
        problems.append("a gateway sends only data frames with 11-bit identifiers")
        return result
    try:
        op = Op(number)
    except ValueError:
        problems.append(f"{number:03X} is not an op of a gateway")
        return result
    result["op"] = op.name.lower().replace("_", " ")
    result["direction"] = "from gateway" if op in FROM_GATEWAY else "to gateway"
    result["acknowledged"] = op in ACKNOWLEDGED
    if op is Op.SYNC and node:
        problems.append("SYNC is the bare 080: a gateway ignores it with a node")
    if op is not Op.SYNC and not node:
        problems.append("node 0 is not a gateway")
    size = len(frame.data)
    layout = FULL_SCALES if op is Op.ACKNOWLEDGE and size >= FULL_SCALES.size else LAYOUTS[op]
    if size < layout.size:
        consequence = ": missing bytes count as 0" if op in ACKNOWLEDGED else ""
        problems.append(f"{layout.name} needs {layout.size} bytes, got {size}{consequence}")
        return result
    if size > layout.size:
        problems.append(f"{layout.name} has {layout.size} bytes, got {size}: the rest is ignored")
    result["fields"] = layout.describe(frame.data)
    return result

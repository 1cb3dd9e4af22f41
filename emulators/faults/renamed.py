"""Faults that had another name before version 0.7, and the one that each has now. Nothing else knows the old ones."""

from collections.abc import Mapping
from typing import NamedTuple


class NewName(NamedTuple):
    """A fault as it is called now."""

    target: str
    fault: str
    given: str = ""
    """Further keys of its table `[[faults]]` for what the old one did by its defaults."""

    def __str__(self) -> str:
        return f"{self.target}: {self.fault}{f', {self.given}' if self.given else ''}"


_NEXT_FROM = 'with = {{ probability = 1.0, count = {}, way = "{}" }}'
_ALL_FROM = 'with = { way = "from" }'


def _of_wire(old: str, new: str) -> dict[tuple[str, str], tuple[NewName, ...]]:
    """Names that the faults of every wire had."""
    return {
        (old, "off"): (NewName(new, "off"),),
        (old, "loss"): (NewName(new, "lost"),),
        (old, "corruption"): (NewName(new, "corrupted"),),
        (old, "garbage"): (NewName(new, "garbled"),),
        (old, "duplication"): (NewName(new, "twice"),),
        (old, "delay"): (NewName(new, "late"),),
        (old, "lose-next"): (NewName(new, "lost", _NEXT_FROM.format(20, "from")),),
    }


RENAMED: Mapping[tuple[str, str], tuple[NewName, ...]] = {
    ("robot", "work-stop"): (NewName("robot", "safeguard-stop"),),
    ("robot", "link-control-taken"): (NewName("robot", "local-control"),),
    ("robot", "standby"): (NewName("robot", "motors-off"),),
    ("robot", "power-off"): (NewName("robot", "motors-off"),),
    ("robot", "silence"): (NewName("wire", "off", "for_s = 5.0"),),
    ("robot", "refuse"): (NewName("robot", "refuses"),),
    ("robot", "freeze"): (NewName("robot", "stands"),),
    ("robot", "stand"): (NewName("robot", "stands"),),
    ("robot", "rapid-stop"): (NewName("robot", "program-stopped"),),
    ("robot", "restart"): (NewName("robot", "program-restarted"),),
    ("robot", "program-reset"): (NewName("robot", "program-restarted"),),
    ("robot", "egm-stop"): (NewName("robot", "guidance-ended"),),
    ("robot", "program-end"): (NewName("robot", "guidance-ended"),),
    ("robot", "monitor"): (NewName("robot", "out-of-limits"),),
    ("pose", "standby"): (NewName("robot", "false-standby"),),
    **_of_wire("link", "wire"),
    ("link", "mute"): (NewName("wire", "mute"),),
    ("link", "deaf"): (NewName("wire", "deaf"),),
    ("link", "malformed"): (NewName("wire", "malformed", _NEXT_FROM.format(1, "from")),),
    ("link", "wrong-seqno"): (NewName("wire", "wrong-seqno"),),
    ("link", "no-force"): (NewName("witness", "missing"),),
    ("link", "drop-ack"): (NewName("wire", "drop-ack"),),
    ("link", "nak-block"): (NewName("wire", "nak-block"),),
    ("link", "corrupt-block"): (NewName("wire", "corrupt-block"),),
    ("link", "lose-eot"): (NewName("wire", "lose-eot"),),
    ("link", "babble"): (NewName("wire", "babble"),),
    ("link", "line-break"): (NewName("wire", "line-break"),),
    ("connection", "dropped"): (NewName("wire", "dropped"),),
    ("connection", "mute"): (NewName("wire", "mute"),),
    ("connection", "deaf"): (NewName("wire", "deaf"),),
    ("connection", "late"): (NewName("wire", "late", 'for_s = 5.0, with = { ms = 20.0, way = "from" }'),),
    ("connection", "lost"): (NewName("wire", "lost", _NEXT_FROM.format(1, "from")),),
    ("connection", "in-use"): (NewName("robot", "in-use"),),
    ("packets", "mute"): (NewName("wire", "mute"),),
    ("packets", "lost"): (NewName("wire", "lost", _NEXT_FROM.format(3, "from")),),
    ("packets", "late"): (NewName("wire", "late", 'with = { ms = 6.0, way = "from" }'),),
    ("packets", "duplicated"): (NewName("wire", "twice", 'with = { probability = 1.0, way = "from" }'),),
    ("packets", "reordered"): (NewName("wire", "reordered", _ALL_FROM),),
    ("packets", "malformed"): (NewName("wire", "malformed", _ALL_FROM),),
    ("packets", "not-a-number"): (NewName("pose", "nan"),),
    ("packets", "clock-jump"): (NewName("robot", "clock-jump"),),
    ("answers", "lost"): (NewName("wire", "lost", _NEXT_FROM.format(3, "to")),),
    ("answers", "refused"): (NewName("wire", "deaf"),),
    **_of_wire("frames", "sensor-wire"),
    ("frames", "unplugged"): (NewName("sensor", "unplugged"),),
    ("frames", "slow"): (
        NewName("sensor", "slow"),
        NewName("sensor-wire", "late", 'with = { ms = 50.0, way = "from" }'),
    ),
    ("frames", "frozen-counter"): (NewName("sensor", "frozen-counter"),),
    ("scales", "wrong"): (NewName("sensor", "wrong-scales"),),
    ("sensor", "refusal"): (NewName("sensor", "refuses"),),
    ("sensor", "deaf"): (NewName("sensor-wire", "deaf"),),
}
"""By old target and old name. Of several new ones the first that a device has is its own."""

RENAMED_PARAMETERS: Mapping[tuple[str, str], str] = {
    ("off", "way"): "from the device alone it is mute, to it alone deaf",
}
"""The present form of a parameter that is gone, by fault and parameter."""


def tell_new_name(target: str, fault: str, table: Mapping[str, Mapping[str, object]]) -> str:
    """One line on the name that a fault has now in a cell with this table of faults; empty where it has its old one."""
    if fault in table.get(target, {}):
        return ""
    if names := RENAMED.get((target, fault)):
        there = (name for name in names if name.fault in table.get(name.target, {}))
        return f"{target}: {fault} is called {next(there, names[0])} now"
    if target in table or target in {name.target for names in RENAMED.values() for name in names}:
        return ""
    now = dict.fromkeys(name.target for (old, _), names in RENAMED.items() if old == target for name in names)
    if not now:
        return ""
    return f"the faults of {target} are those of {' and '.join(now)} now"


def tell_new_name_alone(fault: str) -> str:
    """The same for a fault that is named without its target."""
    lines = (tell_new_name(target, old, {}) for target, old in RENAMED if old == fault)
    return next(lines, "")

"""The form of a cycle in the file: its sample leaves out the facts that the cycle tells too.

A fact of the sample that differs from the cycle's stays, as that of an orientation that is none.
"""

from collections.abc import Mapping
from typing import Any, Final

import msgspec
from msgspec import UNSET, Struct, UnsetType, structs

from hil_bridge.control.sample import Sample
from hil_bridge.record.records import CycleRecord

SHARED: Final[Mapping[str, str]] = {
    "now": "status_at",
    "position": "position",
    "sensor_at": "sensor_at",
    "sensor_sequence": "sensor_sequence",
    "wrench": "wrench",
    "quaternion": "quaternion",
}
"""Fields of a sample, and those of the cycle that tell the same."""


def _derive(cls: type[Struct], changed: Mapping[str, tuple[Any, Any]]) -> type[Struct]:
    """A type with other types and defaults of these fields, and the texts of all of them."""
    fields = [(name, *both) for name, both in changed.items()]
    space = {"__doc__": cls.__doc__}
    return msgspec.defstruct(
        cls.__name__, fields, bases=(cls,), module=cls.__module__, namespace=space, frozen=True, kw_only=True
    )


_SAMPLE = _derive(
    Sample,
    {field.name: (field.type | UnsetType, UNSET) for field in structs.fields(Sample) if field.name in SHARED},
)
STORED = _derive(CycleRecord, {"sample": (_SAMPLE | None, None)})
"""The type of a message."""


def pack(record: CycleRecord) -> CycleRecord:
    """The record as it is written."""
    sample = record.sample
    if sample is None:
        return record
    twice: dict[str, Any] = {
        name: UNSET for name, other in SHARED.items() if _same(getattr(sample, name), getattr(record, other))
    }
    return structs.replace(record, sample=structs.replace(sample, **twice))


def unpack(stored: Any) -> CycleRecord:
    """The record as it was put."""
    values = structs.asdict(stored)
    if (sample := stored.sample) is not None:
        facts = structs.asdict(sample)
        for name, other in SHARED.items():
            if facts[name] is UNSET:
                facts[name] = values[other]
        values["sample"] = Sample(**facts)
    return CycleRecord(**values)


def _same(one: object, other: object) -> bool:
    return one is other or one == other

"""A recording in the formats of other programs: CAN logs, text captures, tables."""

from hil_bridge.record.export.files import FORMATS, export

__all__ = ["FORMATS", "export"]

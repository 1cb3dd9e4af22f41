"""A recording in the formats of other programs: CAN logs, text captures, tables, bags of ROS 2."""

from hil_bridge.record.export.files import FORMATS, Choices, export

__all__ = ["FORMATS", "Choices", "export"]

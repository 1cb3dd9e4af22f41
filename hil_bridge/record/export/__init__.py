"""Export of a recording to other formats: CAN logs, text captures, tables, ROS 2 bags."""

from hil_bridge.record.export.files import FORMATS, Choices, export

__all__ = ["FORMATS", "Choices", "export"]

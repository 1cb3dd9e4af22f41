"""ATI NETCANOEM board: raw strain gage readings over CAN."""

from protocol.devices.ati_can.client import AtiCanClient
from protocol.devices.ati_can.describe import describe
from protocol.devices.ati_can.messages import BASE, BITRATE, can_messages, heard
from protocol.devices.ati_can.profile import AtiCanClientProfile

__all__ = ["BASE", "BITRATE", "AtiCanClient", "AtiCanClientProfile", "can_messages", "describe", "heard"]

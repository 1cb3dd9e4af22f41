"""The emulated JR3 force/torque sensor and its CAN gateway."""

from emulators.jr3.gateway import Gateway, GatewayProfile
from emulators.jr3.sensor import SENSOR_RATE_HZ, Jr3Sensor, SensorProfile

__all__ = ["SENSOR_RATE_HZ", "Gateway", "GatewayProfile", "Jr3Sensor", "SensorProfile"]

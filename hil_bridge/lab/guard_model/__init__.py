"""A small explicit model of the guard, and the recordings that it accepts. Pure."""

from hil_bridge.lab.guard_model.model import GuardModel, GuardState, GuardStep, Told, Way
from hil_bridge.lab.guard_model.tracing import Unaccepted, first_unaccepted

__all__ = [
    "GuardModel",
    "GuardState",
    "GuardStep",
    "Told",
    "Unaccepted",
    "Way",
    "first_unaccepted",
]

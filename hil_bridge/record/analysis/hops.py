"""Hops of a cycle that all robots share: from the force sample to the hand-over of the order.

The subsequent hops are part of the robot's facts; see `hil_bridge.devices.facts`.
"""

from hil_bridge.devices.facts import Hop, Owner

SENSOR = Hop(
    "sensor", "sampled_at", "sensor_at", Owner.BUS, "way of the sample from the sensor to its arrival"
)
JITTER = Hop(
    "sensor_jitter",
    "earliest_at",
    "sensor_at",
    Owner.BUS,
    "sensor frame's delay above the smallest one",
)
MIDDLE = (
    Hop("decoding", "sensor_at", "decoded_at", Owner.SOFTWARE, "decoding of the sensor frame"),
    Hop(
        "waiting",
        "decoded_at",
        "status_at",
        Owner.DEVICE,
        "wait of the newest sensor frame for the robot's status",
    ),
    Hop("controller", "status_at", "proposed_at", Owner.SOFTWARE, "controller"),
    Hop("supervisor", "proposed_at", "controlled_at", Owner.SOFTWARE, "supervisor"),
    Hop("hand_over", "controlled_at", "sent_at", Owner.SOFTWARE, "hand-over of the move to the link"),
)

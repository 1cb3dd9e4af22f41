"""Times that devices take to report a force and to carry out an order, from their facts."""

import math

from hil_bridge.control.course.following import Following
from hil_bridge.control.course.reaction import Reaction, servo_lag
from hil_bridge.devices.facts import Pacing, RobotFacts
from protocol.wrench import SensorFacts

WIRE_S = 0.0105
"""Transmission time of a frame from the sensor to the bridge, s. Chosen: the time of the slowest known sensor,
which includes its own 10 ms and its jitter.
"""
POLLED_S = 0.01
"""Time between two frames of a sensor without a known period, s. Chosen: the period of the default stream."""
STREAM_CYCLES = 2.0
"""Number of stream cycles from a decision to its set point. Derived: one cycle until the next packet requests the
set point, and one cycle by which a set point that stops at each target lags.
"""
FOLLOWS_SHARE = 1.5
"""Largest ratio of a robot's actual lag to the lag in its facts. Chosen: the servo of most robots is only assumed."""
TRAILS = 3.0
"""Number of time constants after which a lagging set point counts as arrived. Derived: an exponential has covered
95 % by then.
"""


def usual_gap(sensor: SensorFacts, wire_s: float = WIRE_S) -> float:
    """Return the largest usual age of the newest frame at evaluation, s."""
    return (POLLED_S if sensor.period is None else sensor.period) + wire_s


def force_age(sensor: SensorFacts, wire_s: float = WIRE_S) -> float:
    """Return the largest usual age of a force when the frame that reports it is evaluated, s."""
    return sensor.delay + usual_gap(sensor, wire_s)


def robot_motion(robot: RobotFacts) -> float:
    """Return the time from the robot's receipt of an order to the end of the tool's motion into the surface, s;
    infinite if the servo is unknown.
    """
    servo = robot.servo
    if servo is None:
        return math.inf
    lag = servo_lag(servo.natural_frequency_rad_s, servo.damping_ratio)
    return servo.interpolation_s + servo.transport_delay_s + servo.trail_s + lag


def reaction(robot: RobotFacts, sensor: SensorFacts, cycle_s: float) -> Reaction:
    """Return the reaction times to a force. `cycle_s` is the longest usual interval between decisions, s.

    A polled robot receives the order within the cycle of the decision.
    """
    return Reaction(force_age(sensor), cycle_s, _order_s(robot, cycle_s), robot_motion(robot))


def _order_s(robot: RobotFacts, cycle_s: float) -> float:
    """Return the time from a decision to the robot's receipt of the order, s."""
    streams = robot.pacing is Pacing.STREAMED and robot.cycle_s is not None
    return STREAM_CYCLES * (robot.cycle_s or 0.0) if streams else cycle_s


def following(robot: RobotFacts, cycle_s: float) -> Following | None:
    """Return the check that this robot follows its orders, with decisions every `cycle_s`, s; None if its servo is
    unknown.
    """
    if robot.servo is None:
        return None
    takes_s = _order_s(robot, cycle_s) + robot_motion(robot) + (TRAILS - 1.0) * robot.servo.trail_s
    return Following(FOLLOWS_SHARE * takes_s, robot.position_step_m or 0.0)

"""How long devices take to tell a force and to do an order, from their facts."""

import math

from hil_bridge.control.course.following import Following
from hil_bridge.control.course.reaction import Reaction, servo_lag
from hil_bridge.devices.facts import Pacing, RobotFacts
from protocol.wrench import SensorFacts

WIRE_S = 0.0105
"""Way of a frame from the sensor to the bridge. Chosen: that of the slowest sensor known, whose own 10 ms are assumed
too, with its jitter.
"""
ASKED_S = 0.01
"""Time between two frames of a sensor that tells no period. Chosen: that of the default stream."""
STREAM_CYCLES = 2.0
"""Cycles of a stream from a decision to its set point. Derived: one until the next packet asks for it, and one by which
a set point that comes to rest at each target is behind.
"""
FOLLOWS_SHARE = 1.5
"""Chosen: a robot may take so many times what its facts say, for the servo of most of them is assumed."""
TRAILS = 3.0
"""Time constants until a set point that trails counts as there. Derived: an exponential has done 95 % by then."""


def usual_gap(sensor: SensorFacts, wire_s: float = WIRE_S) -> float:
    """How old the newest frame may be when it is looked at, s: at most, while all is well."""
    return (ASKED_S if sensor.period is None else sensor.period) + wire_s


def force_age(sensor: SensorFacts, wire_s: float = WIRE_S) -> float:
    """How old a force may be when the frame that tells of it is looked at, s: at most, while all is well."""
    return sensor.delay + usual_gap(sensor, wire_s)


def robot_motion(robot: RobotFacts) -> float:
    """From an order that the robot has to a tool that goes no deeper, s; infinite where its servo is not known."""
    servo = robot.servo
    if servo is None:
        return math.inf
    lag = servo_lag(servo.natural_frequency_rad_s, servo.damping_ratio)
    return servo.interpolation_s + servo.transport_delay_s + servo.trail_s + lag


def reaction(robot: RobotFacts, sensor: SensorFacts, cycle_s: float) -> Reaction:
    """How long it takes to answer a force, with decisions every `cycle_s`, s: the longest cycle that is usual.

    A robot that is asked has the order within the cycle of the decision.
    """
    return Reaction(force_age(sensor), cycle_s, _order_s(robot, cycle_s), robot_motion(robot))


def _order_s(robot: RobotFacts, cycle_s: float) -> float:
    """From a decision to the order that the robot has, s."""
    streams = robot.pacing is Pacing.STREAMED and robot.cycle_s is not None
    return STREAM_CYCLES * (robot.cycle_s or 0.0) if streams else cycle_s


def following(robot: RobotFacts, cycle_s: float) -> Following | None:
    """Return the watch over this robot with decisions every `cycle_s`, s; None if its servo is not known."""
    if robot.servo is None:
        return None
    takes_s = _order_s(robot, cycle_s) + robot_motion(robot) + (TRAILS - 1.0) * robot.servo.trail_s
    return Following(FOLLOWS_SHARE * takes_s, robot.position_step_m or 0.0)

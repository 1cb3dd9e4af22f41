"""The configuration of a run whose tool goes so slowly that it stays on the surface and in the robot's reach."""

SLOW_TOOL = """\
[run]
duration_s = %g
[task]
speed_mm_s = 1.0
approach_speed_mm_s = 10.0
retract_mm = 5.0
[robot]
emulated = "%s"
"""
"""For a time, s, and a kind of robot."""

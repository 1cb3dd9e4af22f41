"""Stiffness and first mode of an IRB 2000. No measurement of one is public."""

from emulators.arm.mode import Mode
from protocol.arm_size import PerAxis

JOINT_STIFFNESS: PerAxis = (3.1e5, 2.4e5, 1.4e5, 1.6e4, 1.6e4, 1.0e4)
"""Joint stiffness, N·m/rad. Its encoders are on the motors, so it does not report the deflection.

Axes 1 to 3 are derived from an arm of its time, the Manutec r3 for 15 kg, times 10/15 for its payload. That arm has
springs of 43, 8 and 58 N·m/rad on motors with ratios of 105, 210 and 60 (Türk 1990, in the Modelica Standard Library,
MultiBody.Examples.Systems.RobotR3), so 4.7e5, 3.5e5 and 2.1e5 N·m/rad at its joints. The wrist is assumed: strain-wave
gears of sizes 20, 20 and 17. Right to a factor of 2, the wrist to a factor of 3.
"""
MODE = Mode(14.0, 0.03)
"""First mode. Derived: frequency from that stiffness and the masses of the links of an IRB 2400 (Obal and Gierlak,
Acta Mechanica et Automatica 2025, doi 10.2478/ama-2025-0064) in the start pose; right to a factor of 1.5. Damping: the
dampers of the r3's springs give its axes 0.005, 0.05 and 0.03.
"""

"""Stiffness and first mode of a KR 16-2. No measurement of one is public."""

from emulators.arm.mode import Mode
from protocol.arm_size import PerAxis

JOINT_STIFFNESS: PerAxis = (4.7e5, 3.5e5, 2.1e5, 3.1e4, 3.1e4, 1.6e4)
"""Joint stiffness, N·m/rad. Its encoders are on the motors, so it does not report the deflection.

Axes 1 to 3 are those of the Manutec r3, an arm for 15 kg (Türk 1990, in the Modelica Standard Library,
MultiBody.Examples.Systems.RobotR3). A cycloidal gear for 412 N·m alone has 3.9e5 (catalogue of Nabtesco, RV-42N). The
wrist is assumed: strain-wave gears of sizes 25, 25 and 20. Right to a factor of 2, the wrist to a factor of 3.
"""
MODE = Mode(18.0, 0.03)
"""First mode. Derived: frequency from that stiffness and the masses of the links of an IRB 2400 (Obal and Gierlak,
Acta Mechanica et Automatica 2025, doi 10.2478/ama-2025-0064) in the start pose; right to a factor of 1.5. Damping: the
dampers of the r3's springs give its axes 0.005, 0.05 and 0.03.
"""

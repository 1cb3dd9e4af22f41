"""Stiffness and first mode of Universal Robots' arms, which the maker does not publish.

A joint's maximum torque is that of a strain-wave gear of ratio 100: 333, 157, 54 and 28 N·m for sizes 32, 25, 17 and
14 (catalogue of Harmonic Drive's CSF series), and 330, 150, 56 and 28 N·m for the joints of an arm (Universal Robots,
article on joint torques). At low torque, the catalogue states 6.7e4, 3.1e4, 1.0e4 and 4.7e3 N·m/rad.

With these gears, rigid links and the masses that Universal Robots publishes, a UR5e in the pose of lbusellato/CoLeCT
has modes at 19 and 24 Hz. Its accelerometer there shows 20.5 and 21.7 Hz. A UR10e stretched upwards has 9 to 10 Hz.
The mean spectrum of its currents after 38 stops in shamilmamedov/dynamic_calibration peaks at 7.0 Hz, which is 0.6 of
the stiffness; links and stand are the remainder.

Not modelled: an e-Series has its reported encoders behind the gears. In the first recording, the reported pose
contains 0.7 to 0.9 of the tool's oscillation at 21 Hz, and the angles are steps of 2π/2^19. The reported shoulder is
15 µrad from its target under 25 N·m, which turns the gear by 0.8 mrad. A real controller thus corrects the slow part
of the deflection; here, no encoder measures it. For a CB3 nothing is known.
"""

from collections.abc import Mapping

from emulators.arm.mode import Mode
from protocol.arm_size import PerAxis

_SMALL: PerAxis = (3.1e4, 3.1e4, 3.1e4, 4.7e3, 4.7e3, 4.7e3)
_LARGE: PerAxis = (4.0e4, 4.0e4, 1.9e4, 6.0e3, 6.0e3, 6.0e3)
JOINT_STIFFNESS: Mapping[str, PerAxis] = {"ur5e": _SMALL, "ur5": _SMALL, "ur10e": _LARGE, "ur10": _LARGE}
"""Joint stiffness, N·m/rad. Derived: that of the gears, times 0.6 in the larger arms; right to a factor of 1.5. A CB3
has joints of the same torque.
"""
_SMALL_MODE, _LARGE_MODE = Mode(16.5, 0.10), Mode(8.0, 0.10)
MODE: Mapping[str, Mode] = {
    "ur5e": _SMALL_MODE,
    "ur5": _SMALL_MODE,
    "ur10e": _LARGE_MODE,
    "ur10": _LARGE_MODE,
}
"""First mode. Derived: frequency from that stiffness and those masses in the start pose, with a tool of 0.5 kg; right
to a factor of 1.3, and lower the further the arm reaches. The damping is that of both peaks of the UR5e, 0.10 and
0.11, with its servo on; right to a factor of 2.
"""

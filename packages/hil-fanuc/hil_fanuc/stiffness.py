"""Stiffness and first mode of the arms. No measurement of one is public."""

from collections.abc import Mapping

from emulators.arm.mode import Mode
from protocol.arm_size import PerAxis

JOINT_STIFFNESS: Mapping[str, PerAxis] = {
    "crx-10ia/l": (4.8e4, 4.8e4, 2.4e4, 6.7e3, 6.7e3, 6.7e3),
    "m-10ia": (3.1e5, 2.4e5, 1.4e5, 1.6e4, 1.6e4, 1.0e4),
}
"""Joint stiffness, N·m/rad.

CRX-10iA/L: derived from the largest torques of its joints, 400, 400, 200 and 60 N·m (fanuc_crx_description): a
strain-wave gear of 333, 157 and 54 N·m has 6.7e4, 3.1e4 and 1.0e4 N·m/rad (catalogue of Harmonic Drive's CSF series),
scaled to these torques, times 0.6 as for a UR10e, an arm with the same payload and such gears. Right to a factor of 2.

M-10iA: joints 1 to 3 are derived from an arm for 15 kg, the Manutec r3 (4.7e5, 3.5e5, 2.1e5 N·m/rad: Türk 1990, in the
Modelica Standard Library, MultiBody.Examples.Systems.RobotR3), times 10/15 for its payload. The wrist is assumed:
strain-wave gears of sizes 20, 20 and 17. Right to a factor of 2, the wrist to a factor of 3.
"""
MODES: Mapping[str, Mode] = {"crx-10ia/l": Mode(8.0, 0.10), "m-10ia": Mode(14.0, 0.03)}
"""First mode. Assumed: of a CRX as of a UR10e, which has such joints, payload and reach; of an M-10iA as of another arm
for 10 kg with cycloidal gears. Right to a factor of 1.5.
"""

"""Functions of the arm's dynamics and of the joint torques that a program commands.

Sources: calls in `rtde_control.script` of ur_rtde 1.6.5, which indexes matrices as `m[row, column]` and passes
torques as a list; positional parameters in programs that call them, and ur_rtde's functions of the same names.
"""

from emulators.devices.rtde.urscript.table import Function, tagged

_NONE = (0.0,) * 6
_MATRIX = (_NONE,) * 6

DYNAMICS: tuple[Function, ...] = (
    tagged("direct_torque(torques, friction_comp=True, viscous_scale=None, coulomb_scale=None)"),
    tagged("get_joint_torques()", _NONE),
    tagged("get_actual_joint_accelerations()", _NONE),
    tagged("get_target_joint_accelerations()", _NONE),
    tagged("get_jacobian(q=None, tcp=None)", _MATRIX),
    tagged("get_jacobian_time_derivative(q=None, qd=None, tcp=None)", _MATRIX),
    tagged("get_mass_matrix(q=None, include_rotors_inertia=False)", _MATRIX),
    tagged("get_coriolis_and_centrifugal_torques(q=None, qd=None)", _NONE),
)

"""Constant documents of an emulated ABB controller: its configuration, system, tasks and modules.

Source: the resources and attributes that abb_librws (9ba0837) reads. Values are those of the emulated arm.
"""

import math
from collections.abc import Mapping, Sequence

from emulators.devices.egm.profile import EgmProfile
from emulators.devices.egm.web_documents import Item

UNIT, TASK = "ROB_1", "T_ROB1"
MODULES = ("TRobMain", "TRobEGM", "TRobRAPID", "TRobUtility")
"""Modules of the StateMachine add-in that abb_librws names and this controller emulates."""
SYSTEM_NAME = "HilBridgeEmulator"
_ADD_IN = "StateMachine"
"""Name by which abb_egm_rws_managers (7e554e5) identifies the add-in 1.0, which reports a stopped EGM action as 0.
It requests `current_state` and `current_action` only with that option.
"""
_OPTIONS = ("689-1 Externally Guided Motion (EGM)", "616-1 PC Interface", _ADD_IN)
_VERSIONS = {"6.06": "6.06.00.00", "6.10": "6.10.00.00", "7": "7.00.00.00"}
_NAMES = tuple(f"rob1_{axis}" for axis in range(1, 7))


_FRAME = {
    **dict.fromkeys(("base_frame_pos_x", "base_frame_pos_y", "base_frame_pos_z"), "0"),
    "base_frame_orient_u0": "1",
    "base_frame_orient_u1": "0",
    "base_frame_orient_u2": "0",
    "base_frame_orient_u3": "0",
    "base_frame_coordinated": "",
}


def make_documents(profile: EgmProfile) -> Mapping[str, Sequence[Item]]:
    """Return items by path, in lower case."""
    return {
        **_make_system(profile),
        **{f"/rw/cfg/moc/{name}/instances": items for name, items in _make_motion(profile).items()},
        "/rw/cfg/sys/mechanical_unit_group/instances": [_instance("rob1", {"Name": "rob1", "Robot": UNIT})],
        "/rw/cfg/sys/present_options/instances": [
            _instance(name, {"name": name, "desc": name}) for name in _OPTIONS
        ],
        "/rw/rapid/modules": [
            Item("rap-module-info-li", name, {"name": name, "type": "ProgMod"}) for name in MODULES
        ],
    }


def _make_system(profile: EgmProfile) -> Mapping[str, Sequence[Item]]:
    identity = {"ctrl-name": SYSTEM_NAME, "ctrl-type": "Virtual Controller"}
    version = dict.fromkeys(("rwversion", "rwversionname"), _VERSIONS[profile.rw])
    options = [Item("sys-option-li", f"{number}", {"option": name}) for number, name in enumerate(_OPTIONS)]
    return {
        "/ctrl": [Item("ctrl-identity-info-li", "identity", identity)],
        "/rw/system": [Item("sys-system-li", "system", {"name": SYSTEM_NAME, **version}), *options],
    }


def _make_motion(profile: EgmProfile) -> Mapping[str, Sequence[Item]]:
    """Return instances of the motion configuration by type."""
    arm, arms, joints = profile.arm, [], []
    limits = zip(arm.axis_middles_deg, arm.axis_ranges_deg, strict=True)
    for axis, (name, (middle, half)) in enumerate(zip(_NAMES, limits, strict=True), 1):
        low, high = (f"{math.radians(bound):.9g}" for bound in (middle - half, middle + half))
        arms.append(_instance(name, {"name": name, "lower_joint_bound": low, "upper_joint_bound": high}))
        axes = dict.fromkeys(("logical_axis", "kinematic_axis_number"), f"{axis}")
        uses = dict.fromkeys(("use_arm", "use_transmission"), name)
        joints.append(_instance(name, {"name": name, **axes, **uses}))
    used = {f"use_joint_{axis}": name for axis, name in enumerate(_NAMES)}
    robot = {"name": UNIT, "use_robot_type": "EMULATED", **used, **_FRAME}
    return {
        "arm": arms,
        "joint": joints,
        "robot": [_instance(UNIT, robot)],
        "single": [],
        "transmission": [_instance(name, {"rotating_move": "true"}) for name in _NAMES],
        "mechanical_unit": [_instance(UNIT, {"name": UNIT, "use_robot": UNIT})],
    }


def _instance(title: str, values: Mapping[str, str]) -> Item:
    parts = [Item("cfg-ia-t-li", name, {"value": text}) for name, text in values.items()]
    return Item("cfg-dt-instance-li", title, {}, parts)

"""Documents of an emulated ABB controller that never change: its configuration, its system, its tasks and modules.

Source: the resources and attributes that abb_librws (9ba0837) reads. Values are those of the emulated arm.
"""

import math
from collections.abc import Mapping, Sequence

from emulators.devices.egm.profile import EgmProfile
from emulators.devices.egm.web_documents import Item

UNIT, TASK = "ROB_1", "T_ROB1"
MODULES = ("TRobMain", "TRobEGM", "TRobRAPID", "TRobUtility")
"""Modules of the StateMachine add-in that abb_librws names, as far as they stand here."""
SYSTEM_NAME = "HilBridgeEmulator"
_ADD_IN = "StateMachine"
"""Name by which abb_egm_rws_managers (7e554e5) knows the add-in 1.0, whose value of a stopped EGM action is 0. By that
option alone it asks for `current_state` and `current_action`.
"""
_OPTIONS = ("689-1 Externally Guided Motion (EGM)", "616-1 PC Interface", _ADD_IN)
_VERSIONS = {"6.06": "6.06.00.00", "6.10": "6.10.00.00", "7": "7.00.00.00"}
_NAMES = tuple(f"rob1_{axis}" for axis in range(1, 7))


def make_documents(profile: EgmProfile) -> Mapping[str, Sequence[Item]]:
    """Items by path, in lower case."""
    arm = profile.arm
    bounds = [
        (math.radians(middle - half), math.radians(middle + half))
        for middle, half in zip(arm.axis_middles_deg, arm.axis_ranges_deg, strict=True)
    ]
    arms = [
        _instance(name, {"name": name, "lower_joint_bound": f"{low:.9g}", "upper_joint_bound": f"{high:.9g}"})
        for name, (low, high) in zip(_NAMES, bounds, strict=True)
    ]
    joints = [
        _instance(
            name,
            {
                "name": name,
                "logical_axis": f"{axis}",
                "kinematic_axis_number": f"{axis}",
                "use_arm": name,
                "use_transmission": name,
            },
        )
        for axis, name in enumerate(_NAMES, 1)
    ]
    frame = dict.fromkeys(("base_frame_pos_x", "base_frame_pos_y", "base_frame_pos_z"), "0")
    frame |= {"base_frame_orient_u0": "1", "base_frame_orient_u1": "0"}
    frame |= {"base_frame_orient_u2": "0", "base_frame_orient_u3": "0", "base_frame_coordinated": ""}
    used = {f"use_joint_{axis}": name for axis, name in enumerate(_NAMES)}
    robot = _instance(UNIT, {"name": UNIT, "use_robot_type": "EMULATED", **used, **frame})
    group = {"Name": "rob1", "Robot": UNIT}
    return {
        "/ctrl": [
            Item(
                "ctrl-identity-info-li",
                "identity",
                {"ctrl-name": SYSTEM_NAME, "ctrl-type": "Virtual Controller"},
            )
        ],
        "/rw/system": [
            Item(
                "sys-system-li",
                "system",
                {
                    "name": SYSTEM_NAME,
                    "rwversion": _VERSIONS[profile.rw],
                    "rwversionname": _VERSIONS[profile.rw],
                },
            ),
            *(Item("sys-option-li", f"{number}", {"option": name}) for number, name in enumerate(_OPTIONS)),
        ],
        "/rw/cfg/moc/arm/instances": arms,
        "/rw/cfg/moc/joint/instances": joints,
        "/rw/cfg/moc/robot/instances": [robot],
        "/rw/cfg/moc/single/instances": [],
        "/rw/cfg/moc/transmission/instances": [_instance(name, {"rotating_move": "true"}) for name in _NAMES],
        "/rw/cfg/moc/mechanical_unit/instances": [_instance(UNIT, {"name": UNIT, "use_robot": UNIT})],
        "/rw/cfg/sys/mechanical_unit_group/instances": [_instance("rob1", group)],
        "/rw/cfg/sys/present_options/instances": [
            _instance(name, {"name": name, "desc": name}) for name in _OPTIONS
        ],
        "/rw/rapid/modules": [
            Item("rap-module-info-li", name, {"name": name, "type": "ProgMod"}) for name in MODULES
        ],
    }


def _instance(title: str, values: Mapping[str, str]) -> Item:
    parts = [Item("cfg-ia-t-li", name, {"value": text}) for name, text in values.items()]
    return Item("cfg-dt-instance-li", title, {}, parts)

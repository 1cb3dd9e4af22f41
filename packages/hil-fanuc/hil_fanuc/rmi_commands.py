"""Commands of the Remote Motion Interface of the emulated controller."""

from collections.abc import Callable
from typing import Any

import numpy as np

from emulators.orders import Act, ReceivedOrder
from hil_fanuc import alarms, rmi, rmi_motions
from hil_fanuc.arms import to_pendant
from hil_fanuc.rmi import Message, ProgramStatus
from hil_fanuc.rmi_interface import Interface
from hil_fanuc.rmi_motions import Instruction
from protocol.geometry import Pose, angles_of

_MOTIONS = ("FRC_CircularMotion", "FRC_CircularRelative", "FRC_LinearMotionJRep", "FRC_LinearRelativeJRep",
            "FRC_SplineMotion", "FRC_SplineMotionJRep")  # fmt: skip
"""Instructions that move the arm and are not modelled."""
_STORED_MAX = 1024
"""Largest number of ports whose values are kept. Chosen."""


class Commands:
    """Effects of the commands at one time."""

    def __init__(self, interface: Interface, now: float) -> None:
        self._interface, self._host, self._now = interface, interface.host, now

    def answer(self, name: str, message: Message) -> Message | None:
        """Carry out a command, and return its answer without its name; None for no answer."""
        act = _ACTS.get(name)
        if act is not None:
            answer: Message | None = act(self, message)
            return answer
        if name in rmi_motions.NAMES:
            return self._instruct(name, message)
        if name in _MOTIONS:
            self._host.report_order(
                ReceivedOrder(self._now, Act.REFUSED, f"{name} of the Remote Motion Interface", False)
            )
            self._host.server.unmodelled.touch(name, "refused")
            return {"SequenceID": message.get("SequenceID", 0), "ErrorID": rmi.BAD_INSTRUCTION}
        return {"ErrorID": rmi.BAD_COMMAND}

    def _instruct(self, name: str, message: Message) -> Message | None:
        """Queue an instruction; it is answered once it is done."""
        host, interface = self._host, self._interface
        answer = self._number(message)
        if answer is None or answer["ErrorID"]:
            return answer
        if not interface.initialized or not host.program.servo_on or host.program.pendant_on:
            return answer | {"ErrorID": rmi.NOT_RUNNING}
        if host.program.status == ProgramStatus.RUNNING:
            return answer | {"ErrorID": rmi.BAD_STATE}
        instruction = rmi_motions.read(name, message, interface.override / 100.0)
        if instruction is None or not host.rmi_motions.add(instruction):
            return answer | {"ErrorID": rmi.BAD_VALUE}
        if message.get("TermType", "FINE") != "FINE":
            host.server.unmodelled.touch("smooth transitions", "the arm stops at each position")
        if name != rmi_motions.WAIT:
            pose = host.rmi_motions.goal_of(instruction)
            host.report_order(ReceivedOrder(self._now, Act.MOTION, name, pose is not None, pose))
        return None

    def _number(self, message: Message) -> Message | None:
        """Take the sequence number of an instruction, and return an answer with an error if it is not the next one. One
        that was used is dropped without an answer (observed).
        """
        interface, number = self._interface, message.get("SequenceID")
        if not isinstance(number, int):
            return {"ErrorID": rmi.BAD_VALUE}
        if number < interface.sequence:
            return None
        if number > interface.sequence:
            return {"SequenceID": number, "ErrorID": rmi.BAD_SEQUENCE}
        interface.sequence += 1
        return {"SequenceID": number, "ErrorID": 0}

    def _initialize(self, message: Message) -> Message:
        host = self._host
        if host.program.pendant_on:
            return {"ErrorID": rmi.BAD_STATE}
        if not host.program.servo_on:
            return {"ErrorID": rmi.NOT_READY}
        self._interface.initialized, self._interface.sequence = True, 1
        return {"ErrorID": 0, "GroupMask": message.get("GroupMask", 1)}

    def _abort(self, message: Message) -> Message:
        program = self._host.program
        program.ended_by_client |= program.status == ProgramStatus.RUNNING
        self._host.abort()
        return {"ErrorID": 0}

    def _pause(self, message: Message) -> Message:
        program, motions = self._host.program, self._host.rmi_motions
        program.ended_by_client |= program.status == ProgramStatus.RUNNING
        program.pause()
        motions.is_paused = motions.is_busy
        return {"ErrorID": 0}

    def _continue(self, message: Message) -> Message:
        """Continue a program that was paused. After an abort it stays held, although the answer is good (observed)."""
        program, motions = self._host.program, self._host.rmi_motions
        if program.hangs:
            return {"ErrorID": rmi.CANNOT_RESUME}
        if motions.is_paused:
            motions.is_paused = False
            return {"ErrorID": 0}
        return {"ErrorID": 0 if program.resume() else rmi.NOT_PAUSED}

    def _reset(self, message: Message) -> Message:
        host = self._host
        if host.program.alarms or host.program.stopped_at is not None:
            host.report_order(ReceivedOrder(self._now, Act.RELEASE, "FRC_Reset", True))
        return {"ErrorID": 0 if host.reset(self._now) else rmi.CANNOT_RESET}

    def _read_error(self, message: Message) -> Message:
        newest = list(self._host.program.alarms.newest) or [alarms.NONE]
        count = message.get("Count", 1)
        texts = newest[: min(max(count, 1), 5) if isinstance(count, int) else 1]
        keys = ("ErrorData", *(f"ErrorData{number}" for number in range(2, 6)))
        return {"ErrorID": 0, "Count": len(texts), **dict(zip(keys, texts, strict=False))}

    def _get_status(self, message: Message) -> Message:
        interface, program = self._interface, self._host.program
        return {
            "ErrorID": 0,
            "ServoReady": int(program.servo_on),
            "TPMode": int(program.pendant_on),
            "RMIMotionStatus": int(interface.initialized and program.may_move),
            "ProgramStatus": program.status,
            "SingleStepMode": 0,
            "NumberUTool": 10,
            "NextSequenceID": interface.sequence,
            "NumberUFrame": 9,
            "Override": interface.override,
        }

    def _get_ext_status(self, message: Message) -> Message:
        program = self._host.program
        return {
            "ErrorID": 0,
            "InMotion": int(not self._host.motion.is_still),
            "DrivesPowered": int(program.servo_on),
            "GenOverride": self._interface.override,
            "SpeedClampLimit": 100.0,
            "ErrorCode": program.alarms.newest[0] if program.alarms else "",
            "ControlMode": "LOCAL",
        }

    def _read_joints(self, message: Message) -> Message:
        joints = to_pendant(self._host.motion.joints)
        angles = {f"J{axis}": round(angle, 3) for axis, angle in enumerate((*joints, 0.0, 0.0, 0.0), 1)}
        return {"ErrorID": 0, "TimeTag": round(self._now * 1e3), "JointAngle": angles}

    def _read_position(self, message: Message) -> Message:
        motion = self._host.motion
        position = _section(motion.arm.in_world(motion.path.pose)) | dict.fromkeys(
            ("Ext1", "Ext2", "Ext3"), 0.0
        )
        return {
            "ErrorID": 0,
            "TimeTag": round(self._now * 1e3),
            "Configuration": self._configuration(),
            "Position": position,
        }

    def _call(self, message: Message) -> Message | None:
        """Call a TP program."""
        interface, host, name = self._interface, self._host, message.get("ProgramName")
        answer = self._number(message)
        if answer is None or answer["ErrorID"]:
            return answer
        host.report_order(ReceivedOrder(self._now, Act.PROGRAM, f"FRC_Call {name}"[:40], True, moves=False))
        if name != rmi.STREAM_PROGRAM:
            return answer | {"ErrorID": rmi.BAD_PROGRAM}
        if not interface.initialized:
            return answer | {"ErrorID": rmi.NOT_RUNNING}

        def call(at: float) -> int:
            return 0 if host.program.call(at) else rmi.CANNOT_EXECUTE

        return self._in_order("FRC_Call", answer, call)

    def _select(self, message: Message) -> Message | None:
        """Select a user frame or a tool frame."""
        name, answer, numbers = rmi.name_of(message).name, self._number(message), self._interface.numbers
        if answer is None or answer["ErrorID"]:
            return answer
        key, number = (
            ("UFrameNumber", "FrameNumber") if name == "FRC_SetUFrame" else ("UToolNumber", "ToolNumber")
        )
        value = message.get(number)
        if not isinstance(value, int):
            return answer | {"ErrorID": rmi.BAD_VALUE}

        def select(at: float) -> int:
            numbers[key] = value
            return 0

        return self._in_order(name, answer, select)

    def _in_order(self, name: str, answer: Message, act: Callable[[float], int]) -> Message | None:
        """Carry out an act behind the instructions that wait; at once without any. It returns an ErrorID."""
        motions = self._host.rmi_motions
        if not motions.is_busy:
            return answer | {"ErrorID": act(self._now)}
        is_added = motions.add(Instruction(name, answer["SequenceID"], act=act))
        return None if is_added else answer | {"ErrorID": rmi.BAD_INSTRUCTION}

    def _set_override(self, message: Message) -> Message:
        value = message.get("Value")
        if not isinstance(value, int) or not 1 <= value <= 100:
            return {"ErrorID": 2556933}
        self._interface.override = value
        self._host.server.unmodelled.touch("override", "kept, without effect on streamed set points")
        return {"ErrorID": 0}

    def _set_payload(self, message: Message) -> Message:
        self._host.server.unmodelled.touch("payload schedule", "kept; the load is that of the cell's tool")
        return {"ErrorID": 0}

    def _set_numbers(self, message: Message) -> Message:
        numbers = self._interface.numbers
        numbers |= {key: message[key] for key in numbers if isinstance(message.get(key), int)}
        self._host.server.unmodelled.touch("user and tool frames", "kept; the tool is that of the cell")
        return {"ErrorID": 0}

    def _get_numbers(self, message: Message) -> Message:
        return {"ErrorID": 0, **self._interface.numbers}

    def _write_frame(self, message: Message) -> Message:
        number = message.get("FrameNumber", message.get("ToolNumber"))
        frame = message.get("Frame")
        if not isinstance(number, int) or not isinstance(frame, dict) or len(self._interface.frames) > 64:
            return {"ErrorID": rmi.BAD_VALUE}
        self._interface.frames[f"{rmi.name_of(message).name[9:14]}{number}"] = frame
        return {"ErrorID": 0}

    def _read_frame(self, message: Message) -> Message:
        key = "ToolNumber" if "UTool" in rmi.name_of(message).name else "FrameNumber"
        number = message.get(key, 1)
        frame = self._interface.frames.get(f"{rmi.name_of(message).name[8:13]}{number}")
        if key == "FrameNumber":
            return {"ErrorID": 0, key: number, "Frame": frame or dict.fromkeys("XYZWPR", 0.0)}
        tool = frame or _section(self._host.motion.arm.tool)
        return {"ErrorID": 0, key: number, "Frame": tool, "Configuration": self._configuration()}

    def _configuration(self) -> Message:
        """Return frame numbers and posture, as answers contain them."""
        turns = dict.fromkeys(("Flip", "Turn4", "Turn5", "Turn6"), 0)
        return {**self._interface.numbers, "Front": 1, "Up": 1, "Left": 0, **turns}

    def _read_input(self, message: Message) -> Message:
        return {"ErrorID": 0, "PortNumber": message.get("PortNumber", 0), "PortValue": 0}

    def _write_output(self, message: Message) -> Message:
        port, value = message.get("PortNumber"), message.get("PortValue")
        if not isinstance(port, int) or value not in ("ON", "OFF"):
            return {"ErrorID": rmi.BAD_VALUE}
        if len(self._interface.ports) < _STORED_MAX:
            self._interface.ports["DO", port] = int(value == "ON")
        return {"ErrorID": 0}

    def _read_port(self, message: Message) -> Message:
        kind, number = str(message.get("PortType", "")), message.get("PortNumber", 0)
        value = self._interface.ports.get((kind, number), 0)
        return {"ErrorID": 0, "PortType": kind, "PortNumber": number, "PortValue": value}

    def _write_port(self, message: Message) -> Message:
        kind, number, value = (
            str(message.get("PortType", "")),
            message.get("PortNumber"),
            message.get("PortValue"),
        )
        if not isinstance(number, int) or not isinstance(value, int | float):
            return {"ErrorID": rmi.BAD_VALUE}
        if len(self._interface.ports) < _STORED_MAX:
            self._interface.ports[kind, number] = value
        return {"ErrorID": 0, "PortType": kind, "PortNumber": number}

    def _read_variable(self, message: Message) -> Message:
        """Read a system variable; only the sampling period of Stream Motion is known."""
        name, profile = message.get("VariableName"), self._host.profile
        values = {"$STMO.$COM_INT": profile.cycle_ms, "$STMO.$PKT_STACK": profile.packet_stack}
        if not isinstance(name, str) or name not in values:
            return {"ErrorID": rmi.BAD_VALUE}
        return {"ErrorID": 0, "VariableName": name, "VariableType": "Integer", "VariableValue": values[name]}

    def _read_speed(self, message: Message) -> Message:
        path, now = self._host.motion.path, self._now
        _, velocities = path.trajectory(np.array([now]))
        return {
            "ErrorID": 0,
            "TimeTag": round(now * 1e3),
            "Speed": round(1e3 * float(np.linalg.norm(velocities)), 3),
        }

    def _read_register(self, message: Message) -> Message:
        value = self._interface.registers.get(message.get("RegisterNumber", 0), 0)
        kind = "Integer" if isinstance(value, int) else "Float"
        return {"ErrorID": 0, "DataType": kind, "RegisterValue": value}

    def _write_register(self, message: Message) -> Message:
        number, value = message.get("RegisterNumber"), message.get("RegisterValue")
        if not isinstance(number, int) or not isinstance(value, int | float) or not 1 <= number <= 200:
            return {"ErrorID": rmi.BAD_VALUE}
        self._interface.registers[number] = value
        return {"ErrorID": 0}

    def _read_position_register(self, message: Message) -> Message:
        number = message.get("RegisterNumber", 0)
        position = self._interface.positions.get(number)
        if position is None:
            return {"ErrorID": rmi.BAD_POSITION_REGISTER}
        return {"ErrorID": 0, "RegisterNumber": number, **position}

    def _write_position_register(self, message: Message) -> Message:
        number = message.get("RegisterNumber")
        if not isinstance(number, int) or not 1 <= number <= 100:
            return {"ErrorID": rmi.BAD_POSITION_REGISTER}
        keys = "Representation", "Configuration", "Position", "JointAngle"
        self._interface.positions[number] = {key: message[key] for key in keys if key in message}
        return {"ErrorID": 0, "RegisterNumber": number}


def _section(pose: Pose) -> Message:
    """Return a pose as answers contain it."""
    r, p, w = angles_of(pose.quaternion)
    values = (*(1e3 * part for part in pose.position), w, p, r)
    return {key: round(value, 3) for key, value in zip("XYZWPR", values, strict=True)}


_ACTS: dict[str, Any] = {
    "FRC_Initialize": Commands._initialize,
    "FRC_Abort": Commands._abort,
    "FRC_Pause": Commands._pause,
    "FRC_Continue": Commands._continue,
    "FRC_Reset": Commands._reset,
    "FRC_ReadError": Commands._read_error,
    "FRC_GetStatus": Commands._get_status,
    "FRC_GetExtStatus": Commands._get_ext_status,
    "FRC_ReadJointAngles": Commands._read_joints,
    "FRC_ReadCartesianPosition": Commands._read_position,
    "FRC_Call": Commands._call,
    "FRC_SetUFrame": Commands._select,
    "FRC_SetUTool": Commands._select,
    "FRC_SetOverRide": Commands._set_override,
    "FRC_SetPayloadID": Commands._set_payload,
    "FRC_SetPayloadValue": Commands._set_payload,
    "FRC_SetPayloadComp": Commands._set_payload,
    "FRC_SetUFrameUTool": Commands._set_numbers,
    "FRC_GetUFrameUTool": Commands._get_numbers,
    "FRC_WriteUFrameData": Commands._write_frame,
    "FRC_WriteUToolData": Commands._write_frame,
    "FRC_ReadUFrameData": Commands._read_frame,
    "FRC_ReadUToolData": Commands._read_frame,
    "FRC_ReadDIN": Commands._read_input,
    "FRC_WriteDOUT": Commands._write_output,
    "FRC_ReadIOPort": Commands._read_port,
    "FRC_WriteIOPort": Commands._write_port,
    "FRC_ReadVariable": Commands._read_variable,
    "FRC_ReadTCPSpeed": Commands._read_speed,
    "FRC_ReadRegister": Commands._read_register,
    "FRC_WriteRegister": Commands._write_register,
    "FRC_ReadPositionRegister": Commands._read_position_register,
    "FRC_WritePositionRegister": Commands._write_position_register,
}
"""Effect of each command, by name."""

"""Standard Modbus on the command channel: registers of the emulated control box.

Source: doc/UF_ModbusTCP_Manual.md in xArm-Developer/xArm-Python-SDK d911319c. Read are the error, the pose and the
joints; written are mode and state.
"""

import math
from collections.abc import Callable, Mapping, Sequence

from hil_xarm.arms import to_box
from hil_xarm.box import Box
from hil_xarm.frames import Frame, State
from protocol.geometry import rotation_vector

_ILLEGAL_FUNCTION, _ILLEGAL_ADDRESS, _ILLEGAL_VALUE = 1, 2, 3
_MODE, _STATE = 32, 33
_COUNT_MAX = 125


class _Refused(Exception):
    """Request that is answered with an exception code."""


def answer_modbus(box: Box, frame: Frame, now: float) -> bytes:
    """Carry out a request, and return the frame of its answer."""
    box.advance(now)
    unit, body = frame.body[:1], frame.body[1:]
    try:
        if not body:
            raise _Refused(_ILLEGAL_FUNCTION)
        answer = body[:1] + _carry_out(box, body[0], body[1:], now)
    except _Refused as refused:
        box.counts["Modbus requests refused"] += 1
        function = body[0] if body else 0
        answer = bytes((function | 0x80, refused.args[0]))
    answer = unit + answer
    header = (frame.transaction, frame.protocol, len(answer))
    return b"".join(part.to_bytes(2, "big") for part in header) + answer


def _carry_out(box: Box, function: int, data: bytes, now: float) -> bytes:
    if len(data) < 4:
        raise _Refused(_ILLEGAL_VALUE)
    address, count = int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big")
    match function:
        case 1:  # read coils
            values = [int(value) for value in _read(_coils(box), address, count)]
            octets = bytes(
                sum(bit << k for k, bit in enumerate(values[at : at + 8])) for at in range(0, count, 8)
            )
            return bytes((len(octets),)) + octets
        case 3 | 4:  # read holding registers, input registers
            table = _holding(box) if function == 3 else _registers(box, now)
            words = [value.to_bytes(2, "big", signed=True) for value in _read(table, address, count)]
            return bytes((2 * count,)) + b"".join(words)
        case 6:  # write a register
            _write(box, address, count)
            return data[:4]
        case 16:  # write registers
            if len(data) < 5 + 2 * count:
                raise _Refused(_ILLEGAL_VALUE)
            for k in range(count):
                _write(box, address + k, int.from_bytes(data[5 + 2 * k : 7 + 2 * k], "big"))
            return data[:4]
        case _:
            box.unmodelled.touch(f"Modbus function {function}", "answered with exception 1")
            raise _Refused(_ILLEGAL_FUNCTION)


def _read(table: Mapping[int, int], address: int, count: int) -> Sequence[int]:
    addresses = range(address, address + count)
    if not 1 <= count <= _COUNT_MAX:
        raise _Refused(_ILLEGAL_VALUE)
    if not all(number in table for number in addresses):
        raise _Refused(_ILLEGAL_ADDRESS)
    return [table[number] for number in addresses]


def _write(box: Box, address: int, value: int) -> None:
    act: Callable[[int], object] | None = {_MODE: box.set_mode, _STATE: box.set_state}.get(address)
    if act is None:
        raise _Refused(_ILLEGAL_ADDRESS)
    if act(value) is False:
        raise _Refused(_ILLEGAL_VALUE)


def _coils(box: Box) -> Mapping[int, int]:
    return {144: box.state == State.PAUSED, 145: box.state == State.STOPPED}


def _holding(box: Box) -> Mapping[int, int]:
    return {_MODE: box.mode, _STATE: box.state}


def _registers(box: Box, now: float) -> Mapping[int, int]:
    """Return the input registers: tenths of mm, of degrees and of degrees/s."""
    pose, joints = box.reported_pose(now)
    x, y, z, *angles = to_box(pose)
    turns = [math.degrees(angle) for angle in (*angles, *rotation_vector(pose.quaternion))]
    table = {32: box.error, 33: box.warning}
    table |= _row(64, (x, y, z, *turns))
    table |= _row(89, (*joints, 0.0))
    table |= _row(103, (*box.motion.loops.rates, 0.0))
    table |= _row(110, (1e3 * box.motion.tool_speed,))
    return table


def _row(first: int, values: Sequence[float]) -> dict[int, int]:
    """Return tenths in consecutive registers; a value that does not fit is the largest that does."""
    tenths = (10.0 * value if math.isfinite(value) else 0.0 for value in values)
    return {first + k: max(-32768, min(32767, round(tenth))) for k, tenth in enumerate(tenths)}

"""Client of an xArm that does not use hil-bridge: it moves the tool by 10 mm along y and back in servo mode.

python client.py HOST PORT REAL_PORT [MODE]; modes: deaf: ignores a stop; leaps: sends distant poses; clears: clears the
error of a stop and goes on.
"""

import math
import socket
import struct
import sys
import time

HEADER = struct.Struct(">HHH")
STEPS = 400
host, port, real_port = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
mode = sys.argv[4] if sys.argv[4:] else ""
command = socket.create_connection((host, port), 10.0)
reports = socket.create_connection((host, real_port), 10.0)
number = 0


def receive(connection: socket.socket, count: int) -> bytes:
    """Return exactly this number of bytes."""
    data = b""
    while len(data) < count:
        data += connection.recv(count - len(data)) or sys.exit("the connection is closed")
    return data


def ask(function: int, data: bytes = b"") -> tuple[int, bytes]:
    """Send a command, and return the state and the data of its reply."""
    global number
    number += 1
    command.sendall(HEADER.pack(number, 2, len(data) + 1) + bytes((function,)) + data)
    _, _, length = HEADER.unpack(receive(command, HEADER.size))
    body = receive(command, length)
    return body[1], body[2:]


def prepare() -> None:
    """Make the arm ready for servo mode."""
    ask(11, b"\x08\x01")
    ask(19, b"\x01")
    if ask(12, b"\x00")[0] & 0x40:
        sys.exit(f"error {ask(15)[1][0]}")


def newest_pose() -> tuple[float, ...]:
    """Return the pose of the next report."""
    size = struct.unpack(">I", receive(reports, 4))[0]
    return struct.unpack_from("<6f", receive(reports, size - 4), 31)


prepare()
time.sleep(0.1)
start = newest_pose()
for step in range(1, STEPS + 1):
    newest_pose()
    offset = 5.0 * (1.0 - math.cos(2.0 * math.pi * step / STEPS))
    if mode == "leaps" and step == STEPS // 2:
        offset += 60.0
    pose = (start[0], start[1] + offset, *start[2:])
    state, _ = ask(30, struct.pack("<9f", *pose, 0.0, 0.0, 0.0))
    if state & 0x50 and mode == "clears":
        ask(16)
        prepare()
    elif state & 0x50 and mode != "deaf":
        sys.exit("the robot is stopped")

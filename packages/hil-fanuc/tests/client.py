"""Client of Stream Motion that does not use hil-bridge: it turns joint 1 by 2° and back.

python client.py HOST PORT RMI_PORT [MODE]; modes: deaf: ignores a stop; style-0: sends joints with the data style of
poses; no-stop: sends no stop packet at its end.
"""

import json
import math
import socket
import struct
import sys
import time

HEADER, COMMAND = struct.Struct(">II"), struct.Struct(">IIIBBH9d256x")
REPORT = struct.Struct(">IIIBBBxI9f9f9ff256x")
VERSION, STEPS = 3, 700
host, port, rmi_port = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
mode = sys.argv[4] if sys.argv[4:] else ""


def ask(line: dict) -> dict:
    """Send a line, and return the next one."""
    session.sendall(json.dumps(line).encode() + b"\r\n")
    return json.loads(lines.readline())


with socket.create_connection((host, rmi_port), 3.0) as door:
    door.sendall(b'{"Communication": "FRC_Connect"}\r\n')
    session_port = json.loads(door.makefile().readline())["PortNumber"]
session = socket.create_connection((host, session_port), 3.0)
lines = session.makefile()
stream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
stream.settimeout(1.0)
stream.connect((host, port))
stream.send(HEADER.pack(2, VERSION))
for command in ("FRC_Abort", "FRC_Reset", "FRC_Initialize"):
    if error := ask({"Command": command})["ErrorID"]:
        sys.exit(f"{command}: {error}")
number = ask({"Command": "FRC_GetStatus"})["NextSequenceID"]
ask({"Instruction": "FRC_Call", "SequenceID": number, "ProgramName": "STREAM_MOTN"})
stream.send(HEADER.pack(200, VERSION))
start, step, began = None, 0, time.monotonic()
while step < STEPS:
    _, _, sequence, status, robot_status, contact, _, *numbers = REPORT.unpack(stream.recv(2000))
    joints = numbers[9:18]
    ready = bool(status & 1) and not robot_status and not contact
    if not ready and start is None:
        stream.send(COMMAND.pack(201, VERSION, sequence, 0, 0, 0xFFFF, *joints))
        if time.monotonic() - began > 3.0:
            sys.exit("not ready")
        continue
    if not ready and mode != "deaf":
        stream.send(COMMAND.pack(201, VERSION, sequence, 1, 0, 0xFFFF, *joints))
        stream.send(HEADER.pack(2, VERSION))
        sys.exit("the robot is stopped")
    start = start or joints
    step += 1
    turn = 1.0 - math.cos(2.0 * math.pi * step / STEPS)
    style = 0 if mode == "style-0" else 0xFFFF
    goal = (start[0] + turn, *start[1:])
    stream.send(COMMAND.pack(201, VERSION, sequence, step == STEPS, 1, style, *goal))
if mode != "no-stop":
    stream.send(HEADER.pack(2, VERSION))
ask({"Communication": "FRC_Disconnect"})

"""Client of the toy arm that does not use hil-bridge: it moves the tool 20 mm down and up again.

python client.py HOST PORT; with `deaf` as a third argument it ignores the stop.
"""

import math
import socket
import struct
import sys

REPORT, TARGET = struct.Struct("<2sI3d4dB"), struct.Struct("<2sI3d4d")
STEPS = 1500

wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.settimeout(1.0)
wire.connect((sys.argv[1], int(sys.argv[2])))
wire.send(b"AH")
start = None
for step in range(STEPS):
    _, number, *pose, stopped = REPORT.unpack(wire.recv(200))
    start = start or pose
    if stopped and sys.argv[3:] != ["deaf"]:
        sys.exit("the arm is stopped")
    x, y, z, *quaternion = start
    down = 0.01 * (1.0 - math.cos(2.0 * math.pi * step / STEPS))
    wire.send(TARGET.pack(b"AT", number, x, y, z - down, *quaternion))

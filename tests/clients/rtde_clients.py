"""Small RTDE client with deliberate mistakes: `python rtde_clients.py MISTAKE`; hil-bridge passes the address.

It loads our own program onto the robot, and sends poses that go down and up again.
"""

import math
import os
import signal
import socket
import struct
import sys
import time

from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.packets import Kind, Reader, inputs_request, outputs_request, version_request
from protocol.devices.rtde.packets import encode as packet
from protocol.devices.rtde.program import INPUT_NAMES, Command, program_text

HOST = os.environ["HIL_BRIDGE_HOST"]
MISTAKE = sys.argv[1]
SECONDS = float(sys.argv[2]) if len(sys.argv) > 2 else math.inf
INPUTS = Recipe(1, INPUT_NAMES, (*("DOUBLE",) * 9, "INT32", "INT32"))
NORMAL, STOPPED_BY_PERSON = 1, 3


def connected(name):
    return socket.create_connection((HOST, int(os.environ[name])), timeout=5)


def answer(wire, reader):
    while (result := reader.next_packet()) is None:
        reader.feed(wire.recv(4096))
    return result


def main():
    wire, reader = connected("HIL_BRIDGE_PORT"), Reader()
    if MISTAKE == "garbage":
        wire.sendall(b"\x00\x05\xff\r\n" * 10)
        time.sleep(60)
    requests = (
        version_request(),
        inputs_request(INPUT_NAMES),
        outputs_request(("actual_TCP_pose", "safety_mode"), 500.0),
        packet(Kind.START),
    )
    for request in requests:
        wire.sendall(request)
        answer(wire, reader)
    pose = start = None
    with connected("HIL_BRIDGE_SCRIPT") as script:
        script.sendall(program_text(50, 10.0, 2.0, 0.03).encode() + b"\n")
        begun, sequence = time.monotonic(), 0
        while time.monotonic() - begun < SECONDS:
            *pose, safety = struct.unpack(">6di", answer(wire, reader).payload[1:])
            start = start or pose
            if safety != NORMAL and MISTAKE != "stubborn":
                print("the robot has stopped: safety mode", safety)
                return
            sequence += 1
            deep = 0.01 * (1.0 - math.cos(math.pi * (time.monotonic() - begun)))
            deep += 0.2 if MISTAKE == "leap" and sequence > 130 else 0.0
            target = (start[0], start[1] + deep, *start[2:])
            wire.sendall(INPUTS.pack(*target, 0.002, 0.1, 300.0, Command.SERVO, sequence))
            if MISTAKE == "crash" and sequence > 100 and safety == NORMAL:
                os.kill(os.getpid(), signal.SIGSEGV)


if MISTAKE == "deaf":
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    print("this client does not want to end", flush=True)
main()

"""The messages of one control cycle said by asyncio and nothing else: what is left of a bridge without its work.

asyncio_host.py ROBOT SENSOR STATUS_BLOCK MOVE_BLOCK ANSWER_BYTES MOVE_ANSWER_BYTES, as `c/host.c`.
"""

import asyncio
import os
import socket
import sys
import tty

ENQ, ACK, EOT = b"\x05", b"\x06", b"\x04"


def open_wire(url: str) -> int:
    """The file of a wire, which stays open until the process ends."""
    kind, _, target = url.partition(":")
    if kind == "tcp":
        host, _, port = target.rpartition(":")
        connection = socket.create_connection((host, int(port)))
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        fd = connection.detach()
    elif kind == "pty":
        fd = os.open(target, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(fd)
    else:
        bus = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        bus.bind((target,))
        fd = bus.detach()
    os.set_blocking(fd, False)
    return fd


async def main(arguments: list[str]) -> None:
    """Say the messages until a wire ends."""
    robot, sensor = map(open_wire, arguments[:2])
    status, move = map(bytes.fromhex, arguments[2:4])
    answer, move_answer = map(int, arguments[4:])
    steps = (
        *((ENQ, 1), (status, 1), (EOT, 1), (ACK, answer), (ACK, 1)),
        *((ENQ, 1), (move, 1), (EOT, 1), (ACK, move_answer), (ACK, 1)),
    )
    loop = asyncio.get_running_loop()
    ended = loop.create_future()
    step = awaited = 0

    def say() -> None:
        nonlocal step, awaited
        message, awaited = steps[step]
        step = (step + 1) % len(steps)
        os.write(robot, message)

    def read(fd: int) -> bytes:
        try:
            data = os.read(fd, 4096)
        except OSError:
            data = b""
        if not data and not ended.done():
            ended.set_result(None)
        return data

    def heard() -> None:
        nonlocal awaited
        awaited -= len(read(robot))
        if awaited <= 0 and not ended.done():
            say()

    loop.add_reader(robot, heard)
    loop.add_reader(sensor, read, sensor)
    say()
    await ended


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1:]))

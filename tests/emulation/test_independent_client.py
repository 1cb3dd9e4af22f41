"""A client written from the byte tables alone drives the emulated controller, so no codec is shared.

It follows the observed rows of the computer-link specification (sections 2 and 3) like a simple program on a serial
port: send one order, wait for its answer. It does not use this project's `protocol` package.
"""

import struct

import pytest

from emulators.devices.s3 import S3Controller, S3Profile, S3Profiles
from emulators.seams import StartPose
from protocol.devices.s3.adlp import LinkProfile

ENQ, ACK, NAK, EOT = b"\x05", b"\x06", b"\x15", b"\x04"
ORDER, RESPONSE, SPONTANEOUS, REFUSAL = 1, 2, 3, 6
START_PROGRAM, STOP_PROGRAM, STATUS, MODE, MOVE = 2, 3, 19, 20, 24
OPERATION = 1
POINT, FIRST, LAST = 0, 2, 3
CHARACTER = 11 / 9600
DOWN = (0.0, 1.0, 0.0, 0.0)


class Refused(Exception):
    """The controller refused an order, with this code."""


class SerialPort:
    """Port to the emulated controller: writes take the line's time, reads block like on a real port."""

    def __init__(self, link=None, **robot):
        self.now = 98765.5
        self.waiting = b""
        self.received = bytearray()
        self.robot = S3Controller(
            S3Profiles(S3Profile(**robot), link or LinkProfile()),
            StartPose((0.9, -0.1, 0.6), DOWN, 0.2),
            self.now,
            1,
        )

    def write(self, data):
        for value in data:
            self.pass_time(CHARACTER)
            self.robot.receive(bytes((value,)), self.now)
            self.waiting += self.robot.data_to_send(self.now)

    def read(self, size, timeout):
        end = self.now + timeout
        while len(self.waiting) < size:
            due = self.robot.next_deadline()
            if due is None or due > end:
                self.now = end
                raise TimeoutError(f"{len(self.waiting)} of {size} bytes within {timeout} s")
            self.pass_time(max(due - self.now, 0.0))
        data, self.waiting = self.waiting[:size], self.waiting[size:]
        self.received += data
        self.now += size * CHARACTER
        return data

    def pass_time(self, seconds):
        end = self.now + seconds
        while (due := self.robot.next_deadline()) is not None and due <= end:
            self.robot.handle_deadline(due)
            self.waiting += self.robot.data_to_send(due)
        self.now = end


class Client:
    """Client based on byte tables, struct and XOR."""

    def __init__(self, port):
        self.port = port

    def order(self, function, suffix=0, data=b""):
        """Send an order, and return the data of the answer."""
        self.send(struct.pack(">HBBBBH", 8 + len(data), 1, 0, function, ORDER, suffix) + data)
        answer = self.hear()
        length, source, destination, answered, kind, _ = struct.unpack(">HBBBBH", answer[:8])
        assert (length, source, destination, answered) == (len(answer), 0, 0, function)
        if kind == REFUSAL:
            raise Refused(*struct.unpack(">H", answer[8:]))
        assert kind == RESPONSE
        return answer[8:]

    def send(self, telegram):
        self.port.write(ENQ)
        assert self.port.read(1, 2.0) == ACK
        check = 3
        for value in telegram:
            check ^= value
        self.port.write(b"\x10\x02" + telegram + b"\x10\x03" + bytes((check,)))
        assert self.port.read(1, 2.0) == ACK
        self.port.write(EOT)

    def hear(self):
        assert self.port.read(1, 10.0) == ENQ
        self.port.write(ACK)
        head = self.port.read(4, 2.0)
        assert head[:2] == b"\x10\x02"
        telegram = head[2:] + self.port.read(int.from_bytes(head[2:], "big") - 2, 2.0)
        end = self.port.read(3, 2.0)
        check = 3
        for value in telegram:
            check ^= value
        assert end == b"\x10\x03" + bytes((check,))
        self.port.write(ACK)
        assert self.port.read(1, 2.0) == EOT
        return telegram

    def status(self):
        """Return the flags of byte 17, the position in mm, and the quaternion."""
        data = self.order(STATUS)
        assert len(data) == 24
        registers = struct.unpack(">3h4h", data[10:])
        return data[9], [word * 0.125 for word in registers[:3]], [word / 16384 for word in registers[3:]]

    def move(self, suffix, position=(0.0, 0.0, 0.0), mm_s=200.0):
        flags = 0 if suffix == POINT else 2
        registers = [round(value / 0.125) for value in position]
        quaternion = (0, 16384, 0, 0) if suffix != FIRST else (0, 0, 0, 0)
        data = struct.pack(">4xBBHH3h4h", 0, flags, round(mm_s / 0.125), 8192, *registers, *quaternion)
        self.order(MOVE, suffix, data.ljust(52 - 8, b"\0"))


@pytest.fixture
def client():
    return Client(SerialPort())


def test_client_reads_status_moves_and_stops(client):
    flags, position, quaternion = client.status()
    assert flags == 0b0001, "standby"
    assert position == [900.0, -100.0, 600.0]
    assert quaternion == [0.0, 1.0, 0.0, 0.0]

    client.order(MODE, OPERATION)
    assert client.status()[0] == 0b0010, "operation"

    points = [(900.0, -100.0 + 10.0 * k, 600.0 - 5.0 * k) for k in range(1, 6)]
    client.move(FIRST)
    for point in points:
        client.move(POINT, point)
    client.move(LAST, points[-1])
    observed = []
    for _ in range(100):
        flags, position, _ = client.status()
        observed.append(position)
        if not flags & 0b0100:
            break
    client.port.pass_time(0.5)
    flags, position, _ = client.status()
    assert flags == 0b0010, "operation, and nothing moves any more"
    assert position == [900.0, -50.0, 575.0]
    positions = [y for _, y, _ in observed]
    assert positions == sorted(positions), "it goes from point to point, never back"

    client.order(STOP_PROGRAM)
    assert client.status()[1] == [900.0, -50.0, 575.0]


def test_stop_ends_movement_under_way(client):
    client.order(MODE, OPERATION)
    client.move(FIRST)
    client.move(POINT, (900.0, 300.0, 600.0), mm_s=100.0)
    client.port.pass_time(0.5)
    assert client.status()[0] == 0b0110, "operation, execution"
    client.order(STOP_PROGRAM)
    client.port.pass_time(1.0)
    flags, position, _ = client.status()
    assert flags == 0b0010
    assert -100.0 < position[1] < 200.0
    client.port.pass_time(1.0)
    assert client.status()[1] == position


def test_order_after_refusal_is_accepted(client):
    with pytest.raises(Refused, match="6"):
        client.move(FIRST)
    with pytest.raises(Refused, match="11"):
        client.order(6, data=b"\x00\x01")
    assert client.status()[0] == 0b0001


def test_blocks_of_specification_are_accepted(client):
    # Section 4, and the answers of the controller.
    for block, answer in (
        ("10 02 00 08 01 00 03 01 00 00 10 03 08", "10 02 00 08 00 00 03 02 00 00 10 03 0A"),
        ("10 02 00 08 01 00 14 01 00 01 10 03 1E", "10 02 00 08 00 00 14 02 00 00 10 03 1D"),
    ):
        client.port.write(ENQ)
        assert client.port.read(1, 2.0) == ACK
        client.port.write(bytes.fromhex(block))
        assert client.port.read(1, 2.0) == ACK
        client.port.write(EOT)
        client.port.received.clear()
        client.hear()
        assert bytes(client.port.received) == ENQ + bytes.fromhex(answer) + EOT


def exchange_block(client, block):
    client.port.write(ENQ)
    assert client.port.read(1, 2.0) == ACK
    client.port.write(bytes.fromhex(block))
    assert client.port.read(1, 2.0) == ACK
    client.port.write(EOT)
    return client.hear()


@pytest.mark.parametrize("block_end", ["length", "trailer"])
def test_blocks_of_real_client_move_robot(block_end):
    """Its last version: the length counts only the data, 52 for a move of 60 bytes, and STX is 82 for an odd number."""
    client = Client(SerialPort(LinkProfile(block_end=block_end)))
    zeros = "00 " * 28
    assert exchange_block(client, "10 02 00 00 01 00 13 01 00 00 10 03 10")[4:6] == bytes((STATUS, RESPONSE))
    assert exchange_block(client, "10 02 00 00 01 00 14 01 00 01 10 03 16")[4:6] == bytes((MODE, RESPONSE))
    # 100 mm/s, run speed 1.0; then 900, -80, 600 mm, tool down
    for block in (
        "10 02 00 34 01 00 18 01 00 02 00 00 00 00 00 02 03 20 20 00" + "00 " * 14 + zeros + "10 03 2C",
        "10 02 00 34 01 00 18 01 00 00 00 00 00 00 00 00 03 20 20 00"
        "1C 20 FD 80 12 C0 00 00 40 00 00 00 00 00" + zeros + "10 03 FF",
        "10 02 00 34 01 00 18 01 00 03 00 00 00 00 00 02 03 20 20 00"
        "1C 20 FD 80 12 C0 00 00 40 00 00 00 00 00" + zeros + "10 03 FE",
    ):
        assert exchange_block(client, block)[4:6] == bytes((MOVE, RESPONSE))
    client.port.pass_time(2.0)
    assert client.status()[:2] == (0b0010, [900.0, -80.0, 600.0])


def test_order_with_unexplained_flag_is_refused(client):
    """Type 11h; the flag is 10h."""
    answer = exchange_block(client, "10 02 00 08 01 00 13 11 00 00 10 03 08")
    assert (answer[4], answer[5], answer[8:]) == (STATUS, REFUSAL, b"\x00\x0b")


def test_block_is_resent_after_nak(client):
    client.port.write(ENQ)
    assert client.port.read(1, 2.0) == ACK
    client.port.write(bytes.fromhex("10 02 00 08 01 00 13 01 00 00 10 03 18"))
    assert client.port.read(1, 2.0) == ACK
    client.port.write(EOT)
    assert client.port.read(1, 2.0) == ENQ
    client.port.write(ACK)
    first = client.port.read(2 + 32 + 3, 2.0)
    client.port.write(NAK)
    assert client.port.read(2 + 32 + 3, 2.0) == first
    client.port.write(ACK)
    assert client.port.read(1, 2.0) == EOT

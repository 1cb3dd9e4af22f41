"""Simple clients of each robot, in this process and in virtual time. Each may have one planted mistake."""

import asyncio
import math
from collections import deque
from collections.abc import Callable
from itertools import count
from typing import Any, NamedTuple

from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.robots.seam import MotionLimits
from hil_bridge.devices.wiring import Wiring
from hil_bridge.lab.conform.client import Where
from hil_bridge.runs.compose import connect_robot
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.devices import robot_at
from hil_bridge.transports import Datagrams, Transport, connect_bytes, listen_datagrams
from protocol.devices.egm import Motors, PoseMm, Rapid, SensorMessage, decode_robot, encode_answer
from protocol.devices.rsi import SENSOR, Telegram, decode, encode, fixed
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.packets import Kind, Reader, inputs_request, outputs_request, version_request
from protocol.devices.rtde.packets import encode as packet
from protocol.devices.rtde.program import INPUT_NAMES, Command, program_text
from protocol.geometry import Pose

SPEED_M_S = 0.01
"""Speed at which all clients move down, m/s. Chosen."""


LATE_CYCLES = 5


class Naive:
    """Client in this process that ends properly when its robot stops."""

    kind = ""
    """Kind of its robot."""
    output = ""
    on_output: Callable[[bytes], object] | None = None

    def __init__(self, mistake: str = "") -> None:
        self.mistake = mistake
        self.clock = Clock.running()
        self.begun_at: float | None = None
        """Time at which its path began."""
        self.answers = 0
        self._newest_at = self.clock.now()
        self._done = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._wires: list[Transport[Any]] = []

    def start(self, where: Where) -> None:
        self._task = asyncio.get_running_loop().create_task(self._run(where.url))

    async def _run(self, url: str) -> None:
        try:
            await self.open(url.partition("+")[2])
            await self._done.wait()
        finally:
            for wire in self._wires:
                await wire.aclose()

    async def open(self, url: str) -> None:
        """Connect to the robot. Responses are sent as its data arrive."""
        raise NotImplementedError

    def take(self, wire: Transport[Any], on_data: Callable[[Any], None]) -> None:
        self._wires.append(wire)
        wire.start(on_data, lambda error: self.end())

    def end(self) -> None:
        self._done.set()

    @property
    def ended(self) -> bool:
        return self._done.is_set()

    def depth(self, period: float) -> float:
        """Return the depth of the path, m, by the number of responses or, as a mistake, by the clock."""
        now = self.clock.now()
        if self.begun_at is None:
            self.begun_at = now
        if self.mistake == "restarts" and now - self._newest_at > 0.5:
            self.answers = 0
        self._newest_at = now
        self.answers += 1
        since = now - self.begun_at if self.mistake == "clock" else (self.answers - 1) * period
        return SPEED_M_S * since * (-1.0 if self.mistake == "upwards" else 1.0)

    def poll(self) -> int | None:
        if self._task is None or not self._task.done():
            return None
        if self._task.cancelled():
            return -15
        return 1 if self._task.exception() else 0

    def ask_to_end(self) -> None:
        self.kill()

    def kill(self) -> None:
        if self._task is not None:
            self._task.cancel()


class EgmClient(Naive):
    """Client that responds to each datagram with a pose."""

    kind = "egm"
    start_pose: PoseMm | None = None

    def __init__(self, mistake: str = "") -> None:
        super().__init__(mistake)
        self._waiting: deque[bytes] = deque()

    async def open(self, url: str) -> None:
        wire = (await listen_datagrams(url, self.clock)).transport
        self.take(wire, lambda datagrams: self._answer(wire, datagrams))

    def _answer(self, wire: Transport[Datagrams], datagrams: Datagrams) -> None:
        packet = decode_robot(bytes(datagrams[-1]))
        is_stopped = packet.motors is not Motors.ON or packet.rapid is not Rapid.RUNNING
        if is_stopped and self.mistake != "blind":
            self.end()
        if self.ended or packet.feedback is None or packet.feedback.pose is None:
            return
        self.start_pose = self.start_pose or packet.feedback.pose
        for _ in range(2 if self.mistake == "two loops" else 1):
            self._waiting.append(encode_answer(self._message(self.start_pose, 1e3 * self.depth(0.004))))
            if self.mistake != "late" or len(self._waiting) > LATE_CYCLES:
                wire.send([self._waiting.popleft()])

    def _message(self, start: PoseMm, depth_mm: float) -> SensorMessage:
        (x, y, z), (a, b, c, d) = start
        number = self.answers // 2 if self.mistake == "two loops" else self.answers
        match self.mistake:
            case "quaternion":
                pose = PoseMm((x, y, z - depth_mm), (b, c, d, a))
            case "metres":
                pose = PoseMm((x / 1e3, y / 1e3, (z - depth_mm) / 1e3), start.quaternion)
            case "from the start":
                pose = PoseMm((0.0, 0.0, -depth_mm), start.quaternion)
            case "mirrored":
                pose = PoseMm((x, y, depth_mm - z), start.quaternion)
            case "speed of 1000 times":
                return SensorMessage(number, 0, start, speed=(0.0, 0.0, -1e6 * SPEED_M_S))
            case _:
                pose = PoseMm((x, y, z - depth_mm), start.quaternion)
        return SensorMessage(1 if self.mistake == "one number" else number, 0, pose)


class RsiClient(Naive):
    """Client that responds to each telegram with a relative correction."""

    kind = "rsi"
    last_ipoc: int | None = None

    async def open(self, url: str) -> None:
        wire = (await listen_datagrams(url, self.clock)).transport
        self.take(wire, lambda datagrams: self._answer(wire, datagrams))

    def _answer(self, wire: Transport[Datagrams], datagrams: Datagrams) -> None:
        packet = decode(bytes(datagrams[-1]))
        if packet.values.get("ProgStatus.R") != "3" and self.mistake != "blind":
            self.end()
        if self.ended:
            return
        step_mm = 1e3 * SPEED_M_S * 0.004
        total_mm = 1e3 * self.depth(0.004)
        values = [0.0, 0.0, -step_mm, 0.0, 0.0, 0.0]
        match self.mistake:
            case "total":
                values[2] = -total_mm
            case "metres":
                values[2] = -step_mm / 1e3
            case "orientation":
                values[3:] = [float(packet.values[f"RIst.{name}"]) for name in "ABC"]
            case "clock":
                last, self.last_mm = self.last_mm, total_mm
                values[2] = last - total_mm
        ipoc = self.last_ipoc if self.mistake == "late" and self.last_ipoc is not None else packet.ipoc
        self.last_ipoc = packet.ipoc
        texts = {f"RKorr.{name}": fixed(value, 6) for name, value in zip("XYZABC", values, strict=True)}
        wire.send([encode(Telegram(SENSOR, "ImFree", texts, ipoc))])

    last_mm = 0.0


LEAVING = b"speedl([0, 0, -0.01, 0, 0, 0], 0.5, 60)\n"


class RtdeClient(Naive):
    """Client that uploads our streaming program, and writes a pose for each package."""

    kind = "rtde"
    start_pose: tuple[float, ...] | None = None
    inputs = INPUT_NAMES
    program = program_text(50, 10.0, 2.0, 0.03).encode() + b"\n"

    async def open(self, url: str) -> None:
        wire, self._script, self._dashboard = [
            await connect_bytes(f"{url}{port}", self.clock) for port in ("", "-script", "-dashboard")
        ]
        self._reader, self._inputs = Reader(), Recipe(1, INPUT_NAMES, (*("DOUBLE",) * 9, "INT32", "INT32"))
        self._outputs = Recipe(1, ("actual_TCP_pose", "safety_mode"), ("VECTOR6D", "INT32"))
        self.take(wire, lambda data: self._answer(wire, data))
        for other in (self._script, self._dashboard):
            self.take(other, lambda data: None)
        for request in (
            version_request(),
            *([inputs_request(self.inputs)] if self.inputs else []),
            outputs_request(("actual_TCP_pose", "safety_mode"), 500.0),
            packet(Kind.START),
        ):
            wire.send(request)
        if self.mistake == "leaves":
            self._script.send(LEAVING)
            await self.clock.sleep_until(self.clock.now() + 0.5)
            self.end()
        else:
            self._script.send(self.program)

    def _answer(self, wire: Transport[bytes], data: bytes) -> None:
        self._reader.feed(data)
        while (packet := self._reader.next_packet()) is not None:
            if packet.kind == Kind.DATA and self.mistake != "leaves" and not self.ended:
                *pose, safety = self._outputs.unpack(packet.payload)
                self._order(wire, pose, safety == 1)

    def _order(self, wire: Transport[bytes], pose: list[float], normal: bool) -> None:
        if not normal and self.mistake == "unlocks":
            self._dashboard.send(b"unlock protective stop\nplay\n")
            return
        if not normal and self.mistake != "blind":
            self.end()
            return
        self.start_pose = self.start_pose or tuple(pose)
        x, y, z, *turn = self.start_pose
        if self.mistake == "degrees":
            turn = [math.degrees(part) for part in turn]
        values = (x, y, z - self.depth(0.002), *turn, 0.002, 0.1, 300.0, Command.SERVO, self.answers)
        wire.send(self._inputs.pack(*values))


class ScriptClient(RtdeClient):
    """Client that sends a script with a constant speed ten times per second."""

    inputs: tuple[str, ...] = ()
    sent_at = -math.inf
    program = b""

    def _order(self, wire: Transport[bytes], pose: list[float], normal: bool) -> None:
        if not normal and self.mistake != "blind":
            self.end()
            return
        if (now := self.clock.now()) - self.sent_at < 0.1:
            return
        self.sent_at = now
        factor = 1e3 if self.mistake == "mm/s" else 1.0
        self._script.send(f"speedl([0, 0, {-factor * SPEED_M_S}, 0, 0, 0], 0.5, 0.3)\n".encode())


SERVO_PROGRAM = b"""def own():
  while True:
    if read_input_integer_register(24) > 0:
      z = read_input_float_register(24)
      q = get_inverse_kin(p[read_input_float_register(25), -0.1, z, d2r(180), 0, 0])
      servoj(q, t=0.008, lookahead_time=0.1, gain=300)
    else:
      sync()
    end
  end
end
"""


class OwnServoClient(RtdeClient):
    """Client that uploads its own program, and writes its registers."""

    inputs = ("input_double_register_24", "input_double_register_25", "input_int_register_24")
    program = SERVO_PROGRAM

    def _order(self, wire: Transport[bytes], pose: list[float], normal: bool) -> None:
        if not normal and self.mistake != "blind":
            self.end()
            return
        self.start_pose = self.start_pose or tuple(pose)
        x, _, z, *_ = self.start_pose
        if self.mistake == "swapped":
            x, z = z, x
        wire.send(Recipe(1, self.inputs, ("DOUBLE", "DOUBLE", "INT32")).pack(z - self.depth(0.002), x, 1))


class S3Client(Naive):
    """Client that moves down over our link."""

    kind = "s3"

    async def _run(self, url: str) -> None:
        config = load_config(None, {"robot.emulated": "s3"})
        robot = await connect_robot(robot_at(config, url), Wiring("robot", self.clock, NullLog()))
        try:
            robot.start()
            (x, y, z), quaternion = (await robot.ready()).pose
            if self.mistake == "quaternion":
                a, b, c, d = quaternion
                quaternion = b, c, d, a
            async with robot.motion(MotionLimits(0.02)) as motion:
                for number in count():
                    z -= 0.02 if number == 14 and self.mistake == "jump" else 0.0
                    await motion.to(Pose((x, y, z - self.depth(0.06)), quaternion))
                    await robot.report()
        finally:
            await robot.aclose()


class Planted(NamedTuple):
    """Mistake, and the scenario in which it is detected."""

    client: type[Naive]
    mistake: str
    words: str
    """Description of the mistake, for the docs."""
    reason: str
    """Part of the verdict's reason; empty for a mistake that the default rules do not detect."""
    scenario: str = "nominal"


W_END = "w of its quaternion seems to be at the wrong end"
LEAP, TURN, WIRE = "orders leap", "rotate the tool abruptly", "violate the protocol"
GOES_ON = "motion orders after the stop"
PLANTED = (
    Planted(EgmClient, "quaternion", "a quaternion x y z w is sent as w x y z", W_END),
    Planted(EgmClient, "metres", "a place in m is sent as mm", LEAP),
    Planted(EgmClient, "from the start", "a place from the start is sent as one in the base", LEAP),
    Planted(EgmClient, "mirrored", "z has the wrong sign", LEAP),
    Planted(EgmClient, "upwards", "the motion leads up instead of down", ""),
    Planted(EgmClient, "one number", "all messages have one sequence number", WIRE),
    Planted(EgmClient, "two loops", "two loops answer each datagram", WIRE),
    Planted(EgmClient, "speed of 1000 times", "a speed in µm/s is sent as mm/s", "exceed the robot's speed"),
    Planted(EgmClient, "late", "each answer is sent five cycles late", ""),
    Planted(EgmClient, "clock", "behind a cut it continues by the clock", LEAP, "cut"),
    Planted(EgmClient, "restarts", "behind a cut it restarts at its first start", LEAP, "cut"),
    Planted(EgmClient, "blind", "it does not look at the robot's states", GOES_ON, "stopped"),
    Planted(RsiClient, "total", "the whole correction is sent to a controller that adds", LEAP),
    Planted(RsiClient, "metres", "a correction in m is sent as mm", "orders moved the tool"),
    Planted(RsiClient, "late", "each answer has the clock of the telegram before", WIRE),
    Planted(RsiClient, "orientation", "the orientation is sent as its correction", TURN),
    Planted(RsiClient, "clock", "behind a cut it continues by the clock", LEAP, "cut"),
    Planted(RsiClient, "blind", "it does not look at the program's status", GOES_ON, "emergency"),
    Planted(RtdeClient, "degrees", "a rotation vector is in degrees", TURN),
    Planted(RtdeClient, "leaves", "it ends while its program moves the tool", "left the tool moving"),
    Planted(RtdeClient, "clock", "behind a cut it continues by the clock", LEAP, "cut"),
    Planted(RtdeClient, "blind", "it does not look at the safety mode", GOES_ON, "stopped"),
    Planted(
        RtdeClient,
        "unlocks",
        "it unlocks a protective stop",
        "released the stop without an operator",
        "stopped",
    ),
    Planted(ScriptClient, "mm/s", "a speed in mm/s is sent as m/s in a script", "exceed the robot's speed"),
    Planted(
        ScriptClient, "blind", "it sends scripts and does not look at the safety mode", GOES_ON, "stopped"
    ),
    Planted(OwnServoClient, "swapped", "two registers of its program are swapped", LEAP),
    Planted(OwnServoClient, "blind", "its own program gets poses behind a stop", GOES_ON, "stopped"),
    Planted(S3Client, "quaternion", "a quaternion x y z w is sent as w x y z", "failed by itself"),
    Planted(S3Client, "jump", "one order of the stream is 20 mm off", LEAP),
)
"""Mistakes by robot."""

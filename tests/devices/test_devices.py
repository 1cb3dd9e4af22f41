"""Client of a robot with misbehaving peers, in virtual time; orders by name, bids and programs."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from emulators.devices.s3 import EMPTY_SITE, S3Controller, S3Profiles, S3Site
from emulators.seams import StartPose
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.robots.s3.link import S3Link
from hil_bridge.devices.robots.s3.orders_file import parse_orders
from hil_bridge.devices.robots.seam import MotionLimits
from hil_bridge.errors import DeviceError, OrderRefused, TransportEnded
from hil_bridge.transports import connect_bytes, listen_bytes
from hil_bridge.transports.pump import Pump
from protocol.devices.s3.adlp import Link, LinkProfile, MessageReceived, Role
from protocol.devices.s3.arap import Mode, ProgramAnswer, Telegram, TelegramType, read_status, write_mode
from protocol.endpoint import LocalProtocolError
from protocol.geometry import Pose
from tests.runs.kept_notices import Notices


def robot_failure(answer: Callable[[bytes], bytes], hang_up_at: float | None = None) -> tuple[str, float]:
    """Return the error of a status request to a peer that always gives this answer, and the time until the error."""

    async def main() -> tuple[str, float]:
        clock = Clock.running()
        peer = (await listen_bytes("memory:s3", clock)).transport

        def send_answer(data: bytes) -> None:
            if reply := answer(data):
                peer.send(reply)

        peer.start(send_answer, lambda cause: None)
        robot = S3Link(await connect_bytes("memory:s3", clock), LinkProfile(), clock, NullLog())
        robot.start()
        began = clock.now()
        if hang_up_at is not None:
            clock.call_at(began + hang_up_at, lambda: clock.loop.create_task(peer.aclose()))
        try:
            with pytest.raises((DeviceError, TransportEnded)) as caught:
                await robot.read_status()
            elapsed_s = clock.now() - began
            if hang_up_at is not None:
                with pytest.raises(TransportEnded):  # and no task waits for a dead wire again
                    await robot.read_status()
                assert clock.now() - began == elapsed_s
        finally:
            await robot.aclose()
            await peer.aclose()
        return str(caught.value), elapsed_s

    return run_virtual(main)


def test_silent_robot_reports_remedy_after_three_bids() -> None:
    text, elapsed_s = robot_failure(lambda data: b"")
    silent = "robot on memory:s3: nothing received after 3 bids (ENQ)"
    assert text.startswith(f"{silent}; this end is set to 9600 8E1; check cable and power, ")
    assert elapsed_s == pytest.approx(6.0, abs=0.1)


def test_noise_on_link_reports_parity_and_rate() -> None:
    text, _ = robot_failure(lambda data: bytes(byte ^ 0xFF for byte in data))
    assert text.endswith(
        " meaningless bytes; this end is set to 9600 8E1; check the rate and the parity on both sides"
    )


def test_link_events_are_reported_by_name() -> None:
    """The link's log receives each bid and ACK; the operator, only what is unusual."""
    answers = iter((b"\x06", b"\x15", b"\x06"))
    notices, events = [], []

    class NoticeLog(NullLog):
        verbose = True

        def notice(self, kind: str, text: str) -> None:
            notices.append((kind, text))

        def link_event(self, device: str, text: str) -> None:
            assert device == "robot"
            events.append(text)

    async def main() -> None:
        clock = Clock.running()
        peer = (await listen_bytes("memory:s3", clock)).transport
        peer.start(lambda data: peer.send(next(answers, b"")), lambda cause: None)
        robot = S3Link(
            await connect_bytes("memory:s3", clock),
            LinkProfile(order_timeout_s=0.5),
            clock,
            NoticeLog(),
        )
        robot.start()
        try:
            with pytest.raises(DeviceError, match="no answer telegram within"):
                await robot.read_status()
        finally:
            await robot.aclose()
            await peer.aclose()

    run_virtual(main)
    assert notices == [("link", "NAK received: block refused"), ("link", "block repeated: repeat 1")]
    assert events == [
        "bid sent: ENQ",
        "ACK received: bid acknowledged",
        *(text for _, text in notices),
        "ACK received: block acknowledged",
    ]


def test_link_with_ended_wire_fails_at_once() -> None:
    text, elapsed_s = robot_failure(lambda data: b"", hang_up_at=0.5)
    assert "the peer closed" in text
    assert elapsed_s == pytest.approx(0.5, abs=0.01)


SITE = """
[read_register]
function = 6
order = [{ name = "number", byte = 8, type = "u16" }]
answer = [{ name = "value", byte = 8, type = "s16", scale = 0.5, unit = "V" }]
emulator = { memory = "register", key = ["number"], initial = { value = 1.5 } }
[write_register]
function = 14
order = [
    { name = "number", byte = 8, type = "u16" },
    { name = "value", byte = 10, type = "s16", scale = 0.5, unit = "V" },
]
emulator = { memory = "register", key = ["number"] }
[send_program]
function = 1
blocks = "several"
order = [{ name = "program", byte = 8, type = "u16" }, { name = "content", byte = 10, type = "bytes" }]
emulator = { memory = "sent", key = ["program"] }
[note]
function = 25
order = [{ name = "text", byte = 8, type = "bytes" }]
[read_speed]
function = 19
extends = true
answer = [{ name = "override", byte = 32, type = "u8" }]
emulator = { initial = { override = 80 } }
"""
ORDERS = parse_orders(SITE, LinkProfile().max_telegram)

Robot = Callable[[S3Link, Clock], Awaitable[None]]


def with_robot(
    script: Robot, site: S3Site = EMPTY_SITE, *, link: LinkProfile | None = None, cuts: bool = False
) -> list[str]:
    """Run a script with the emulated robot on a 9600 baud line; return the notices of its client.

    With `cuts`, a block may be cut short at the first DLE ETX.
    """
    log = Notices()
    controllers = S3Profiles(link=LinkProfile(block_end="trailer" if cuts else "length"))

    async def main() -> None:
        clock = Clock.running()
        position, down = (0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0)
        controller = S3Controller(controllers, StartPose(position, down, 0.2), clock.now(), 1, site)
        port = (await listen_bytes("memory:s3", clock)).transport
        Pump(controller, port, clock, lambda event: None, lambda cause: None).start()
        wire = await connect_bytes("memory:s3?baudrate=9600&parity=E", clock)
        robot = S3Link(wire, link or LinkProfile(), clock, log, site.orders)
        robot.start()
        try:
            await script(robot, clock)
        finally:
            await robot.aclose()
            await port.aclose()

    run_virtual(main)
    return [text for _, text in log.notices]


def test_orders_are_sent_by_name_with_values_in_units() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        assert await robot.order("read_register", number=3) == {"value": 1.5}
        assert await robot.order("write_register", number=3, value=-2.0) == {}
        assert await robot.order("read_register", number=3) == {"value": -2.0}
        assert await robot.order("write_mode", suffix=Mode.OPERATION) == {}
        status = await robot.order("read_status")
        assert (status["x"], status["flags_17"]) == (0.9, 2)
        assert await robot.order("read_speed") == {**status, "override": 80}
        assert (await robot.read_status()).operation

    with_robot(script, S3Site(ORDERS))


def test_cancelled_order_completes_before_next_order() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        ended: list[str] = []

        async def order(name: str) -> None:
            await robot.order(name)
            ended.append(name)

        first, *others = [
            asyncio.create_task(order(name)) for name in ("read_status", "stop_program", "write_mode")
        ]
        await clock.sleep_until(clock.now() + 0.005)
        first.cancel()
        others[1].cancel()
        await asyncio.gather(first, *others, return_exceptions=True)
        assert ended == ["stop_program"]
        assert robot.counters["messages sent"] == robot.counters["messages received"] == 2

    with_robot(script)


def test_announced_order_uses_early_bid() -> None:
    character = 11 / 9600

    async def script(robot: S3Link, clock: Clock) -> None:
        await robot.read_status()
        assert robot.transmitted_at - robot.begun_at == pytest.approx((1 + 1 + 13 + 1 + 1) * character)
        await robot.read_status(soon=True)
        granted_at = clock.now() + 0.01  # meanwhile ENQ and ACK cross the line
        await clock.sleep_until(granted_at)
        await robot.read_status()
        assert robot.begun_at == granted_at
        assert robot.transmitted_at - granted_at == pytest.approx((13 + 1 + 1) * character)
        assert (robot.counters["bid sent"], robot.counters["line released"]) == (3, 0)

    with_robot(script)


HIT_M = 0x1003 / 8000
"""Coordinate whose encoding is DLE ETX, m."""


DOWN = (0.0, 1.0, 0.0, 0.0)
SLOW = MotionLimits(0.05, 1.0, 1.0)


def test_position_with_block_trailer_is_shifted_by_one_step() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        await robot.ready()
        async with robot.motion(SLOW) as motion:
            for height in (HIT_M, HIT_M - 1e-5, HIT_M + 1e-5):
                await motion.to(Pose((0.9, -0.1, height), DOWN))
                await clock.sleep_until(clock.now() + 3.0)
                reached = (await robot.read_status()).position[2]
                assert reached != HIT_M
                assert abs(reached - height) <= 0.125e-3 + 1e-9
            assert motion.commanded == (0.9, -0.1, HIT_M + 1e-5)
        # three points; the movement ends at the last
        assert (robot.counters["10 03 avoided"], robot.counters["10 03 in data"]) == (4, 0)

    assert with_robot(script, cuts=True) == []


def test_unshifted_block_trailer_fails_with_reason() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        await robot.ready()
        with pytest.raises(DeviceError, match="10 03 in data 1"):
            async with robot.motion(SLOW) as motion:
                await motion.to(Pose((0.9, -0.1, HIT_M), DOWN))

    notices = with_robot(script, link=LinkProfile(avoid_trailer=False), cuts=True)
    assert sum(text.startswith("10 03 in data: a controller that ends a block") for text in notices) == 1


def test_unavoidable_trailer_is_counted_and_noted_rarely() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        for _ in range(5):
            with pytest.raises(OrderRefused):
                await robot.order("start_program", program=0x1003)
        await clock.sleep_until(clock.now() + 61.0)
        with pytest.raises(OrderRefused):
            await robot.order("start_program", program=0x1003)
        assert robot.counters["10 03 in data"] == 6

    assert [text.partition(":")[0] for text in with_robot(script)] == ["10 03 in data"] * 2


def test_early_bid_is_not_sent_if_disabled() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        robot.profile = LinkProfile(bid_ahead=False)
        await robot.read_status(soon=True)
        await clock.sleep_until(clock.now() + 0.1)
        assert robot.counters["bid sent"] == 1
        assert not (await robot.read_status()).emergency_stop

    with_robot(script)


def test_early_bid_is_not_sent_after_cancelled_order() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        with pytest.raises(OrderRefused):
            await robot.exchange(Telegram(TelegramType.ORDER, 99, 0), soon=True)
        cancelled = asyncio.create_task(robot.read_status(soon=True))
        await clock.sleep_until(clock.now() + 0.005)
        cancelled.cancel()
        await clock.sleep_until(clock.now() + 5.0)
        assert (robot.counters["bid sent"], robot.counters["messages received"]) == (2, 2)

    with_robot(script)


def test_early_bid_without_order_releases_line() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        await robot.read_status(soon=True)
        await clock.sleep_until(clock.now() + 5.0)
        assert robot.counters["line released"] == 1
        assert (await robot.read_status()).emergency_stop is False

    with_robot(script)


def test_invalid_order_is_refused_before_sending() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        for name, values, message in (
            ("read_regster", {}, "unknown order 'read_regster'; did you mean read_register?"),
            ("read_register", {"nmber": 3}, "read_register order has no field nmber: it has number"),
            ("read_register", {"number": 65536}, "read_register order: number = 65536 is outside 0 … 65535"),
            ("write_register", {"value": 1e5}, "value = 100000 is outside -16384 … 16383.5 V"),
            ("note", {"text": bytes(121)}, "note: a telegram of 129 bytes is too long for a block of 128"),
            ("read_register", {"suffix": 4}, "read_register has no suffix 4, only 0"),
        ):
            with pytest.raises(LocalProtocolError) as caught:
                await robot.order(name, **values)
            assert message in str(caught.value)
        with pytest.raises(
            LocalProtocolError, match="a telegram of 130 bytes is too long for a block of 128"
        ):
            await robot.order(Telegram(1, 1, 0, bytes(122)))
        assert not any(robot.counters.values())
        assert await robot.order("note", text=bytes(120)) == {}

    with_robot(script, S3Site(ORDERS))


def test_long_order_is_sent_in_several_blocks() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        assert await robot.order("send_program", program=7, content=bytes(range(256))) == {}
        assert robot.counters["blocks sent"] == 3
        assert robot.counters["messages sent"] == 1

    with_robot(script, S3Site(ORDERS))


def test_order_unknown_to_controller_reports_remedy() -> None:
    async def script(robot: S3Link, clock: Clock) -> None:
        with pytest.raises(
            OrderRefused, match="refused order 6: 11 wrong function code; this controller does"
        ):
            await robot.order(Telegram(6, 1, 0, b"\0\3"))
        await robot.order(write_mode(Mode.OPERATION))

    with_robot(script)


def test_program_is_received_in_many_blocks() -> None:
    content = bytes(range(256)) * 4

    async def script(robot: S3Link, clock: Clock) -> None:
        began = clock.now()
        assert await robot.receive_program(7) == content
        # 1028 bytes of data in 9 blocks of 13 bytes more, 11 bit times a character, and each block's ACK.
        assert clock.now() - began > (1028 + 9 * (13 + 1)) * 11 / 9600
        assert robot.counters["blocks received"] == 9
        with pytest.raises(OrderRefused, match="7 no such program; select a program"):
            await robot.receive_program(8)
        with pytest.raises(LocalProtocolError):
            await robot.receive_program(65536)

    with_robot(script, S3Site(programs={7: content}))


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (ProgramAnswer(7, b"", 5).to_telegram(), "did not send program 7: error 5"),
        (ProgramAnswer(8, b"").to_telegram(), "sent program 8, not 7"),
        (
            Telegram(29, 2, 0, b"\0", True),
            "sent an invalid answer: program answer needs 4 bytes of data, got 1",
        ),
    ],
)
def test_missing_or_wrong_program_is_error(answer: Telegram, message: str) -> None:
    with pytest.raises(DeviceError, match="robot on memory:s3") as caught:
        client_result(answer, lambda robot: robot.receive_program(7))
    assert message in str(caught.value)


def test_short_answer_is_device_error() -> None:
    short = Telegram(19, 2, 0, bytes(20), True)
    for request in (S3Link.read_status, lambda robot: robot.order("read_status")):
        with pytest.raises(
            DeviceError, match="sent an invalid answer: status needs 24 bytes of data, got 20"
        ):
            client_result(short, request)
    assert client_result(short, lambda robot: robot.order(read_status())) == short


def client_result(answer: Telegram, request: Callable[[S3Link], Awaitable[object]]) -> object:
    """Return the result of the client for a robot that gives this answer to every order."""

    class SetpointResponder(Link):
        def next_event(self) -> None:
            while (event := super().next_event()) is not None:
                if isinstance(event, MessageReceived):
                    self.send([answer.encode()])

    async def main() -> object:
        clock = Clock.running()
        port = (await listen_bytes("memory:s3", clock)).transport
        Pump(
            SetpointResponder(Role.ROBOT, LinkProfile()), port, clock, lambda event: None, lambda cause: None
        ).start()
        robot = S3Link(await connect_bytes("memory:s3", clock), LinkProfile(), clock, NullLog())
        robot.start()
        try:
            return await request(robot)
        finally:
            await robot.aclose()
            await port.aclose()

    return run_virtual(main)

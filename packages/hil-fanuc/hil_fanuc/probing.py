"""Probe of a controller: its versions, its limits and its state. Nothing is started, stopped or changed.

No stop packet is sent, because it would end the session of another client, and no start packet, because it would raise
an alarm. The session of the Remote Motion Interface is held for the time of the probe.

`hil-bridge doctor` probes the Remote Motion Interface alone.
"""

import asyncio
from collections.abc import Sequence
from typing import Any

from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.robots.probe import FIRST_S, ProbeResult
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import DeviceError, TransportUnavailable
from hil_bridge.errors.failures import link_cause
from hil_bridge.transports.pump import Pump
from hil_fanuc import rmi
from hil_fanuc.arms import MODELS
from hil_fanuc.channels import Channel, Ended, OpenSession, Piece, Pieces
from hil_fanuc.packets import Limit, decode_to_client
from hil_fanuc.requests import Failed, Request, Script
from hil_fanuc.settings import FanucSettings
from hil_fanuc.startup import TEST_MODES, Controller, Startup
from hil_fanuc.wires import connect_wires
from protocol.endpoint import NO_TROUBLE, RemoteProtocolError, Trouble
from protocol.outbox import Mailbox

_TIMES = 2.5
"""Duration of a probe, as a multiple of the time for the first answer. Chosen."""


class Done:
    """Event that reports the end of a probe."""


class Prober(Mailbox[Piece | OpenSession, Done]):
    """Endpoint that carries out the script of a probe."""

    def __init__(self, settings: FanucSettings, now: float, asks_stream: bool) -> None:
        """Begin the script. `asks_stream` says whether it asks over Stream Motion too."""
        super().__init__()
        self._startup, self._asks_stream = Startup(settings), asks_stream
        self._lines = {Channel.DOOR: rmi.LineReader(), Channel.SESSION: rmi.LineReader()}
        self.failure = NO_TROUBLE
        self.answers: dict[str, rmi.Message] = {}
        self._script: Script | None = self._run()
        self._request: Request | None = None
        self._advance(None, now)

    @property
    def controller(self) -> Controller:
        """What was learnt about the controller."""
        return self._startup.controller

    def _run(self) -> Script:
        if self._asks_stream:
            try:
                yield from self._startup.read_facts()
            except Failed as failed:
                self.failure = failed.trouble
        yield from self._startup.connect()
        for name in ("FRC_GetStatus", "FRC_ReadError", "FRC_ReadJointAngles", "FRC_ReadCartesianPosition"):
            self.answers[name] = yield from self._startup.requests.line({"Command": name})

    def receive(self, data: Pieces, now: float) -> None:
        for piece in data:
            if isinstance(piece, Ended) and self._request is not None:
                if piece.channel is Channel.DOOR and self.controller.has_port:
                    continue
                self._finish(Trouble(f"its Remote Motion Interface has ended the connection: {piece.text}"))
            elif isinstance(piece, Piece):
                for answer in self._answers(piece):
                    request = self._request
                    if request is not None and request.accepts is not None and request.accepts(answer):
                        self._advance(answer, now)

    def _answers(self, piece: Piece) -> Sequence[Any]:
        try:
            if piece.channel is Channel.STREAM:
                return [decode_to_client(piece.data)]
            return list(self._lines[piece.channel].feed(piece.data))
        except RemoteProtocolError:
            return []

    def handle_deadline(self, now: float) -> None:
        request = self._request
        if request is None or self._due is None or now < self._due:
            return
        if request.accepts is None:
            self._advance(None, now)
            return
        assert self._script is not None
        try:  # the script continues without Stream Motion
            self._begin(self._script.throw(Failed(request.late)), now)
        except StopIteration:
            self._finish(NO_TROUBLE)
        except Failed as failed:
            self._finish(failed.trouble)

    def _advance(self, answer: Any, now: float) -> None:
        assert self._script is not None
        try:
            self._begin(self._script.send(answer), now)
        except StopIteration:
            self._finish(NO_TROUBLE)
        except Failed as failed:
            self._finish(failed.trouble)

    def _begin(self, request: Request, now: float) -> None:
        self._request, self._due = request, now + request.patience_s
        self._out += request.pieces

    def _finish(self, failure: Trouble) -> None:
        self.failure = self.failure or failure
        self._request = self._due = None
        self._out.append(Piece(Channel.SESSION, rmi.encode({"Communication": "FRC_Disconnect"})))
        self._events.append(Done())


async def probe(url: str, settings: Any, wiring: Wiring) -> ProbeResult:
    """Probe the controller at a URL. Raises TransportUnavailable if a wire cannot be opened, DeviceError if nothing
    answers.
    """
    return await _read(url, settings.client, wiring, asks_stream=True)


async def ask_interface(url: str) -> ProbeResult:
    """Probe the Remote Motion Interface of the controller at a URL. Raises DeviceError if it does not answer."""
    clock = Clock.running()
    try:
        return await _read(url, FanucSettings(), Wiring("robot", clock, NullLog()), asks_stream=False)
    except TransportUnavailable as error:
        raise DeviceError(f"its Remote Motion Interface: {error.fact}", remedy=error.remedy) from error
    finally:
        clock.close()


async def _read(url: str, client: FanucSettings, wiring: Wiring, asks_stream: bool) -> ProbeResult:
    wires = await connect_wires(url, wiring)
    prober = Prober(client, wiring.clock.now(), asks_stream)
    done: asyncio.Future[None] = wiring.clock.loop.create_future()

    def finish(event: object) -> None:
        if not done.done():
            done.set_result(None)

    def fail(cause: BaseException) -> None:
        if not done.done():
            error = DeviceError(f"robot on {wires.name}: {cause}", cause=link_cause(cause))
            done.set_exception(error)

    pump: Pump[Any, Any] = Pump(prober, wires, wiring.clock, finish, fail)
    try:
        pump.start()
        async with asyncio.timeout(_TIMES * FIRST_S):
            await done
    except TimeoutError:
        raise DeviceError(f"robot on {wires.name} does not answer", remedy="check its address") from None
    finally:
        await wires.aclose()
    if not prober.answers and not prober.controller.thresholds:
        raise DeviceError(f"robot on {wires.name}: {prober.failure.fact}", remedy=prober.failure.remedy)
    return ProbeResult(tuple(_rows(prober, client)), tuple(_refusals(prober)))


def _rows(prober: Prober, client: FanucSettings) -> list[tuple[str, str]]:
    controller = prober.controller
    stream = f"Stream Motion {controller.version}, " if controller.interval_ms else ""
    rows = [("robot", f"FANUC, {stream}RMI {controller.rmi_version or 'unknown'}")]
    if controller.interval_ms:
        rows.append(("sampling period", f"{controller.interval_ms} ms"))
    for limit, unit in zip(Limit, ("°/s", "°/s²", "°/s³"), strict=True):
        values = [table.no_load[-1] for (_, kind), table in controller.thresholds.items() if kind == limit][
            :6
        ]
        if values:
            rows.append((f"limits of {limit.name.lower()}", f"{' '.join(f'{v:g}' for v in values)} {unit}"))
    own, speeds = MODELS[client.model].speeds_deg_s, controller.speeds_deg_s
    if len(speeds) == len(own):
        rows.append(("model", f"{client.model}{'' if speeds == own else ', whose joints have other speeds'}"))
    position = prober.answers.get("FRC_ReadCartesianPosition", {}).get("Position", {})
    if position:
        rows.append(("position", " ".join(f"{position.get(axis, 0.0):.1f}" for axis in "XYZ") + " mm, world"))
    error = prober.answers.get("FRC_ReadError", {}).get("ErrorData")
    rows.append(("alarm", str(error or "unknown")))
    return rows


def _refusals(prober: Prober) -> list[Trouble]:
    refusals = [prober.failure] if prober.failure else []
    status = prober.answers.get("FRC_GetStatus", {})
    if status.get("TPMode") in TEST_MODES:
        refusals.append(
            Trouble("its teach pendant is on, or it is not in AUTO", "select AUTO, switch the pendant off")
        )
    if status.get("ServoReady") == 0:
        refusals.append(Trouble("its servos are off", "release stops, and clear its alarms"))
    return refusals

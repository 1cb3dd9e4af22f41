"""Start of a session, in the order of the maker's client: Remote Motion Interface, stop packet, capability,
thresholds, TP program, start packet.

A stop packet ends the session of another client. It is therefore sent only after the second connection of the Remote
Motion Interface has answered, because the controller serves one client there (observed: airo-ugent/airo-fanuc, 1.4,
1.8).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

from hil_fanuc import rmi
from hil_fanuc.channels import Channel, OpenSession
from hil_fanuc.limits import LimitTable
from hil_fanuc.model_check import read_misfit
from hil_fanuc.packets import (
    Capability,
    ForceSensor,
    GpioRequest,
    GpioResult,
    Kind,
    Limit,
    Signal,
    Threshold,
    ThresholdRequest,
)
from hil_fanuc.requests import Failed, Request, Requests, Script, error_of, is_ready, number_of
from hil_fanuc.settings import FanucSettings
from protocol.endpoint import Trouble

FIRST_VERSION = 3
"""Version in which a client asks for the capability."""
_PAUSE_S = 0.05
"""Pause after a packet without an answer, s. Chosen."""
_AXES = 9
TEST_MODES = 1, 3
"""Values of TPMode for T1 and T2. Observed: a controller in AUTO reports 0, others 2."""
_SENSORS: Mapping[str, int] = {"built-in": 1, "external": 2}
_OTHER_CLIENT = Trouble(
    "the second connection of its Remote Motion Interface does not answer: another client holds it",
    "end the other client; if it hangs, kill it",
)
_TO_AUTO = "select AUTO, switch the teach pendant off, clear alarms, and end running programs"


@dataclass
class Controller:
    """What a client has learnt about its controller."""

    version: int
    interval_ms: int = 0
    """Sampling period, ms; 0 if unknown."""
    max_speed_mm_s: int = 0
    thresholds: dict[tuple[int, int], Threshold] = field(default_factory=dict)
    rmi_version: str = ""
    has_port: bool = False
    """Whether the first door has named the port of the session. The controller may then close the door."""
    status: rmi.Message = field(default_factory=dict)
    """Newest answer to FRC_GetStatus."""
    streams: bool = False
    """Whether the start packet was sent."""

    @property
    def limits(self) -> LimitTable:
        """Limits of the joints."""
        return LimitTable(self.thresholds)

    @property
    def speeds_deg_s(self) -> tuple[float, ...]:
        """Largest speeds of the joints of the arm, °/s, as far as the thresholds have been read."""
        tables = (self.thresholds.get((axis, Limit.SPEED)) for axis in range(1, 7))
        return tuple(table.no_load[-1] for table in tables if table is not None)


class Startup:
    """Scripts of a client's start."""

    def __init__(self, settings: FanucSettings) -> None:
        self._settings = settings
        self.requests = Requests(settings.answer_s)
        self.controller = Controller(settings.version or FIRST_VERSION)

    def run(self) -> Script:
        """Begin to stream. Raises Failed if the controller does not become ready."""
        yield from self.connect()
        yield from self._check_model()
        yield from self.requests.send(Signal(Kind.STOP, self.controller.version), _PAUSE_S)
        yield from self.read_facts()
        yield from self._choose_reports()
        yield from self._initialize()
        yield from self._start()

    def connect(self) -> Script:
        """Open both connections of the Remote Motion Interface."""
        requests = self.requests
        answer = yield from requests.line({"Communication": rmi.CONNECT}, Channel.DOOR)
        if number := error_of(answer):
            raise Failed(
                Trouble(f"it refuses {rmi.CONNECT}: {rmi.describe_error(number)}", _OTHER_CLIENT.remedy)
            )
        self.controller.rmi_version = f"{answer.get('MajorVersion', '?')}.{answer.get('MinorVersion', '?')}"
        self.controller.has_port = True
        session = OpenSession(number_of(answer, "PortNumber"))
        status = yield from requests.line({"Command": "FRC_GetStatus"}, first=(session,), late=_OTHER_CLIENT)
        self.controller.status = status

    def _check_model(self) -> Script:
        """Raise Failed if joints and position that the controller reports do not fit the model. Changes nothing."""
        model = self._settings.model
        apart = yield from read_misfit(self.requests, model)
        if apart:
            raise Failed(
                Trouble(
                    f"its face plate is {apart * 1e3:.1f} mm from where a {model} with its joints has it",
                    "set robot.fanuc.model; if it is right, check its user and tool frames",
                )
            )

    def read_facts(self) -> Script:
        """Read capability and thresholds. Changes nothing."""
        controller, requests = self.controller, self.requests
        if not self._settings.version:
            request = Capability(Kind.GET_CAPABILITY, FIRST_VERSION)
            answer = yield from requests.packet(request, _is(Kind.GET_CAPABILITY), "capability request")
            controller.version = max(answer.available_version, FIRST_VERSION)
            controller.interval_ms = answer.sampling_ms
            self._check_interval()
        for axis in range(1, _AXES + 1):
            for limit in Limit:
                ask = ThresholdRequest(controller.version, axis, limit)
                answer = yield from requests.packet(
                    ask, partial(_answers, ask), f"request of the thresholds of axis {axis}"
                )
                controller.thresholds[axis, limit] = answer
        controller.max_speed_mm_s = answer.speed_mm_s
        controller.interval_ms = controller.interval_ms or answer.interval_ms
        self._check_interval()

    def _check_interval(self) -> None:
        interval, own = self.controller.interval_ms, self._settings.cycle_ms
        if interval and interval != own:
            raise Failed(
                Trouble(
                    f"it samples every {interval} ms, and robot.fanuc.cycle_ms is {own:g}",
                    f"set robot.fanuc.cycle_ms = {interval}",
                )
            )

    def _choose_reports(self) -> Script:
        """Choose the reported point and the buffer of set points, from version 3 on."""
        settings, version = self._settings, self.controller.version
        if version >= FIRST_VERSION:
            setting = Capability(
                Kind.SET_CAPABILITY,
                version,
                start_move=settings.start_move,
                reports_tcp=int(settings.reports == "tcp"),
            )
            yield from self.requests.packet(setting, _is(Kind.SET_CAPABILITY), "choice of its reports")

    def _initialize(self) -> Script:
        requests, controller = self.requests, self.controller
        if controller.status.get("TPMode") in TEST_MODES:
            raise Failed(Trouble("its teach pendant is on, or it is not in AUTO", _TO_AUTO))
        yield from requests.line({"Command": "FRC_Abort"})
        yield from requests.done({"Command": "FRC_Reset"}, _TO_AUTO)
        yield from requests.done({"Command": "FRC_Initialize", "GroupMask": 1}, _TO_AUTO)
        controller.status = yield from requests.done({"Command": "FRC_GetStatus"}, _TO_AUTO)

    def _start(self) -> Script:
        """Call the TP program, send the start packet, and wait until the controller is ready."""
        settings, requests, controller = self._settings, self.requests, self.controller
        if controller.version >= FIRST_VERSION:
            gpio = GpioRequest(controller.version, ())
            answer = yield from requests.packet(
                gpio, lambda one: isinstance(one, GpioResult), "GPIO configuration"
            )
            if answer.result:
                raise Failed(
                    Trouble(f"it refuses the GPIO configuration with {answer.result}", "check its I/O")
                )
        call: rmi.Message = {
            "Instruction": "FRC_Call",
            "SequenceID": number_of(controller.status, "NextSequenceID"),
            "ProgramName": settings.program,
        }
        yield from requests.done(call, _TO_AUTO)
        yield from requests.send(Signal(Kind.START, controller.version), 0.0)
        controller.streams = True
        if settings.sensor in _SENSORS and controller.version >= 4:
            yield from requests.send(ForceSensor(controller.version, 1, _SENSORS[settings.sensor]), 0.0)
        late = Trouble(
            f"it is not ready for commands {settings.ready_s:g} s after the start packet", _TO_AUTO
        )
        yield Request((), is_ready, settings.ready_s, late)


def _is(kind: Kind) -> Callable[[object], bool]:
    return lambda answer: isinstance(answer, Capability) and answer.kind == kind


def _answers(request: ThresholdRequest, answer: object) -> bool:
    return isinstance(answer, Threshold) and (answer.axis, answer.limit) == (request.axis, request.limit)

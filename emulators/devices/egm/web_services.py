"""Robot Web Services 1.0 of an emulated ABB controller: its answers to requests, independent of port and clock.

Requests have the same effect as actions at the panel. Switching the motors off, or stopping RAPID, ends the
guidance. Starting RAPID resumes the guidance where it ended, or begins another session after a reset of the program
pointer. `operation` implements these actions.

Source: resources, actions, forms and status codes of abb_librws (9ba0837). Assumed: the status codes of requests
that this library does not make; in a manual mode only the operator at the robot controls motors, speed and RAPID,
and such requests are refused.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple
from urllib.parse import parse_qsl, unquote, urlsplit

from emulators.devices.egm import operation
from emulators.devices.egm.controller import EgmController
from emulators.devices.egm.profile import EgmProfile
from emulators.devices.egm.state import EMERGENCY_STOP, MOTORS_OFF, Key, State
from emulators.devices.egm.web_configuration import TASK, UNIT, make_documents
from emulators.devices.egm.web_documents import JSON, XHTML, Item, write_json, write_xhtml
from emulators.devices.egm.web_subscriptions import Subscriptions
from protocol.devices.egm import to_wire

BODY_MAX = 65_536
"""Maximum size of a request's body, bytes. Chosen."""
FIELDS_MAX = 512
"""Maximum number of fields in a form. Chosen."""
VALUE_MAX = 1024
"""Maximum number of characters in a value that a client writes. Chosen."""
_NO_AXIS = "8.9999995E+09"
"""Value of an external axis that does not exist."""
_EXTERNAL = {f"eax_{letter}": _NO_AXIS for letter in "abcdef"}
_EXTERNAL_OF_TARGET = {f"eax{letter}": _NO_AXIS for letter in "abcdef"}
"""External axes of a robtarget under the names that abb_robot_client reads; abb_librws reads the names in
`_EXTERNAL`. Both are sent [A].
"""
_SIGNALS = "/rw/iosystem/signals"
_DATA, _PROPERTIES = "/rw/rapid/symbol/data/rapid", "/rw/rapid/symbol/properties/rapid"
_STATE, _ACTION = f"{TASK}/TRobMain/current_state", f"{TASK}/TRobEGM/current_action"
_IDLE, _RUNS_EGM = 0, 3
"""Values of `current_state`. Source: abb_librws, enum States."""
_ACTIONS = {"joint": 1, "pose": 2}
"""Values of `current_action`. Source: abb_librws, enum EGMActions."""


class WebAnswer(NamedTuple):
    """Answer to a request."""

    status: int
    body: bytes = b""
    kind: str = XHTML
    headers: Mapping[str, str] = {}


class _Refusal(Exception):
    """Request that is answered with an error."""

    def __init__(self, status: int, text: str) -> None:
        super().__init__(text)
        self.answer = WebAnswer(status, write_xhtml([Item("error", "error", {"msg": text})], "status"))


class WebServices:
    """Answers of one controller to web requests."""

    def __init__(self, controller: EgmController, profile: EgmProfile) -> None:
        self._controller, self._profile = controller, profile
        self._documents = make_documents(profile)
        self._signals = dict.fromkeys(
            ("EGM_START_JOINT", "EGM_START_POSE", "EGM_START_STREAM", "EGM_STOP", "EGM_STOP_STREAM"), "0"
        )
        self._signals |= dict.fromkeys(("RUN_RAPID_ROUTINE", "OUTPUT_STATIONARY", "WD_STOP_REQUEST"), "0")
        self._symbols = {
            f"{TASK}/TRobRAPID/routine_name_input": ("string", '""'),
            f"{TASK}/TRobRAPID/move_speed_input": ("speeddata", "[100,10,100,10]"),
            f"{TASK}/TRobUtility/base_frame": ("pose", "[[0,0,0],[1,0,0,0]]"),
        }
        self.subscriptions = Subscriptions(self._find_event)

    def answer(self, method: str, target: str, body: str, now: float) -> WebAnswer:
        """Answer a request of an authorised client. `target` consists of path and query; `body` is a form."""
        try:
            return self._answer(method, target, body, now)
        except _Refusal as refusal:
            return refusal.answer

    def _answer(self, method: str, target: str, body: str, now: float) -> WebAnswer:
        try:
            parts = urlsplit(target)
            query = dict(parse_qsl(parts.query, max_num_fields=FIELDS_MAX))
            form = parse_qsl(body, keep_blank_values=True, max_num_fields=FIELDS_MAX)
        except ValueError as error:
            raise _Refusal(400, "cannot read the request") from error
        path = unquote(parts.path).rstrip("/")
        if path == "/subscription" or path.startswith("/subscription/"):
            return self._subscribe(method, path, form, now)
        if method == "GET":
            items = self._items(path, query, now)
            if query.get("json") == "1":
                return WebAnswer(200, write_json(items), JSON)
            return WebAnswer(200, write_xhtml(items))
        if method != "POST":
            raise _Refusal(405, f"method {method} is not supported here")
        self._act(path, query.get("action", ""), dict(form), now)
        return WebAnswer(204)

    # --- documents

    def _items(self, path: str, query: Mapping[str, str], now: float) -> Sequence[Item]:
        low = path.lower()
        if low == "/rw/rapid/modules" and query.get("task", TASK) != TASK:
            raise _Refusal(404, "no such task")
        if low in self._documents:
            return self._documents[low]
        if low == "/logout":
            return [Item("logout", "logout", {})]
        if low == "/rw/rapid/tasks":
            return [self._task()]
        if low == _SIGNALS:
            return [self._signal(name) for name in self._signals]
        if low.startswith("/rw/motionsystem/mechunits/"):
            return [self._unit(path.split("/")[4:], query, now)]
        if low.startswith(f"{_PROPERTIES}/"):
            kind, _ = self._symbol(path[len(_PROPERTIES) + 1 :])
            return [Item("rap-sympropvar-li", path, {"dattyp": kind, "rdonly": "FALSE"})]
        return [self._live(path)]

    def _live(self, path: str) -> Item:
        """Return a resource that clients can read and subscribe to. Raises _Refusal for any other path."""
        low = path.lower()
        if low == "/rw/panel/ctrlstate":
            return Item("pnl-ctrlstate", "ctrlstate", {"ctrlstate": self._controller_state()}, (), path)
        if low == "/rw/panel/opmode":
            return Item("pnl-opmode", "opmode", {"opmode": self._controller.desk.key.value}, (), path)
        if low == "/rw/panel/speedratio":
            ratio = f"{self._controller.desk.speed_percent}"
            return Item("pnl-speedratio", "speedratio", {"speedratio": ratio}, (), path)
        if low == "/rw/rapid/execution":
            values = {
                "ctrlexecstate": "running" if operation.runs(self._controller) else "stopped",
                "cycle": "forever",
            }
            return Item("rap-execution", "execution", values, (), path)
        if low.startswith(f"{_SIGNALS}/"):
            return self._signal(path.rpartition("/")[2])
        if low.startswith(f"{_DATA}/"):
            _, value = self._symbol(path[len(_DATA) + 1 :])
            return Item("rap-data", path, {"value": value}, (), path)
        raise _Refusal(404, "no such resource")

    def _controller_state(self) -> str:
        stops = self._controller.stops.names
        if EMERGENCY_STOP in stops:
            return "emergencystop"
        return "motoroff" if MOTORS_OFF in stops else "motoron"

    def _task(self) -> Item:
        values = {"name": TASK, "type": "norm", "taskstate": "link", "active": "On", "motiontask": "TRUE"}
        return Item(
            "rap-task-li",
            TASK,
            {**values, "excstate": "star" if operation.runs(self._controller) else "stop"},
        )

    def _signal(self, name: str) -> Item:
        if name not in self._signals:
            raise _Refusal(404, "no such signal")
        values = {
            "name": name,
            "type": "DI",
            "category": "",
            "lvalue": self._signals[name],
            "lstate": "not simulated",
        }
        return Item("ios-signal", name, values, (), f"{_SIGNALS}/{name}")

    def _symbol(self, path: str) -> tuple[str, str]:
        """Return type and value of RAPID data."""
        state = self._controller.session.state
        guides = operation.runs(self._controller) and state in (State.SET_UP, State.GUIDING)
        if path == _STATE:
            return "num", f"{_RUNS_EGM if guides else _IDLE}"
        if path == _ACTION:
            return "num", f"{_ACTIONS.get(self._profile.mode, 0) if guides else 0}"
        if path not in self._symbols:
            raise _Refusal(404, "no such data")
        return self._symbols[path]

    def _unit(self, parts: Sequence[str], query: Mapping[str, str], now: float) -> Item:
        if parts[0] != UNIT or len(parts) > 2:
            raise _Refusal(404, "no such mechanical unit")
        if len(parts) == 1:
            return self._unit_facts(query.get("resource", "static"))
        pose, joints = self._controller.reporter.measured
        if parts[1] == "jointtarget":
            axes = {f"rax_{axis}": f"{math.degrees(angle):.6g}" for axis, angle in enumerate(joints, 1)}
            return Item("ms-jointtarget", "jointtarget", {**axes, **_EXTERNAL})
        if parts[1] != "robtarget":
            raise _Refusal(404, "no such resource")
        if query.get("coordinate", "Base") not in ("Base", "World", "Word", "Wobj"):
            self._controller.unmodelled.touch("robtarget?coordinate", "answered in the base frame")
        reported = to_wire(pose)
        values = {axis: f"{value:.6g}" for axis, value in zip("xyz", reported.position_mm, strict=True)}
        values |= {f"q{number}": f"{value:.6g}" for number, value in enumerate(reported.quaternion, 1)}
        turns = {f"cf{axis}": f"{math.floor(joints[axis - 1] / (math.pi / 2.0))}" for axis in (1, 4, 6)}
        return Item(
            "ms-robtargets", "robtarget", {**values, **turns, "cfx": "0", **_EXTERNAL_OF_TARGET, **_EXTERNAL}
        )

    def _unit_facts(self, resource: str) -> Item:
        if resource == "dynamic":
            values = {"tool-name": "tool0", "wobj-name": "wobj0", "payload-name": "load0"}
            values |= {"total-payload-name": "load0", "status": "Running", "mode": "Activated"}
            return Item("ms-mechunit", UNIT, {**values, "jog-mode": "AxisGroup1", "coord-system": "World"})
        if resource != "static":
            raise _Refusal(400, "resource must be static or dynamic")
        values = {"type": "TCPRobot", "task-name": TASK, "axes": "6", "axes-total": "6"}
        return Item(
            "ms-mechunit",
            UNIT,
            {**values, "is-integrated-unit": "NoIntegratedUnit", "has-integrated-unit": "NoIntegratedUnit"},
        )

    # --- actions

    def _act(self, path: str, action: str, form: Mapping[str, str], now: float) -> None:
        low = path.lower()
        if low == "/rw/panel/ctrlstate" and action == "setctrlstate":
            self._switch_motors(form.get("ctrl-state", ""), now)
        elif low == "/rw/panel/speedratio" and action == "setspeedratio":
            self._set_speed_ratio(form.get("speed-ratio", ""))
        elif low == "/rw/rapid/execution":
            self._run_program(action, now)
        elif low.startswith(f"{_SIGNALS}/") and action == "set":
            self._set_signal(path.rpartition("/")[2], form.get("lvalue", ""), now)
        elif low.startswith(f"{_DATA}/") and action == "set":
            self._set_symbol(path[len(_DATA) + 1 :], form.get("value"))
        elif low in self._documents:
            raise _Refusal(405, "this resource is read-only")
        else:
            self._live(path)
            raise _Refusal(400, f"no such action: {action!r}"[:VALUE_MAX])

    def _operate(self, act: Callable[[], object]) -> None:
        """Perform an action. In a manual mode, only the operator at the robot may perform it."""
        if self._controller.desk.key is not Key.AUTO:
            raise _Refusal(403, "the controller is in manual mode")
        try:
            act()
        except operation.RefusedAct as refused:
            raise _Refusal(403, str(refused)) from refused

    def _switch_motors(self, state: str, now: float) -> None:
        acts = {"motoroff": operation.switch_motors_off, "motoron": operation.switch_motors_on}
        if state not in acts:
            raise _Refusal(400, "ctrl-state must be motoron or motoroff")
        self._operate(lambda: acts[state](self._controller, now))

    def _run_program(self, action: str, now: float) -> None:
        controller = self._controller
        acts: Mapping[str, Callable[[], None]] = {
            "stop": lambda: operation.stop_program(controller, now),
            "start": lambda: operation.start_program(controller, now),
            "resetpp": lambda: operation.reset_pointer(controller),
        }
        if action not in acts:
            raise _Refusal(400, "action must be start, stop or resetpp")
        self._operate(acts[action])

    def _set_speed_ratio(self, text: str) -> None:
        if not (text.isascii() and text.isdigit() and len(text) < 4 and int(text) <= 100):
            raise _Refusal(400, "speed-ratio must be an integer from 0 to 100")
        if self._profile.mode != "path":
            self._controller.unmodelled.touch("speedratio", "kept, without effect on the guidance")
        self._operate(lambda: operation.set_speed(self._controller, int(text)))

    def _set_signal(self, name: str, value: str, now: float) -> None:
        self._signal(name)
        if value not in ("0", "1"):
            raise _Refusal(400, "lvalue must be 0 or 1")
        rises = value == "1" and self._signals[name] == "0"
        self._signals[name] = value
        if not rises:
            return
        if name == "EGM_STOP":
            self._controller.end_guidance(now)
        elif name == f"EGM_START_{self._profile.mode.upper()}":
            if operation.runs(self._controller) and self._controller.session.state not in (
                State.SET_UP,
                State.GUIDING,
            ):
                self._controller.restart_program(now)
        else:
            self._controller.unmodelled.touch(f"signal {name}", "kept, without effect")

    def _set_symbol(self, path: str, value: str | None) -> None:
        kind, _ = self._symbol(path)
        if path not in self._symbols:
            raise _Refusal(403, "this data is read-only")
        if value is None or len(value) > VALUE_MAX:
            raise _Refusal(400, f"value must be a text of at most {VALUE_MAX} characters")
        self._controller.unmodelled.touch(f"data {path}", "kept; no routine reads it")
        self._symbols[path] = kind, value

    # --- subscriptions

    def _subscribe(self, method: str, path: str, form: Sequence[tuple[str, str]], now: float) -> WebAnswer:
        group = path.removeprefix("/subscription").strip("/")
        if method == "DELETE" and group:
            if not self.subscriptions.end(group):
                raise _Refusal(404, "no such subscription")
            return WebAnswer(200)
        if method != "POST" or group:
            raise _Refusal(405, f"method {method} is not supported here")
        fields = dict(form)
        resources = [fields.get(number, "") for key, number in form if key == "resources"]
        if not resources:
            raise _Refusal(400, "a subscription must name resources")
        for resource in resources:
            self._find_event(resource)
        number = self.subscriptions.begin(resources)
        if number is None:
            raise _Refusal(503, "too many subscriptions")
        return WebAnswer(201, b"", XHTML, {"Location": f"/poll/{number}"})

    def _find_event(self, resource: str) -> Item:
        """Return the event with the current value of a resource such as `/rw/panel/ctrlstate;ctrlstate`."""
        path, _, _ = resource.partition(";")
        item = self._live(unquote(path))
        kind = {
            "ios-signal": "ios-signalstate-ev",
            "rap-data": "rap-value-ev",
            "rap-execution": "rap-ctrlexecstate-ev",
        }
        return item._replace(kind=kind.get(item.kind, f"{item.kind}-ev"), href=resource)

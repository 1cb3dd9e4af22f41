"""Tests of an emulated EGM controller's web services: documents, actions, login and subscriptions, without a port."""

import hashlib
import json
import xml.etree.ElementTree as ET

import pytest

from emulators.devices.egm import EgmController, EgmProfile, State
from emulators.devices.egm.web_login import REALM, SESSION_S, SESSIONS_MAX, Login
from emulators.devices.egm.web_services import WebServices
from emulators.devices.egm.web_subscriptions import GROUPS_MAX
from emulators.faults.ledger import Injection
from emulators.seams import StartPose
from tests.emulation.abb_librws_requests import REQUESTS

START = StartPose((0.9, -0.1, 0.6), (0.0, 0.0, 1.0, 0.0), 0.2)
EXECUTION, MOTORS = "/rw/rapid/execution", "/rw/panel/ctrlstate"


class Served:
    """Controller with its web services, at a time that a test advances."""

    def __init__(self, profile: EgmProfile | None = None) -> None:
        self.profile = profile or EgmProfile()
        self.now = 100.0
        self.controller = EgmController(self.profile, START, self.now, 1)
        self.services = WebServices(self.controller, self.profile)
        self.run(0.1)

    def run(self, seconds: float) -> None:
        """Let cycles pass."""
        end = self.now + seconds
        while (due := self.controller.next_deadline()) is not None and due <= end:
            self.controller.handle_deadline(due)
            self.controller.data_to_send(due)
        self.now = end

    def status(self, method: str, target: str, body: str = "") -> int:
        return self.services.answer(method, target, body, self.now).status

    def value(self, target: str, name: str) -> str:
        """Return the first text of this class in a document."""
        return self.values(target, name)[0]

    def values(self, target: str, name: str) -> list[str]:
        answer = self.services.answer("GET", target, "", self.now)
        assert answer.status == 200, (target, answer)
        return [node.text or "" for node in ET.fromstring(answer.body).iter() if node.get("class") == name]

    @property
    def state(self) -> State:
        return self.controller.session.state


def test_json_has_type_that_abb_robot_client_reads() -> None:
    answer = Served().services.answer("GET", f"{EXECUTION}?json=1", "", 100.0)
    assert answer.kind == "application/json"
    assert json.loads(answer.body)["_embedded"]["_state"][0]["ctrlexecstate"] == "running"


def test_rapid_stop_ends_guidance_and_start_resumes_it() -> None:
    served = Served()
    assert (served.state, served.value(EXECUTION, "ctrlexecstate")) == (State.GUIDING, "running")
    assert served.status("POST", f"{EXECUTION}?action=stop", "stopmode=stop") == 204
    served.run(0.1)
    assert (served.state, served.value(EXECUTION, "ctrlexecstate")) == (State.RAPID_STOPPED, "stopped")
    assert served.status("POST", f"{EXECUTION}?action=start", "regain=continue") == 204
    served.run(0.1)
    assert (served.state, served.value(EXECUTION, "ctrlexecstate")) == (State.GUIDING, "running")
    assert served.controller.counters["sessions"] == 1


def test_start_after_pointer_reset_begins_new_session() -> None:
    served = Served()
    assert served.status("POST", f"{EXECUTION}?action=resetpp") == 403
    served.status("POST", f"{EXECUTION}?action=stop")
    assert served.status("POST", f"{EXECUTION}?action=resetpp") == 204
    assert served.status("POST", f"{EXECUTION}?action=start") == 204
    served.run(0.1)
    assert (served.state, served.controller.counters["sessions"]) == (State.GUIDING, 2)


def test_motors_on_leave_rapid_stopped() -> None:
    served = Served()
    assert served.status("POST", f"{MOTORS}?action=setctrlstate", "ctrl-state=motoroff") == 204
    served.run(0.1)
    assert (served.state, served.value(MOTORS, "ctrlstate")) == (State.MOTORS_OFF, "motoroff")
    assert served.status("POST", f"{EXECUTION}?action=start") == 403
    assert served.status("POST", f"{MOTORS}?action=setctrlstate", "ctrl-state=motoron") == 204
    assert (served.state, served.value(MOTORS, "ctrlstate")) == (State.RAPID_STOPPED, "motoron")
    assert served.status("POST", f"{EXECUTION}?action=start") == 204
    served.run(0.1)
    assert served.state is State.GUIDING


@pytest.mark.parametrize(
    ("fault", "message"),
    [("emergency-stop", "emergencystop"), ("motors-off", "motoroff"), ("program-stopped", "motoron")],
)
def test_requests_cannot_override_operator_stop(fault: str, message: str) -> None:
    served = Served()
    injection = Injection("robot", fault, {}, served.now, served.now + 9.0)
    served.controller.handlers["robot"][fault].begin(injection)
    assert served.value(MOTORS, "ctrlstate") == message
    assert served.status("POST", f"{EXECUTION}?action=start") == 403
    motors = served.status("POST", f"{MOTORS}?action=setctrlstate", "ctrl-state=motoron")
    assert motors == (204 if fault == "program-stopped" else 403)
    served.run(0.5)
    assert served.state in (State.MOTORS_OFF, State.RAPID_STOPPED)


def test_signals_end_and_begin_guidance() -> None:
    served = Served()
    signals = "/rw/iosystem/signals"
    assert served.value("/rw/rapid/symbol/data/RAPID/T_ROB1/TRobEGM/current_action", "value") == "2"
    assert served.status("POST", f"{signals}/EGM_STOP?action=set", "lvalue=1") == 204
    assert served.state is State.ENDED
    assert served.value(f"{signals}/EGM_STOP", "lvalue") == "1"
    assert served.value("/rw/rapid/symbol/data/RAPID/T_ROB1/TRobEGM/current_action", "value") == "0"
    assert served.status("POST", f"{signals}/EGM_START_JOINT?action=set", "lvalue=1") == 204
    assert served.state is State.ENDED, "a program of poses has no session of joints"
    assert served.status("POST", f"{signals}/EGM_START_POSE?action=set", "lvalue=1") == 204
    served.run(0.1)
    assert served.state is State.GUIDING


def test_documents_have_fields_that_library_requires() -> None:
    served = Served(EgmProfile(rw="6.10"))
    assert served.value("/rw/system", "rwversionname") == "6.10.00.00"
    assert served.values("/rw/rapid/tasks", "excstate") == ["star"]
    assert served.values("/rw/rapid/modules?task=T_ROB1", "type") == ["ProgMod"] * 4
    assert len(served.values("/rw/cfg/MOC/JOINT/instances", "value")) == 30
    assert served.values("/rw/cfg/moc/single/instances", "value") == []
    assert served.value("/rw/motionsystem/mechunits/ROB_1?resource=static", "axes") == "6"
    assert served.value("/rw/motionsystem/mechunits/ROB_1?resource=dynamic", "mode") == "Activated"
    place = [served.value("/rw/motionsystem/mechunits/ROB_1/robtarget", axis) for axis in "xyz"]
    assert [float(text) for text in place] == pytest.approx([900.0, -100.0, 600.0], abs=1e-3)
    assert float(served.value("/rw/motionsystem/mechunits/ROB_1/robtarget", "eaxa")) > 8e9
    assert abs(float(served.value("/rw/motionsystem/mechunits/ROB_1/jointtarget", "rax_1"))) < 10.0


def test_add_in_is_listed_among_options() -> None:
    """abb_egm_rws_managers requests the data of the add-in's modules by these two names."""
    options = Served().values("/rw/system", "option")
    assert {"689-1 Externally Guided Motion (EGM)", "StateMachine"} <= set(options)
    modules = Served().values("/rw/rapid/modules?task=T_ROB1", "name")
    assert {"TRobMain", "TRobEGM"} <= set(modules)


def test_json_document_matches_xhtml() -> None:
    answer = Served().services.answer("GET", f"{MOTORS}?json=1", "", 100.1)
    assert json.loads(answer.body)["_embedded"]["_state"][0]["ctrlstate"] == "motoron"


@pytest.mark.parametrize(
    ("method", "target", "body", "status"),
    [
        ("GET", "/", "", 404),
        ("GET", "/rw/rapid/symbol/data/RAPID/T_ROB1/TRobMain/none", "", 404),
        ("GET", "/rw/motionsystem/mechunits/ROB_9/robtarget", "", 404),
        ("GET", "/rw/motionsystem/mechunits/ROB_1/robtarget/more", "", 404),
        ("GET", "/rw/iosystem/signals/none", "", 404),
        ("GET", "//[", "", 400),
        ("PUT", MOTORS, "", 405),
        ("POST", "/rw/system?action=set", "", 405),
        ("POST", MOTORS, "ctrl-state=motoroff", 400),
        ("POST", f"{MOTORS}?action=setctrlstate", "ctrl-state=fly", 400),
        ("POST", f"{EXECUTION}?action=fly", "", 400),
        ("POST", f"{EXECUTION}?action=start", "", 403),
        ("POST", "/rw/panel/speedratio?action=setspeedratio", "speed-ratio=101", 400),
        ("POST", "/rw/iosystem/signals/EGM_STOP?action=set", "lvalue=2", 400),
        ("POST", "/rw/rapid/symbol/data/RAPID/T_ROB1/TRobMain/current_state?action=set", "value=1", 403),
        ("POST", "/rw/rapid/symbol/data/RAPID/T_ROB1/TRobUtility/base_frame?action=set", f"value={'9' * 2000}", 400),
        ("POST", "/subscription", "", 400),
        ("POST", "/subscription", "resources=1&1=/rw/none", 404),
        ("POST", "/subscription", "&".join(["a=1"] * 600), 400),
        ("DELETE", "/subscription/9", "", 404),
    ],
)  # fmt: skip
def test_invalid_request_is_refused_without_effect(method: str, target: str, body: str, status: int) -> None:
    served = Served()
    assert served.status(method, target, body) == status
    assert served.state is State.GUIDING


def test_written_data_is_read_back() -> None:
    served = Served()
    data = "/rw/rapid/symbol/data/RAPID/T_ROB1/TRobRAPID/routine_name_input"
    assert served.status("POST", f"{data}?action=set", "value=%22runMoveJ%22") == 204
    assert served.value(data, "value") == '"runMoveJ"'
    assert served.value(data.replace("/data/", "/properties/"), "dattyp") == "string"


def test_subscriber_receives_only_changes() -> None:
    served = Served()
    body = f"resources=0&0={MOTORS};ctrlstate&0-p=1&resources=1&1={EXECUTION};ctrlexecstate&1-p=1"
    answer = served.services.answer("POST", "/subscription", body, served.now)
    assert (answer.status, answer.headers["Location"]) == (201, "/poll/1")
    subscriptions = served.services.subscriptions
    assert subscriptions.news("1") == b""
    served.status("POST", f"{EXECUTION}?action=stop")
    news = subscriptions.news("1").decode()
    assert "rap-ctrlexecstate-ev" in news
    assert ">stopped<" in news
    assert "ctrlstate-ev" not in news.replace("rap-ctrlexecstate-ev", "")
    assert subscriptions.news("1") == b""
    assert served.status("DELETE", "/subscription/1") == 200
    assert not subscriptions.knows("1")


def test_subscriptions_are_bounded() -> None:
    served = Served()
    statuses = [
        served.status("POST", "/subscription", f"resources=1&1={MOTORS}") for _ in range(GROUPS_MAX + 1)
    ]
    assert statuses == [201] * GROUPS_MAX + [503]


def test_requests_of_recorded_client_have_its_statuses() -> None:
    served = Served()
    statuses = []
    for method, target, body, _ in REQUESTS:
        statuses.append(served.status(method, target, body))
        served.run(0.05)
    assert statuses == [status for *_, status in REQUESTS]
    assert served.state is State.RAPID_STOPPED
    assert served.controller.counters["sessions"] == 3


# --- login


def credentials(login: Login, password: str = "robotics", target: str = "/rw/system", uri: str = "") -> str:
    """Return a correct answer to a challenge, by RFC 2617, unless the test falsifies it."""
    nonce = login.challenge().partition('nonce="')[2].partition('"')[0]
    uri = uri or target
    first = hashlib.md5(f"Default User:{REALM}:{password}".encode()).hexdigest()
    second = hashlib.md5(f"GET:{uri}".encode()).hexdigest()
    response = hashlib.md5(f"{first}:{nonce}:00000001:abc:auth:{second}".encode()).hexdigest()
    return (
        f'Digest username="Default User", realm="{REALM}", nonce="{nonce}", uri="{uri}", qop=auth, '
        f'nc=00000001, cnonce="abc", response="{response}"'
    )


def test_unused_session_expires() -> None:
    login = Login(b"secret")
    assert login.accepts(credentials(login), "GET", "/rw/system")
    cookies = login.open(0.0)
    assert cookies is not None
    assert login.knows(cookies, SESSION_S)
    assert not login.knows(cookies, 2.0 * SESSION_S + 1.0)
    assert not login.knows({}, 0.0)


def test_wrong_digest_response_is_refused() -> None:
    login = Login(b"secret")
    assert not login.accepts(credentials(login, password="wrong"), "GET", "/rw/system")
    assert not login.accepts(credentials(login), "POST", "/rw/system")
    assert not login.accepts(credentials(login, uri="/other"), "GET", "/rw/system")
    assert not login.accepts(credentials(Login(b"other")), "GET", "/rw/system")
    for header in ("", "Basic abc", "Digest", "Digest é", f"Digest {'a=1,' * 2000}"):
        assert not login.accepts(header, "GET", "/rw/system")


def test_sessions_and_nonces_are_bounded() -> None:
    login = Login(b"secret")
    first = credentials(login)
    for _ in range(1000):
        login.challenge()
    assert not login.accepts(first, "GET", "/rw/system")
    opened = [login.open(0.0) for _ in range(SESSIONS_MAX + 1)]
    assert opened.count(None) == 1
    assert login.sessions == SESSIONS_MAX

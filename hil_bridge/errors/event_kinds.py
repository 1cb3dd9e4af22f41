"""Kinds of events in a recording, with their meaning. A kind of robot may add its own kinds, as text."""

from enum import StrEnum


class EventKind(StrEnum):
    """Kind of an event. Recordings contain the value of the enum."""

    meaning: str

    def __new__(cls, value: str, meaning: str) -> "EventKind":
        kind = str.__new__(cls, value)
        kind._value_, kind.meaning = value, meaning
        return kind

    PHASE = "phase", "A phase of the run begins; the text is its name."
    CHECK = "check", "A result of the sensor checks before contact: full scales, model, weight, zero."
    STOP = "stop", "The run is stopped; the text is the cause."
    THEN = "then", "A second cause, after the stop."
    PACE = (
        "pace",
        "Control rate and where it is set, for a controller that does not declare one.",
    )
    STEP = "step", "A step of a program begins or ends."
    FAULT = "fault", "An injected fault begins, has an effect, or ends."
    GAP = "gap", "A pause of the computer."
    SIGNAL = "signal", "A signal requests the end of the process, such as Ctrl-C."
    OPERATOR = "operator", "An operator has made a request: end, hold."
    MARK = "mark", "An operator has marked this moment."
    ROBOT = "robot", "A fact that the robot reports."
    MOTION = "motion", "An event of the robot's movement."
    LINK = "link", "The robot's link failed, or reports a problem."
    SENSOR = "sensor", "A device event of the sensor, or its failure."
    EMULATOR = "emulator", "An emulated device reports a client's mistake."
    NOT_MODELLED = (
        "not-modelled",
        "The client uses a feature that the emulated device does not model; reported once per feature.",
    )
    LINE_ERROR = "line_error", "Characters with a parity or framing error."
    TELNET_ERROR = "telnet_error", "A malformed request or answer of RFC 2217."
    WIRE_LOST = "wire_lost", "A connection broke; it is being restored."
    WIRE_BACK = "wire_back", "A connection is restored."
    ABSENT = "absent", "No program receives datagrams at the other end, and none has been received from it."
    UNREACHABLE = "unreachable", "The network does not deliver datagrams to the other end."
    LEFT = "left", "The program at the other end of a datagram link has ended; it had sent datagrams before."
    STRANGER = "stranger", "Datagrams from an unknown sender are refused."
    OVERRUN = "overrun", "A decision took longer than the period; cycles were skipped."
    TRACEBACK = "traceback", "The traceback of code that failed."
    FAILED = "failed", "Code of a plug-in failed; the text names its package and place."
    BUG = "bug", "An unexpected exception."
    RECORDER = "recorder", "Records were dropped."
    WEB = "web", "The server of the page in the browser has ended; the run continues."


_K = EventKind
ALARMS = (_K.STOP, _K.THEN, _K.BUG, _K.FAILED, _K.TRACEBACK, _K.RECORDER)
"""Kinds of events that explain why a run stops."""
CAUTIONS = (_K.FAULT, _K.GAP, _K.SIGNAL, _K.OPERATOR)
"""Kinds of events that report a disturbance or an operator's action."""

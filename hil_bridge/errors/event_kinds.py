"""Kinds of the events in a recording, with their meaning. A robot's kind may bring some of its own, as text."""

from enum import StrEnum


class EventKind(StrEnum):
    """Kind of an event. Its value stands in the recording."""

    meaning: str

    def __new__(cls, value: str, meaning: str) -> "EventKind":
        kind = str.__new__(cls, value)
        kind._value_, kind.meaning = value, meaning
        return kind

    PHASE = "phase", "A phase of the run begins; the text is its name."
    CHECK = "check", "A finding about the sensor before the touch: full scales, model, weight, zero."
    STOP = "stop", "The run is stopped; the text is the cause."
    THEN = "then", "A second cause, after the stop."
    PACE = (
        "pace",
        "How often the controller decides, and where that is set; told of a controller that does not say it.",
    )
    STEP = "step", "A step of a program begins or ends."
    FAULT = "fault", "An injected fault begins, has an effect, or ends."
    GAP = "gap", "The computer stood still for a while."
    SIGNAL = "signal", "A signal asks the process to end, as by Ctrl-C."
    OPERATOR = "operator", "An operator has asked for something: the end, a hold."
    MARK = "mark", "An operator has marked this moment."
    ROBOT = "robot", "A fact that the robot tells."
    MOTION = "motion", "An event of the robot's movement."
    LINK = "link", "The robot's link failed, or tells of a trouble."
    SENSOR = "sensor", "A device event of the sensor, or its failure."
    EMULATOR = "emulator", "An emulated device tells of a client's mistake."
    NOT_MODELLED = (
        "not-modelled",
        "The client uses something that the emulated device does not model; once for each thing.",
    )
    LINE_ERROR = "line_error", "Characters with a parity or framing error."
    TELNET_ERROR = "telnet_error", "A malformed request or answer of RFC 2217."
    WIRE_LOST = "wire_lost", "A connection broke and is tried again."
    WIRE_BACK = "wire_back", "A connection is there again."
    ABSENT = "absent", "No program takes datagrams at the other end; none was heard from there."
    UNREACHABLE = "unreachable", "The network does not bring datagrams to the other end."
    LEFT = "left", "The program at the other end of a wire of datagrams has left; it was heard before."
    STRANGER = "stranger", "Datagrams of another sender are refused."
    OVERRUN = "overrun", "A decision took longer than the period; cycles were left out."
    TRACEBACK = "traceback", "The traceback of code that failed."
    FAILED = "failed", "Code of a plug-in failed; the text names its package and place."
    BUG = "bug", "An exception that nothing expected."
    RECORDER = "recorder", "Records were dropped."
    WEB = "web", "The server of the page in the browser has ended; the run continues."


_K = EventKind
ALARMS = (_K.STOP, _K.THEN, _K.BUG, _K.FAILED, _K.TRACEBACK, _K.RECORDER)
"""Kinds of events that tell why a run stops."""
CAUTIONS = (_K.FAULT, _K.GAP, _K.SIGNAL, _K.OPERATOR)
"""Kinds of events that tell of a disturbance, or of an operator."""

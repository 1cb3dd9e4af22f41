"""Reasons why a controller does not follow commands, from its reports."""

from hil_fanuc.packets import ContactStop, Report, RobotStatus, Status
from protocol.endpoint import NO_TROUBLE, Trouble

_AGAIN = "then start the run again: the client resets the controller and calls its program"
_CONTACTS = {
    ContactStop.STOP: "its contact stop has tripped",
    ContactStop.ESCAPE: "its contact stop is in escape mode",
}


def find_trouble(report: Report, alarm: str) -> Trouble:
    """Return the reason; empty if the controller follows commands. `alarm` is the newest alarm that was read."""
    status = report.robot_status
    if status & RobotStatus.EMERGENCY_STOP:
        return Trouble("the emergency stop is pressed", f"release the emergency stop, {_AGAIN}")
    if status & RobotStatus.PENDANT:
        return Trouble("its teach pendant is on", f"switch it off, {_AGAIN}")
    if contact := _CONTACTS.get(report.contact_stop):  # type: ignore[call-overload]
        return Trouble(str(contact), f"clear the contact, {_AGAIN}")
    if status & RobotStatus.ERROR:
        text = f": {alarm}" if alarm else ""
        return Trouble(f"it reports an alarm{text}", f"correct its cause, {_AGAIN}")
    if not report.status & Status.READY:
        return Trouble("it is not ready for commands", f"check its program and its alarms, {_AGAIN}")
    return NO_TROUBLE

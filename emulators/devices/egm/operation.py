"""Operation of an emulated ABB controller, by an operator at its panel and by a client of its web services.

Switching the motors off also stops RAPID, and switching them on again leaves it stopped. Turning the key switches
the motors off and stops RAPID. Releasing an emergency stop only permits the motors to be switched on (ISO 13850: a
reset starts nothing).

Source: abb_librws (9ba0837) for the effect of its requests; its pull request 159: EGM works in both manual modes.
250 mm/s at reduced speed: ISO 10218-1. Assumed: the effect of the key; in a manual mode the web services refuse to
operate the robot.
"""

import math

from emulators.devices.egm.controller import EgmController
from emulators.devices.egm.state import EMERGENCY_STOP, MOTORS_OFF, POWERLESS, PROGRAM_STOPPED, Key, State
from protocol.devices.egm import Rapid

REDUCED_M_S = 0.25
"""Tool speed limit in the manual mode with reduced speed, m/s. Standard: ISO 10218-1."""


class RefusedAct(ValueError):
    """Action that the controller refuses in its current state. The text gives the reason."""


def runs(controller: EgmController) -> bool:
    """Return whether RAPID is running."""
    return not controller.stops.names and controller.session.state.value[2] is Rapid.RUNNING


def press_emergency_stop(controller: EgmController, now: float) -> None:
    """Stop the robot at once and switch its motors off."""
    controller.stop(EMERGENCY_STOP, now)
    switch_motors_off(controller, now)


def release_emergency_stop(controller: EgmController, now: float) -> None:
    """Permit the motors to be switched on again."""
    controller.start(EMERGENCY_STOP, now)


def turn_key(controller: EgmController, key: Key, now: float) -> None:
    """Select the operating mode. No effect if it is already selected."""
    if key is not controller.desk.key:
        switch_motors_off(controller, now)
        controller.desk.key = key
        controller.motion.tool_limit_m_s = REDUCED_M_S if key is Key.MANUAL else math.inf


def switch_motors_off(controller: EgmController, now: float) -> None:
    """Switch the motors off. This stops RAPID."""
    controller.stop(PROGRAM_STOPPED, now)
    controller.stop(MOTORS_OFF, now)


def switch_motors_on(controller: EgmController, now: float) -> None:
    """Switch the motors on; RAPID stays as it is. In a manual mode this is the enabling device. Raises RefusedAct."""
    if EMERGENCY_STOP in controller.stops.names:
        raise RefusedAct("an emergency stop is pressed")
    controller.start(MOTORS_OFF, now)
    if MOTORS_OFF in controller.stops.names:
        raise RefusedAct("the motors are held off")


def stop_program(controller: EgmController, now: float) -> None:
    """Stop RAPID at its current position."""
    controller.stop(PROGRAM_STOPPED, now)


def reset_pointer(controller: EgmController) -> None:
    """Set the program pointer to main, so that the next start begins another session. Raises RefusedAct while RAPID
    runs.
    """
    if runs(controller):
        raise RefusedAct("the program runs")
    controller.desk.at_main = True


def start_program(controller: EgmController, now: float) -> None:
    """Start RAPID where it was stopped, or from main. Raises RefusedAct if RAPID is running or cannot start."""
    if runs(controller):
        raise RefusedAct("the program is already running")
    if set(controller.stops.names) & set(POWERLESS):
        raise RefusedAct("the motors are off")
    controller.start(PROGRAM_STOPPED, now)
    if PROGRAM_STOPPED in controller.stops.names:
        raise RefusedAct("the program is held")
    if controller.desk.at_main or controller.session.state is State.FAILED:
        controller.restart_program(now)
    controller.desk.at_main = False


def restart_program(controller: EgmController, now: float) -> None:
    """Start RAPID from its first line, even if it is running. This begins another session. Raises RefusedAct if
    RAPID cannot start.
    """
    if runs(controller):
        controller.restart_program(now)
    else:
        reset_pointer(controller)
        start_program(controller, now)


def set_speed(controller: EgmController, percent: float) -> None:
    """Set the speed ratio, 0 to 100 % of the programmed speeds. Guidance by poses or joints ignores it (assumed)."""
    controller.desk.speed_percent = round(percent)
    controller.motion.programmed_share = controller.desk.speed_percent / 100.0

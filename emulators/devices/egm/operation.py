"""Acts at an emulated ABB controller, by an operator at its panel and by a client of its web services.

Switching the motors off stops RAPID too, and motors that are switched on again leave it stopped. Turning the key does
both. An emergency stop that is released only permits the motors to be switched on (ISO 13850: a reset starts nothing).

Source: abb_librws (9ba0837) for what its requests do; its pull request 159: EGM works in both manual modes. 250 mm/s at
reduced speed: ISO 10218-1. Assumed: the key as above; in a manual mode the web services refuse to operate the robot.
"""

import math

from emulators.devices.egm.controller import EgmController
from emulators.devices.egm.state import EMERGENCY_STOP, MOTORS_OFF, POWERLESS, PROGRAM_STOPPED, Key, State
from protocol.devices.egm import Rapid

REDUCED_M_S = 0.25
"""Fastest tool in the manual mode of reduced speed. Standard: ISO 10218-1."""


class RefusedAct(ValueError):
    """The controller refuses an act in its present state; the words say why."""


def runs(controller: EgmController) -> bool:
    """Whether RAPID runs."""
    return not controller.stops.names and controller.session.state.value[2] is Rapid.RUNNING


def press_emergency_stop(controller: EgmController, now: float) -> None:
    """Stop the robot at once, with its motors off."""
    controller.stop(EMERGENCY_STOP, now)
    switch_motors_off(controller, now)


def release_emergency_stop(controller: EgmController, now: float) -> None:
    """Permit the motors to be switched on again."""
    controller.start(EMERGENCY_STOP, now)


def turn_key(controller: EgmController, key: Key, now: float) -> None:
    """Choose the operating mode. Harmless for the present one."""
    if key is not controller.desk.key:
        switch_motors_off(controller, now)
        controller.desk.key = key
        controller.motion.tool_limit_m_s = REDUCED_M_S if key is Key.MANUAL else math.inf


def switch_motors_off(controller: EgmController, now: float) -> None:
    """Switch the motors off; RAPID stops with them."""
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
    """Stop RAPID where it is."""
    controller.stop(PROGRAM_STOPPED, now)


def reset_pointer(controller: EgmController) -> None:
    """Set the program pointer to main: the next start begins another session. Raises RefusedAct while RAPID runs."""
    if runs(controller):
        raise RefusedAct("the program runs")
    controller.desk.at_main = True


def start_program(controller: EgmController, now: float) -> None:
    """Start RAPID where it was stopped, or from main. Raises RefusedAct while it runs, and where it cannot."""
    if runs(controller):
        raise RefusedAct("the program runs already")
    if set(controller.stops.names) & set(POWERLESS):
        raise RefusedAct("the motors are off")
    controller.start(PROGRAM_STOPPED, now)
    if PROGRAM_STOPPED in controller.stops.names:
        raise RefusedAct("the program is held")
    if controller.desk.at_main or controller.session.state is State.FAILED:
        controller.restart_program(now)
    controller.desk.at_main = False


def restart_program(controller: EgmController, now: float) -> None:
    """Start RAPID from its first line, whether it runs or not: another session. Raises RefusedAct where it cannot."""
    if runs(controller):
        controller.restart_program(now)
    else:
        reset_pointer(controller)
        start_program(controller, now)


def set_speed(controller: EgmController, percent: float) -> None:
    """Set the speed ratio: 0 to 100 % of programmed speeds. The guidance by poses or joints has none (assumed)."""
    controller.desk.speed_percent = round(percent)
    controller.motion.programmed_share = controller.desk.speed_percent / 100.0

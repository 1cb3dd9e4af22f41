"""Requests of a third-party client and the statuses of their answers, in order.

Client: abb_librws (ros-industrial, 9ba0837) with Poco 1.11, compiled unmodified, at the emulated controller in real
time. It read the robot's description, stopped RAPID, switched motors off and on, and reset the program pointer. It
subscribed to a signal, started RAPID, stopped and began the guidance by signals of the StateMachine add-in, and stopped
RAPID. It accepted every answer except the two errors that it provoked. Repeated reads are left out.
"""

REQUESTS: tuple[tuple[str, str, str, int], ...] = (
    ("GET", "/rw/system", "", 200),
    ("GET", "/ctrl", "", 200),
    ("GET", "/rw/cfg/sys/mechanical_unit_group/instances", "", 200),
    ("GET", "/rw/cfg/moc/mechanical_unit/instances", "", 200),
    ("GET", "/rw/cfg/moc/robot/instances", "", 200),
    ("GET", "/rw/cfg/MOC/JOINT/instances", "", 200),
    ("GET", "/rw/cfg/moc/single/instances", "", 200),
    ("GET", "/rw/cfg/sys/present_options/instances", "", 200),
    ("GET", "/rw/cfg/MOC/TRANSMISSION/instances", "", 200),
    ("GET", "/rw/cfg/moc/arm/instances", "", 200),
    ("GET", "/rw/rapid/tasks", "", 200),
    ("GET", "/rw/rapid/modules?task=T_ROB1", "", 200),
    ("GET", "/rw/motionsystem/mechunits/ROB_1?resource=static", "", 200),
    ("GET", "/rw/motionsystem/mechunits/ROB_1?resource=dynamic", "", 200),
    ("GET", "/rw/motionsystem/mechunits/ROB_1/jointtarget", "", 200),
    ("GET", "/rw/motionsystem/mechunits/ROB_1/robtarget", "", 200),
    ("GET", "/rw/panel/speedratio", "", 200),
    ("GET", "/rw/panel/opmode", "", 200),
    ("GET", "/rw/panel/ctrlstate", "", 200),
    ("GET", "/rw/rapid/execution", "", 200),
    ("GET", "/rw/rapid/symbol/properties/RAPID/T_ROB1/TRobEGM/current_action", "", 200),
    ("GET", "/rw/rapid/symbol/data/RAPID/T_ROB1/TRobEGM/current_action", "", 200),
    ("GET", "/rw/rapid/symbol/properties/RAPID/T_ROB1/TRobMain/current_state", "", 200),
    ("GET", "/rw/rapid/symbol/data/RAPID/T_ROB1/TRobMain/current_state", "", 200),
    ("POST", "/rw/rapid/execution?action=stop", "stopmode=stop", 204),
    ("GET", "/rw/rapid/execution", "", 200),
    ("POST", "/rw/panel/ctrlstate?action=setctrlstate", "ctrl-state=motoroff", 204),
    ("GET", "/rw/rapid/execution", "", 200),
    (
        "POST",
        "/rw/rapid/execution?action=start",
        "regain=continue&execmode=continue&cycle=forever&condition=none&stopatbp=disabled&alltaskbytsp=false",
        403,
    ),
    ("POST", "/rw/panel/ctrlstate?action=setctrlstate", "ctrl-state=motoron", 204),
    ("GET", "/rw/rapid/execution", "", 200),
    ("POST", "/rw/rapid/execution?action=resetpp", "", 204),
    ("POST", "/subscription", "resources=0&0=/rw/iosystem/signals/EGM_STOP;state&0-p=2", 201),
    (
        "POST",
        "/rw/rapid/execution?action=start",
        "regain=continue&execmode=continue&cycle=forever&condition=none&stopatbp=disabled&alltaskbytsp=false",
        204,
    ),
    ("GET", "/rw/rapid/execution", "", 200),
    ("POST", "/rw/iosystem/signals/EGM_STOP?action=set", "lvalue=0", 204),
    ("GET", "/rw/iosystem/signals/EGM_STOP", "", 200),
    ("POST", "/rw/iosystem/signals/EGM_STOP?action=set", "lvalue=1", 204),
    ("DELETE", "/subscription/1", "", 200),
    ("GET", "/rw/rapid/execution", "", 200),
    ("POST", "/rw/iosystem/signals/EGM_START_POSE?action=set", "lvalue=0", 204),
    ("GET", "/rw/iosystem/signals/EGM_START_POSE", "", 200),
    ("POST", "/rw/iosystem/signals/EGM_START_POSE?action=set", "lvalue=1", 204),
    ("GET", "/rw/rapid/execution", "", 200),
    ("POST", "/rw/rapid/execution?action=stop", "stopmode=stop", 204),
    ("GET", "/rw/rapid/execution", "", 200),
    ("GET", "/rw/iosystem/signals/none", "", 404),
    ("GET", "/logout", "", 200),
)
"""Method, target, body, status."""

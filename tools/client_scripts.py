"""Scripts with which third-party clients make a transcript. The last line of their output is JSON: the values that
they read and sent.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Session(NamedTuple):
    """Session of a client: its packages, the device that it connects to, and its script."""

    client: tuple[str, ...]
    """Pinned packages of the client; the client itself is the first."""
    device: str
    settings: Mapping[str, Any]
    """Settings of the device's profile that differ from the defaults."""
    wires: Mapping[str, int]
    """Ports of the wires by name; 0 selects a free port."""
    script: str
    """Python script; its arguments are the host, then the ports or paths of the wires."""
    waits: bool = False
    """Whether the device sends first. It is then powered up when the script has printed `ready`."""
    files: Mapping[str, str] = {}
    """Files for the client, by name. `{port}` is replaced by the port or path of the wire."""


_EGM = """
import json, sys
import numpy as np
reads, sends = [], []

def told(state, position, orientation):
    return {"seqno": state.robot_message.header.seqno, "position_mm": [float(value) for value in position],
            "quaternion": [float(value) for value in orientation],
            "joints_deg": [float(value) for value in state.joint_angles]}
"""
_FLO = f"""{_EGM}
from ABBRobotEGM import EGM

def taken(egm):
    ok, state = egm.receive_from_robot(10.0)
    assert ok
    p, o = state.cartesian.pos, state.cartesian.orient
    reads.append(told(state, (p.x, p.y, p.z), (o.u0, o.u1, o.u2, o.u3)))
    return state

with EGM(port=int(sys.argv[2])) as egm:
    print("ready", flush=True)
    for cycle in range(12):
        state = taken(egm)
"""
_FLO_POSES = f"""{_FLO}
        position, orientation = [900.0 + 0.02 * cycle, -100.0, 600.0], [0.0, 1.0, 0.0, 0.0]
        assert egm.send_to_robot_cart(np.array(position), np.array(orientation))
        sends.append({{"position_mm": position, "quaternion": orientation}})
print(json.dumps({{"reads": reads, "sends": sends}}))
"""
_FLO_JOINTS = f"""{_FLO}
        joints = [float(value) for value in np.round(state.joint_angles + np.array([0.01, 0, 0, 0, 0, 0.02]), 3)]
        assert egm.send_to_robot(np.array(joints))
        sends.append({{"joints_deg": joints}})
print(json.dumps({{"reads": reads, "sends": sends}}))
"""
_FLO_PATH = f"""{_FLO}
        offset = [0.0, 0.125 * cycle, -0.5]
        assert egm.send_to_robot_path_corr(np.array(offset), age=1)
        sends.append({{"offset_mm": offset}})
print(json.dumps({{"reads": reads, "sends": sends}}))
"""
_RPI = f"""{_EGM}
from abb_robot_client.egm import EGM

egm = EGM(port=int(sys.argv[2]))
print("ready", flush=True)
for cycle in range(12):
    ok, state = egm.receive_from_robot(10.0)
    assert ok
    reads.append(told(state, *state.cartesian))
    position, orientation = [900.0, -100.0 - 0.02 * cycle, 600.0], [0.0, 1.0, 0.0, 0.0]
    speed = [0.0, -5.0, 0.0, 0.0, 0.0, 0.0]
    assert egm.send_to_robot_cart(np.array(position), np.array(orientation), np.array(speed))
    sends.append({{"position_mm": position, "quaternion": orientation, "speed": speed}})
print(json.dumps({{"reads": reads, "sends": sends}}))
"""
_UR = """
import json, sys, time
from dashboard_client import DashboardClient
from rtde_io import RTDEIOInterface
from rtde_receive import RTDEReceiveInterface

host, reads = sys.argv[1], []
names = ["timestamp", "actual_TCP_pose", "actual_q", "safety_mode", "robot_mode", "runtime_state"]
receive = RTDEReceiveInterface(host, 25.0, names)
for sample in range(4):
    time.sleep(0.05)
    reads.append({"actual_TCP_pose": receive.getActualTCPPose(), "actual_q": receive.getActualQ(),
                  "safety_mode": receive.getSafetyMode(), "robot_mode": receive.getRobotMode(),
                  "runtime_state": receive.getRuntimeState()})
receive.disconnect()
io = RTDEIOInterface(host)
sends = [{"speed_slider_fraction": 0.5}, {"standard_digital_output": 0b10}]
assert io.setSpeedSlider(0.5)
assert io.setStandardDigitalOut(1, True)
time.sleep(0.1)
io.disconnect()
board = DashboardClient(host)
board.connect()
reads.append({"robotmode": board.robotmode(), "safetymode": board.safetymode(), "running": board.running()})
board.disconnect()
print(json.dumps({"reads": reads, "sends": sends}))
"""
_UR_CONTROL = """
import json, sys, time
from rtde_control import RTDEControlInterface

control = RTDEControlInterface(sys.argv[1], 50.0)
start, sends = [0.9, -0.1, 0.6, 3.141592653589793, 0.0, 0.0], []
for step in range(4):
    target = [start[0], start[1], start[2] - 0.0005 * step, *start[3:]]
    assert control.servoL(target, 0.0, 0.0, 0.02, 0.1, 300.0)
    sends.append({"servoL": target})
    time.sleep(0.02)
control.servoStop()
reads = [{"offset": control.getTCPOffset()}]
control.stopScript()
control.disconnect()
print(json.dumps({"reads": reads, "sends": sends}))
"""
_PYNETFT = """
import json, sys, time
from pynetft import Client, Config
client = Client(Config(sensor_host=sys.argv[1], rdt_port=int(sys.argv[2]), http_port=int(sys.argv[3])))
client.start()
assert client.wait_for_first_sample(5.0)
reads = []
for _ in range(4):
    time.sleep(0.04)
    sample = client.latest_sample()
    reads.append({"rdt_sequence": sample.rdt_sequence, "forces": list(sample.force), "moments": list(sample.torque)})
product = client.health().sensor_configuration.product_name
client.stop()
print(json.dumps({"reads": [*reads, {"product": product}]}))
"""
_NETFT = """
import json, sys, time
from NetFT import Sensor
sensor = Sensor(sys.argv[1])
reads = [{"counts": list(sensor.getMeasurement())} for _ in range(3)]
sensor.zero()
sensor.startStreaming()
time.sleep(0.1)
sensor.stopStreaming()
print(json.dumps({"reads": reads}))
"""
_FT300 = """
import json, sys, time
from ft300python import FT300ModbusRTU, FT300Stream
stream = FT300Stream(sys.argv[2], 1, zero_reset=False)
reads = [{"streamed": list(stream.get_force_torque())} for _ in range(6)]
del stream
time.sleep(0.2)
asked = FT300ModbusRTU(sys.argv[2], 1, zero_reset=False)
reads += [{"asked": list(asked.get_force_torque())}, {"serial": asked.get_serial_number()},
          {"year": asked.get_production_year()}, {"acceleration": asked.get_acceralation()}]
asked.disconnect()
print(json.dumps({"reads": reads}))
"""
_ETHERNET = """<ROOT>
<CONFIG><IP_NUMBER>{host}</IP_NUMBER><PORT>{port}</PORT><SENTYPE>ImFree</SENTYPE><ONLYSEND>FALSE</ONLYSEND></CONFIG>
<SEND><ELEMENTS>
<ELEMENT TAG="DEF_RIst" TYPE="DOUBLE" INDX="INTERNAL" />
<ELEMENT TAG="DEF_RSol" TYPE="DOUBLE" INDX="INTERNAL" />
<ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL" />
</ELEMENTS></SEND>
<RECEIVE><ELEMENTS>
<ELEMENT TAG="RKorr.X" TYPE="DOUBLE" INDX="1" HOLDON="0" />
<ELEMENT TAG="RKorr.Y" TYPE="DOUBLE" INDX="2" HOLDON="0" />
<ELEMENT TAG="RKorr.Z" TYPE="DOUBLE" INDX="3" HOLDON="0" />
<ELEMENT TAG="RKorr.A" TYPE="DOUBLE" INDX="4" HOLDON="0" />
<ELEMENT TAG="RKorr.B" TYPE="DOUBLE" INDX="5" HOLDON="0" />
<ELEMENT TAG="RKorr.C" TYPE="DOUBLE" INDX="6" HOLDON="0" />
</ELEMENTS></RECEIVE>
</ROOT>
"""
_RSI = """
import json, time
from RSIPI.rsi_api import RSIAPI
api = RSIAPI("ethernet.xml", rsi_mode="relative", max_cartesian_rate=0.0)
api.start()
time.sleep(1.0)
print("ready", flush=True)
assert api.wait_for_connection(20.0)
time.sleep(0.06)
api.motion.update_cartesian(X=0.01, Z=-0.02)
time.sleep(0.02)
api.motion.update_cartesian(X=0.0, Z=0.0)
time.sleep(0.06)
told = api.client.send_variables
reads = [{"RIst": dict(told["RIst"]), "RSol": dict(told["RSol"])}]
api.stop()
print(json.dumps({"reads": reads, "sends": [{"X": 0.01, "Z": -0.02}]}))
"""
_RTDE_PORTS = {"rtde": 30004, "dashboard": 29999}
_SETTLED = {"wander_n": 0.0, "creep_share": 0.0, "vibration_n": 0.0, "motion_n": 0.0}
_NETFT_SETTINGS = {"boot_s": 0.0, "rate_hz": 100, "noise_n": 0.02, "noise_nm": 0.001, **_SETTLED}
_FT300_SETTINGS = {"boot_s": 0.0, "noise_n": 0.1, "noise_nm": 0.003, **_SETTLED}
"""Settings of the sensor's errors at the time of the recording."""

SESSIONS: dict[str, Session] = {
    "egm-abb-robot-egm-poses": Session(
        ("ABBRobotEGM==1.0.7",), "egm", {}, {"egm": 0}, _FLO_POSES, waits=True
    ),
    "egm-abb-robot-egm-joints": Session(
        ("ABBRobotEGM==1.0.7",), "egm", {"mode": "joint"}, {"egm": 0}, _FLO_JOINTS, waits=True
    ),
    "egm-abb-robot-egm-path": Session(
        ("ABBRobotEGM==1.0.7",),
        "egm",
        {"mode": "path", "sample_ms": 48.0, "path_speed_mm_s": 10.0, "path_mm": [5.0, 0.0, 0.0]},
        {"egm": 0},
        _FLO_PATH,
        waits=True,
    ),
    "egm-abb-robot-client-poses": Session(
        ("abb_robot_client==0.4.0",), "egm", {"rw": "6.10"}, {"egm": 0}, _RPI, waits=True
    ),
    "rtde-ur-rtde": Session(("ur_rtde==1.6.5",), "rtde", {}, _RTDE_PORTS, _UR),
    "rtde-ur-rtde-control": Session(
        ("ur_rtde==1.6.5",), "rtde", {}, {**_RTDE_PORTS, "script": 30003}, _UR_CONTROL
    ),
    "netft-pynetft": Session(("pynetft==2.1.3",), "netft", _NETFT_SETTINGS, {"rdt": 0, "page": 0}, _PYNETFT),
    "netft-netft": Session(("NetFT==2.0.1",), "netft", _NETFT_SETTINGS, {"rdt": 49152}, _NETFT),
    "ft300-ft300python": Session(
        ("ft300python==1.0.2", "pymodbus==2.5.3"), "ft300", _FT300_SETTINGS, {"serial": 0}, _FT300
    ),
    "rsi-rsipi": Session(
        ("RSIPI==0.3.0",),
        "rsi",
        {"send": ["DEF_RIst", "DEF_RSol", "DEF_Delay"]},
        {"rsi": 0},
        _RSI,
        waits=True,
        files={"ethernet.xml": _ETHERNET},
    ),
}
"""All sessions, by the name of their transcript file."""

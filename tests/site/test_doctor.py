"""Doctor on computers emulated in a folder: its findings and remedies."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.clock import realtime as realtime_module
from hil_bridge.clock.realtime import RealTime
from hil_bridge.devices.kinds import CanBus
from hil_bridge.errors import ConfigError
from hil_bridge.runs.session import Outputs, execute
from hil_bridge.settings.configuration import Config, RobotConfig, SensorConfig, ToolConfig, load_config
from hil_bridge.site import doctor, facts
from hil_bridge.site.facts import Fact, Level


def put(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        file = root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return root


def usb_port(root: Path, latency_ms: int | None = 16) -> Path:
    """Create an FTDI adapter as ttyUSB0."""
    device = root / "sys/devices/usb1/1-2"
    port = device / "1-2:1.0/ttyUSB0"
    put(
        root,
        {
            "sys/devices/usb1/1-2/idVendor": "0403\n",
            "sys/devices/usb1/1-2/idProduct": "6001\n",
            "sys/devices/usb1/1-2/product": "FT232R USB UART\n",
            "sys/bus/usb-serial/drivers/ftdi_sio/uevent": "",
            "dev/ttyUSB0": "",
            "proc/1/comm": "init\n",
        },
    )
    port.mkdir(parents=True)
    (port / "driver").symlink_to(root / "sys/bus/usb-serial/drivers/ftdi_sio")
    tty = root / "sys/class/tty/ttyUSB0"
    tty.mkdir(parents=True)
    (tty / "device").symlink_to(port)
    if latency_ms is not None:
        put(root, {"sys/bus/usb-serial/devices/ttyUSB0/latency_timer": f"{latency_ms}\n"})
    return root


CAN0 = {"sys/class/net/can0/type": "280\n", "sys/class/net/can0/flags": "0x40081\n"}
DETAILS = {"kind": "can", "bitrate": 1_000_000, "state": "ERROR-ACTIVE", "restart_ms": 100, "errors": (0, 0)}


def one(fact: Fact) -> tuple[Level, str]:
    return fact.level, str(fact)


def test_doctor_names_usb_adapter_and_warns_of_latency(tmp_path: Path) -> None:
    port, timer = facts.serial_ports(usb_port(tmp_path))
    assert port == facts.ok("serial port /dev/ttyUSB0", "FT232R USB UART (0403:6001, ftdi_sio)")
    assert timer.level is Level.WARN
    assert "16 ms" in timer.text
    assert "setserial /dev/ttyUSB0 low_latency" in timer.remedy


def test_doctor_accepts_low_or_missing_latency_timer(tmp_path: Path) -> None:
    assert [result.level for result in facts.serial_ports(usb_port(tmp_path / "a", 1))] == [
        Level.OK,
        Level.OK,
    ]
    assert len(list(facts.serial_ports(usb_port(tmp_path / "b", None)))) == 1


def test_doctor_port_without_permission_names_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = usb_port(tmp_path)
    monkeypatch.setattr("os.access", lambda path, mode: False)
    level, text = one(facts.serial_port(root, "ttyUSB0"))
    assert level is Level.FAIL
    assert "no permission; `sudo usermod -aG " in text


def test_doctor_port_in_use_names_the_program(tmp_path: Path) -> None:
    root = put(usb_port(tmp_path), {"proc/77/comm": "minicom\n", "proc/77/fd/0": ""})
    (root / "proc/77/fd/3").symlink_to("/dev/ttyUSB0")
    (root / "proc/77/fd/0").unlink()
    level, text = one(facts.serial_port(root, "ttyUSB0"))
    assert level is Level.WARN
    assert "in use by minicom (77)" in text


def test_doctor_omits_ports_without_hardware(tmp_path: Path) -> None:
    root = put(
        tmp_path,
        {
            "sys/class/tty/ttyS1/type": "0\n",
            "sys/class/tty/ttyS1/device/driver/x": "",
            "sys/class/tty/tty0/x": "",
        },
    )
    (result,) = facts.serial_ports(root)
    assert result.level is Level.WARN
    assert "none found" in result.text


@pytest.mark.parametrize(
    ("files", "details", "level", "message"),
    [
        (CAN0, DETAILS, Level.OK, "is up, 1000000 bit/s, error-active"),
        (
            {**CAN0, "sys/class/net/can0/flags": "0x40080"},
            DETAILS,
            Level.FAIL,
            "is down; `sudo ip link set can0 up type",
        ),
        (CAN0, {**DETAILS, "state": "BUS-OFF"}, Level.FAIL, "check cable and termination"),
        (CAN0, {**DETAILS, "state": "ERROR-PASSIVE", "errors": (0, 128)}, Level.WARN, "sent 0, received 128"),
        (CAN0, {**DETAILS, "restart_ms": 0}, Level.WARN, "restart-ms 100"),
        (CAN0, {"kind": "vcan"}, Level.OK, "virtual"),
        ({}, DETAILS, Level.FAIL, "no such CAN interface (known: none)"),
        ({"sys/class/net/can0/type": "1\n"}, DETAILS, Level.FAIL, "no such CAN interface"),
    ],
)
def test_doctor_checks_can_interfaces(tmp_path: Path, files, details, level, message) -> None:
    result = facts.can_interface(put(tmp_path, files), "can0", {"can0": details})
    assert result.level is level
    assert message in str(result)


def test_doctor_fails_on_wrong_can_bit_rate(tmp_path: Path) -> None:
    details = {"can0": {**DETAILS, "bitrate": 500_000}}
    bus = CanBus("a JR3 gateway", 1_000_000)
    result = facts.can_interface(put(tmp_path, CAN0), "can0", details, bus)
    assert result.level is Level.FAIL
    assert "a JR3 gateway uses 1000000; `sudo ip link set can0 down`" in str(result)
    assert facts.can_interface(put(tmp_path, CAN0), "can0", details).level is Level.OK


def test_doctor_without_iproute2_has_no_bit_rate(tmp_path: Path) -> None:
    can0, iproute2 = facts.can_interfaces(put(tmp_path, CAN0), None)
    assert one(can0) == (Level.OK, "ok    CAN interface can0: is up")
    assert iproute2.level is Level.WARN
    assert [f.text for f in facts.can_interfaces(tmp_path / "none", None)] == ["none"]


def test_link_details_are_read_from_iproute2_json() -> None:
    """Output of iproute2 6.1, shortened to the parts that are read."""
    text = json.dumps(
        [
            {"ifname": "lo"},
            {
                "ifname": "can0",
                "linkinfo": {
                    "info_kind": "can",
                    "info_data": {
                        "state": "ERROR-ACTIVE",
                        "berr_counter": {"tx": 0, "rx": 0},
                        "restart_ms": 100,
                        "bittiming": {"bitrate": 1000000, "sample_point": "0.750"},
                    },
                },
            },
        ]
    )
    assert facts.link_details(text) == {"can0": DETAILS}


@pytest.mark.parametrize(
    "text", ["", "{", "{}", "[1]", '[{"linkinfo": 1}]', '[{"linkinfo": {"info_data": 3}}]']
)
def test_link_details_tolerate_unexpected_json(text: str) -> None:
    assert all(not reported["bitrate"] for reported in facts.link_details(text).values())


def test_doctor_checks_clock_scheduler_and_processors(tmp_path: Path) -> None:
    source = "sys/devices/system/clocksource/clocksource0/current_clocksource"
    assert facts.clock_source(put(tmp_path, {source: "tsc\n"})).level is Level.OK
    assert facts.clock_source(put(tmp_path, {source: "hpet\n"})).level is Level.WARN
    assert facts.timer_slack(put(tmp_path, {"proc/self/timerslack_ns": "50000\n"})).text == "50 µs"
    assert facts.governors(tmp_path).level is Level.OK
    governor = "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"
    assert facts.governors(put(tmp_path, {governor: "powersave\n"})).level is Level.WARN
    assert facts.governors(put(tmp_path, {governor: "performance\n"})).text == "performance"
    assert facts.processors([0]).level is Level.WARN
    assert facts.processors([0, 1]).level is Level.OK
    assert facts.vcan(tmp_path, "6.1").level is Level.WARN
    assert (
        facts.vcan(
            put(tmp_path, {"lib/modules/6.1/modules.dep": "kernel/net/can/vcan.ko.xz:\n"}), "6.1"
        ).level
        is Level.OK
    )
    assert doctor.locked_memory(8 << 20, capable=False).level is Level.WARN
    assert doctor.locked_memory(-1, capable=False).level is Level.OK
    assert doctor.locked_memory(8 << 20, capable=True).level is Level.OK


@pytest.mark.parametrize(
    ("status", "may"),
    [
        ("Name:\tpython\nCapPrm:\t0000000000004000\nCapEff:\t0000000000004000\n", True),
        ("CapPrm:\t0000000000004000\nCapEff:\t000001ffffffbfff\n", False),
        ("Name:\tpython\n", False),
    ],
)
def test_privileged_process_may_lock_memory(tmp_path: Path, status: str, may: bool) -> None:
    assert facts.may_lock_memory(put(tmp_path, {"proc/self/status": status})) is may


def test_doctor_judges_wake_ups_by_99th_percentile() -> None:
    assert doctor.judge_lateness([1e-4] * 995 + [5e-3] * 5, RealTime()).level is Level.OK
    late = [1e-4] * 980 + [5e-3] * 20
    asleep = doctor.judge_lateness(late, RealTime())
    assert asleep.level is Level.WARN
    assert "99 % within 5000 µs" in asleep.text
    first, second, last = (asleep.remedy.index(word) for word in ("end other", "fifo_priority", "keep_awake"))
    assert first < second < last  # the order of docs/how-to/real-time.md
    for realtime, how in (
        (RealTime(keep_awake=True), "kept awake"),
        (RealTime(busy_poll_ms=1.0), "busy polling"),
    ):
        awake = doctor.judge_lateness(late, realtime)
        assert awake.level is Level.WARN
        assert how in awake.text
        assert "keep_awake" not in awake.remedy


def test_doctor_measures_wake_ups_with_thread_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = []

    @contextmanager
    def real_time_thread(realtime: RealTime) -> Iterator[None]:
        expected.append(realtime)
        if realtime.cpus:
            raise ConfigError("refused")
        yield

    monkeypatch.setattr(doctor, "real_time_thread", real_time_thread)
    monkeypatch.setattr(doctor, "CYCLES", 5)
    assert "kept awake, busy polling" in doctor.wake_ups(RealTime(keep_awake=True, busy_poll_ms=1.0)).text
    assert "kept awake" not in doctor.wake_ups(RealTime(keep_awake=True, cpus=(4096,))).text
    assert [realtime.keep_awake for realtime in expected] == [True, True]


def test_doctor_checks_keeping_processors_awake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(realtime_module, "LATENCY_FILE", str(tmp_path / "latency"))
    refused = doctor.keeping_awake(is_configured=False)
    assert refused.level is Level.WARN
    assert str(tmp_path / "latency") in refused.remedy
    (tmp_path / "latency").touch()
    assert "would ask" in doctor.keeping_awake(is_configured=False).text
    assert "` asks" in doctor.keeping_awake(is_configured=True).text


def test_doctor_unused_forbidden_port_is_a_warning(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(
        facts, "serial_ports", lambda root: iter([facts.fail("serial port", "no permission", "ask")])
    )
    first = next(doctor.computer(tmp_path, None, RealTime()))
    assert (first.level, first.text) == (Level.WARN, "no permission")


def findings(config: Config, root: Path, details=None) -> dict[str, Fact]:
    return {result.subject: result for result in doctor.wires(config, root, details)}


def test_doctor_checks_configured_wires(tmp_path: Path) -> None:
    root = put(usb_port(tmp_path), CAN0)
    config = Config(
        robot=RobotConfig(url="s3+serial:///dev/ttyUSB0?baudrate=9600&parity=E"),
        sensor=SensorConfig(url="jr3+can+socketcan://can0"),
        tool=ToolConfig(mass_kg=0.5),
    )
    result = findings(config, root, {"can0": DETAILS})
    assert {key: fact.level for key, fact in result.items()} == {
        "robot.url": Level.OK,
        "sensor.url": Level.OK,
    }


def test_doctor_follows_symbolic_link_to_port(tmp_path: Path) -> None:
    root = usb_port(tmp_path)
    (root / "dev/serial/by-id").mkdir(parents=True)
    (root / "dev/serial/by-id/robot").symlink_to("../../ttyUSB0")
    config = Config(robot=RobotConfig(url="s3+serial:///dev/serial/by-id/robot"))
    assert "ftdi_sio" in findings(config, root)["robot.url"].text


@pytest.mark.parametrize(
    ("robot", "sensor", "key", "message"),
    [
        ("s3+serial:///dev/ttyUSB9", "", "robot.url", "no such port"),
        ("s3+serial:///etc/nothing", "", "robot.url", "no such port"),
        ("s3+serail:///dev/ttyUSB0", "", "robot.url", "for example s3+serial:///dev/ttyUSB0"),
        ("s3+/dev/ttyUSB0", "", "robot.url", "'s3+/dev/ttyUSB0': the scheme is missing"),
        ("serial:///dev/ttyUSB0", "", "robot.url", "did you mean s3+serial:///dev/ttyUSB0?"),
        ("s3+memory:robot", "", "robot.url", "inside one process"),
        ("", "jr3+can+socketcan://can7", "sensor.url", "no such CAN interface"),
        ("", "jr3-uart+serial:///dev/ttyACM3", "sensor.url", "/dev/ttyACM3: no such port"),
        ("", "jr3+can+slcan:///dev/ttyACM3", "sensor.url", "/dev/ttyACM3: no such port"),
        ("", "jr3-board+tcp://127.0.0.1:1?filter=2", "sensor.url", "127.0.0.1 port 1: "),
        ("", "jr3+can+slcan+tcp://127.0.0.1:1", "sensor.url", "127.0.0.1 port 1: "),
    ],
)
def test_doctor_names_wires_that_cannot_work(tmp_path: Path, robot, sensor, key, message) -> None:
    config = Config(robot=RobotConfig(url=robot), sensor=SensorConfig(url=sensor))
    result = findings(config, usb_port(tmp_path))[key]
    assert result.level is Level.FAIL
    assert message in str(result)


def test_doctor_reports_refused_thread_settings(tmp_path: Path) -> None:
    result = findings(Config(realtime=RealTime(cpus=(4096,))), tmp_path)
    assert result["realtime"].level is Level.FAIL


REFUSED = {
    "force": "[task]\nforce_n = 60.0\n",
    "robot.url": '[robot]\nurl = "s3+foo://x"\n[sensor]\nurl = "netft+udp://127.0.0.1:1"\n',
    "sensor.url": '[robot]\nurl = "rtde+tcp://127.0.0.1:1"\n[sensor]\nurl = "netft+nonsense://x"\n',
    "wires": '[robot]\nurl = "s3+serial:///dev/ttyUSB0"\n',
    "tool": '[robot]\nurl = "s3+tcp://127.0.0.1:1"\n[sensor]\nurl = "jr3+can+socketcan://can0"\n',
    "panel": '[run]\npanel_url = "tcp-listen://127.0.0.1:0"\n'
    '[robot]\nurl = "s3+tcp://127.0.0.1:1"\n[sensor]\nurl = "jr3+can+socketcan://can0"\n',
    "cell": "[cell]\nstart_position_mm = [3000.0, 0.0, 0.0]\n",
    "cell: orders": '[robot.s3]\norders_file = "none.toml"\n',
    "realtime": "[realtime]\ncpus = [4096]\n",
}


@pytest.mark.parametrize("case", REFUSED)
def test_doctor_fails_whatever_run_refuses(tmp_path: Path, case: str) -> None:
    file = tmp_path / "site.toml"
    file.write_text(REFUSED[case])
    config = load_config(file, {})
    with pytest.raises(ConfigError) as refused:
        execute(config, False, Outputs(), False)
    result = findings(config, tmp_path)[case.partition(":")[0]]
    assert (result.level, result.text) == (Level.FAIL, str(refused.value))


def test_doctor_and_run_refuse_same_controllers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unfit(*_: object) -> None:
        raise ConfigError("predictive: window does not fit")

    monkeypatch.setattr("hil_bridge.runs.setup.control_loop", unfit)
    with pytest.raises(ConfigError, match="window does not fit"):
        execute(Config(), True, Outputs(), False)
    assert findings(Config(), tmp_path)["controller"].level is Level.FAIL


def test_doctor_exits_with_3_for_configured_items_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "wake_ups", lambda realtime: facts.ok("wake-ups", "on time"))
    assert CliRunner().invoke(cli, ["doctor"]).exit_code == 0
    file = tmp_path / "site.toml"
    file.write_text('[robot]\nurl = "s3+serial:///dev/ttyUSB99"\n')
    result = CliRunner().invoke(cli, ["doctor", str(file)])
    assert result.exit_code == 3
    assert "fail  robot.url: serial port /dev/ttyUSB99: no such port" in result.output

"""The doctor on computers laid out in a folder: what it says of them, and what to do."""

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
    """An FTDI adapter as ttyUSB0."""
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


def one(found: Fact) -> tuple[Level, str]:
    return found.level, str(found)


def test_a_usb_adapter_is_named_and_its_latency_is_warned_of(tmp_path: Path) -> None:
    port, timer = facts.serial_ports(usb_port(tmp_path))
    assert port == facts.ok("serial port /dev/ttyUSB0", "FT232R USB UART (0403:6001, ftdi_sio)")
    assert timer.level is Level.WARN
    assert "16 ms" in timer.text
    assert "setserial /dev/ttyUSB0 low_latency" in timer.remedy


def test_a_low_latency_timer_is_good_and_none_says_nothing(tmp_path: Path) -> None:
    assert [found.level for found in facts.serial_ports(usb_port(tmp_path / "a", 1))] == [Level.OK, Level.OK]
    assert len(list(facts.serial_ports(usb_port(tmp_path / "b", None)))) == 1


def test_a_port_without_permission_names_the_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = usb_port(tmp_path)
    monkeypatch.setattr("os.access", lambda path, mode: False)
    level, text = one(facts.serial_port(root, "ttyUSB0"))
    assert level is Level.FAIL
    assert "no permission; `sudo usermod -aG " in text


def test_a_port_that_another_program_holds_names_it(tmp_path: Path) -> None:
    root = put(usb_port(tmp_path), {"proc/77/comm": "minicom\n", "proc/77/fd/0": ""})
    (root / "proc/77/fd/3").symlink_to("/dev/ttyUSB0")
    (root / "proc/77/fd/0").unlink()
    level, text = one(facts.serial_port(root, "ttyUSB0"))
    assert level is Level.WARN
    assert "in use by minicom (77)" in text


def test_ports_without_hardware_are_left_out(tmp_path: Path) -> None:
    root = put(
        tmp_path,
        {
            "sys/class/tty/ttyS1/type": "0\n",
            "sys/class/tty/ttyS1/device/driver/x": "",
            "sys/class/tty/tty0/x": "",
        },
    )
    (found,) = facts.serial_ports(root)
    assert found.level is Level.WARN
    assert "none found" in found.text


@pytest.mark.parametrize(
    ("files", "details", "level", "words"),
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
def test_can_interfaces(tmp_path: Path, files, details, level, words) -> None:
    found = facts.can_interface(put(tmp_path, files), "can0", {"can0": details})
    assert found.level is level
    assert words in str(found)


def test_can_interface_at_another_rate_than_its_device_fails(tmp_path: Path) -> None:
    details = {"can0": {**DETAILS, "bitrate": 500_000}}
    bus = CanBus("a JR3 gateway", 1_000_000)
    found = facts.can_interface(put(tmp_path, CAN0), "can0", details, bus)
    assert found.level is Level.FAIL
    assert "a JR3 gateway speaks 1000000; `sudo ip link set can0 down`" in str(found)
    assert facts.can_interface(put(tmp_path, CAN0), "can0", details).level is Level.OK


def test_without_iproute2_the_bit_rate_is_not_told(tmp_path: Path) -> None:
    can0, iproute2 = facts.can_interfaces(put(tmp_path, CAN0), None)
    assert one(can0) == (Level.OK, "ok    CAN interface can0: is up")
    assert iproute2.level is Level.WARN
    assert [f.text for f in facts.can_interfaces(tmp_path / "none", None)] == ["none"]


def test_details_come_from_iproute2s_json() -> None:
    """As iproute2 6.1 prints it, shortened to what is read."""
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
def test_details_of_anything_else_are_taken_with_care(text: str) -> None:
    assert all(not told["bitrate"] for told in facts.link_details(text).values())


def test_clock_scheduler_and_processors(tmp_path: Path) -> None:
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
def test_who_may_lock_memory_whatever_the_limit(tmp_path: Path, status: str, may: bool) -> None:
    assert facts.may_lock_memory(put(tmp_path, {"proc/self/status": status})) is may


def test_wake_ups_are_judged_by_their_99th_percentile() -> None:
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


def test_wake_ups_are_measured_as_the_thread_would_be_run(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = []

    @contextmanager
    def real_time_thread(realtime: RealTime) -> Iterator[None]:
        wanted.append(realtime)
        if realtime.cpus:
            raise ConfigError("refused")
        yield

    monkeypatch.setattr(doctor, "real_time_thread", real_time_thread)
    monkeypatch.setattr(doctor, "CYCLES", 5)
    assert "kept awake, busy polling" in doctor.wake_ups(RealTime(keep_awake=True, busy_poll_ms=1.0)).text
    assert "kept awake" not in doctor.wake_ups(RealTime(keep_awake=True, cpus=(4096,))).text
    assert [realtime.keep_awake for realtime in wanted] == [True, True]


def test_whether_processors_may_be_kept_awake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(realtime_module, "LATENCY_FILE", str(tmp_path / "latency"))
    refused = doctor.keeping_awake(wanted=False)
    assert refused.level is Level.WARN
    assert str(tmp_path / "latency") in refused.remedy
    (tmp_path / "latency").touch()
    assert "would ask" in doctor.keeping_awake(wanted=False).text
    assert "` asks" in doctor.keeping_awake(wanted=True).text


def test_a_forbidden_port_without_a_setting_is_a_warning(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(
        facts, "serial_ports", lambda root: iter([facts.fail("serial port", "no permission", "ask")])
    )
    first = next(doctor.computer(tmp_path, None, RealTime()))
    assert (first.level, first.text) == (Level.WARN, "no permission")


def findings(config: Config, root: Path, details=None) -> dict[str, Fact]:
    return {found.subject: found for found in doctor.wires(config, root, details)}


def test_the_wires_of_a_configuration_are_checked(tmp_path: Path) -> None:
    root = put(usb_port(tmp_path), CAN0)
    config = Config(
        robot=RobotConfig(url="s3+serial:///dev/ttyUSB0?baudrate=9600&parity=E"),
        sensor=SensorConfig(url="jr3+can+socketcan://can0"),
        tool=ToolConfig(mass_kg=0.5),
    )
    found = findings(config, root, {"can0": DETAILS})
    assert {key: fact.level for key, fact in found.items()} == {"robot.url": Level.OK, "sensor.url": Level.OK}


def test_a_link_to_a_port_is_followed(tmp_path: Path) -> None:
    root = usb_port(tmp_path)
    (root / "dev/serial/by-id").mkdir(parents=True)
    (root / "dev/serial/by-id/robot").symlink_to("../../ttyUSB0")
    config = Config(robot=RobotConfig(url="s3+serial:///dev/serial/by-id/robot"))
    assert "ftdi_sio" in findings(config, root)["robot.url"].text


@pytest.mark.parametrize(
    ("robot", "sensor", "key", "words"),
    [
        ("s3+serial:///dev/ttyUSB9", "", "robot.url", "no such port"),
        ("s3+serial:///etc/nothing", "", "robot.url", "no such port"),
        ("s3+serail:///dev/ttyUSB0", "", "robot.url", "unknown scheme"),
        ("serial:///dev/ttyUSB0", "", "robot.url", "did you mean s3+serial:///dev/ttyUSB0?"),
        ("s3+memory:robot", "", "robot.url", "inside one process"),
        ("", "jr3+can+socketcan://can7", "sensor.url", "no such CAN interface"),
        ("", "jr3-uart+serial:///dev/ttyACM3", "sensor.url", "/dev/ttyACM3: no such port"),
        ("", "jr3+can+slcan:///dev/ttyACM3", "sensor.url", "/dev/ttyACM3: no such port"),
        ("", "jr3-board+tcp://127.0.0.1:1?filter=2", "sensor.url", "127.0.0.1 port 1: "),
        ("", "jr3+can+slcan+tcp://127.0.0.1:1", "sensor.url", "127.0.0.1 port 1: "),
    ],
)
def test_wires_that_cannot_work_are_named(tmp_path: Path, robot, sensor, key, words) -> None:
    config = Config(robot=RobotConfig(url=robot), sensor=SensorConfig(url=sensor))
    found = findings(config, usb_port(tmp_path))[key]
    assert found.level is Level.FAIL
    assert words in str(found)


def test_a_thread_that_the_machine_refuses_is_told(tmp_path: Path) -> None:
    found = findings(Config(realtime=RealTime(cpus=(4096,))), tmp_path)
    assert found["realtime"].level is Level.FAIL


REFUSED = {
    "force": "[task]\nforce_n = 60.0\n",
    "wires": '[robot]\nurl = "s3+serial:///dev/ttyUSB0"\n',
    "tool": '[robot]\nurl = "s3+tcp://127.0.0.1:1"\n[sensor]\nurl = "jr3+can+socketcan://can0"\n',
    "panel": '[run]\npanel_url = "tcp-listen://127.0.0.1:0"\n'
    '[robot]\nurl = "s3+tcp://127.0.0.1:1"\n[sensor]\nurl = "jr3+can+socketcan://can0"\n',
    "cell": "[cell]\nstart_position_mm = [3000.0, 0.0, 0.0]\n",
    "cell: orders": '[robot.s3]\norders_file = "none.toml"\n',
    "realtime": "[realtime]\ncpus = [4096]\n",
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_run_refuses_the_doctor_does_not_pass(tmp_path: Path, case: str) -> None:
    file = tmp_path / "site.toml"
    file.write_text(REFUSED[case])
    config = load_config(file, {})
    with pytest.raises(ConfigError) as refused:
        execute(config, False, Outputs(), False)
    found = findings(config, tmp_path)[case.partition(":")[0]]
    assert (found.level, found.text) == (Level.FAIL, str(refused.value))


def test_a_controller_that_cannot_be_made_is_refused_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unfit(*_: object) -> None:
        raise ConfigError("predictive: window does not fit")

    monkeypatch.setattr("hil_bridge.runs.setup.control_loop", unfit)
    with pytest.raises(ConfigError, match="window does not fit"):
        execute(Config(), True, Outputs(), False)
    assert findings(Config(), tmp_path)["controller"].level is Level.FAIL


def test_the_command_ends_with_3_only_for_what_a_configuration_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "wake_ups", lambda realtime: facts.ok("wake-ups", "on time"))
    assert CliRunner().invoke(cli, ["doctor"]).exit_code == 0
    file = tmp_path / "site.toml"
    file.write_text('[robot]\nurl = "s3+serial:///dev/ttyUSB99"\n')
    result = CliRunner().invoke(cli, ["doctor", str(file)])
    assert result.exit_code == 3
    assert "fail  robot.url: serial port /dev/ttyUSB99: no such port" in result.output

"""Files and recordings of version 0.5: refused in one line that names it; files are rewritten."""

import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.devices.kinds import EmulatedKinds
from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.devices.sensors.jr3.room import UART_GATEWAY
from hil_bridge.errors import ConfigError
from hil_bridge.record import read
from hil_bridge.settings.configuration import load_config, read_config
from hil_bridge.settings.kinds import settings_of
from hil_bridge.settings.upgrade import MOVED, RENAMED_KINDS, upgrade_text

OLD = Path(__file__).parent / "files_of_0_5"
RECORDING = Path(__file__).parent / "recordings" / "version_0_1_0.mcap"
EXAMPLES = Path(__file__).parents[2] / "examples"


def refused(tmp_path: Path, text: str) -> str:
    """The line with which a configuration is refused."""
    file = tmp_path / "cell.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        load_config(file, {})
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("text", "old", "new"),
    [
        ("[robot.link]\nbaudrate = 19200\n", "robot.link", "robot.s3.link"),
        ('[robot]\norders_file = "x.toml"\n', "robot.orders_file", "robot.s3.orders_file"),
        ("[sensor.uart]\nperiod_ms = 4.0\n", "sensor.uart", "sensor.jr3.uart"),
        ("[cell.servo]\ndamping_ratio = 0.7\n", "cell.servo", "cell.s3.servo"),
        ("[cell.uart_gateway]\nboot_s = 0.2\n", "cell.uart_gateway", "cell.jr3.uart"),
        ("[cell.board.second]\nserial_no = 3\n", "cell.board", "cell.jr3.board"),
    ],
)
def test_a_setting_of_0_5_is_answered_with_its_place_of_now(
    tmp_path: Path, text: str, old: str, new: str
) -> None:
    told = refused(tmp_path, text)
    assert f": {old} is now {new}: version 0.5 is the last that reads this form" in told
    assert "`hil-bridge config upgrade` rewrites the file" in told


def test_every_moved_key_is_a_setting_and_no_old_one_is() -> None:
    for old, new in MOVED.items():
        assert old != new
        values: dict[str, object] = {}
        table = values
        *sections, name = new.split(".")
        for section in sections:
            table = table.setdefault(section, {})  # type: ignore[assignment]
        table[name] = "" if name.endswith("_file") else {}
        read_config(values)
    for kind in RENAMED_KINDS.values():
        EmulatedKinds.named("s3", kind)


def test_a_recording_of_an_earlier_version_is_answered_with_the_last_that_reads_it() -> None:
    with pytest.raises(ConfigError) as error:
        read(RECORDING)
    assert str(error.value) == (
        f"{RECORDING} was recorded by version 0.1.0; 0.5 is the last version that reads it"
    )


@pytest.mark.parametrize("name", ["site", "inline", "defaults"])
def test_a_file_of_0_5_is_rewritten_and_read(name: str, tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"version 0\.5 is the last that reads this form|there is no sensor"
    ):
        load_config(OLD / f"{name}.toml", {})
    new = tmp_path / "new.toml"
    done = CliRunner().invoke(cli, ["config", "upgrade", str(OLD / f"{name}.toml"), str(new)])
    assert done.exit_code == 0, done.output
    assert done.output.endswith(f"wrote {new}\n")
    load_config(new, {})
    again, changes = upgrade_text(new.read_text())
    assert (again, changes) == (new.read_text(), []), "once is enough"


def test_comments_and_values_stay_where_they_are() -> None:
    before = (OLD / "site.toml").read_text()
    after, changes = upgrade_text(before)
    assert [line.partition("#")[2] for line in after.splitlines() if "emulated" not in line] == [
        line.partition("#")[2] for line in before.splitlines() if "emulated" not in line
    ]
    assert '# emulated = "jr3-board"' in after
    assert 'sensor.emulated = "board" is now "jr3-board"' in changes
    values = tomllib.loads(after)
    assert values["robot"]["url"] == "s3+serial:///dev/ttyUSB0?baudrate=9600&parity=E"
    assert values["robot"]["s3"] == {
        "orders_file": "site-orders.toml",
        "link": {"profile": "observed-client"},
    }
    assert values["sensor"]["url"] == "jr3-uart+serial:///dev/ttyACM0"
    assert values["sensor"]["jr3"] == {"uart": {"period_ms": 4.0}}


def test_inline_tables_move_too() -> None:
    config = read_config(tomllib.loads(upgrade_text((OLD / "inline.toml").read_text())[0]))
    robot, sensor = settings_of(config, S3), settings_of(config, UART_GATEWAY)
    assert robot.client.link.baudrate == robot.emulated.link.baudrate == 19200
    assert (sensor.client.uart.cutoff_hz, sensor.emulated.uart.boot_s) == (5.0, 0.2)
    assert config.cell.surface.stiffness_n_m == 8000.0


def test_the_defaults_of_0_5_are_those_of_now() -> None:
    assert read_config(tomllib.loads(upgrade_text((OLD / "defaults.toml").read_text())[0])) == read_config({})


def test_a_plan_of_0_5_becomes_the_plan_of_now(tmp_path: Path) -> None:
    new = tmp_path / "plan.toml"
    done = CliRunner().invoke(cli, ["config", "upgrade", str(OLD / "plan.toml"), str(new)])
    assert done.exit_code == 0, done.output
    assert new.read_text() == (EXAMPLES / "campaigns" / "guard.toml").read_text()


@pytest.mark.parametrize(
    ("section", "old", "new"),
    [
        ("robot", "tcp://10.0.0.1:4000", "s3+tcp://10.0.0.1:4000"),
        ("robot", "egm+udp-bind://0.0.0.0:6510", "egm+udp-bind://0.0.0.0:6510"),
        ("robot", "", ""),
        ("sensor", "can+slcan:///dev/ttyACM0", "jr3+can+slcan:///dev/ttyACM0"),
        ("sensor", "tcp://10.0.0.1:1?x=2&gateway=jr3", "jr3-uart+tcp://10.0.0.1:1?x=2"),
        ("sensor", "jr3+tcp://10.0.0.1:1762?filter=2", "jr3-board+tcp://10.0.0.1:1762?filter=2"),
        ("sensor", "jr3+can+memory:x", "jr3+can+memory:x"),
        ("sensor", "netft+udp://10.0.0.1:49152", "netft+udp://10.0.0.1:49152"),
    ],
)
def test_urls_get_their_kinds(section: str, old: str, new: str) -> None:
    assert upgrade_text(f'[{section}]\nurl = "{old}"\n')[0] == f'[{section}]\nurl = "{new}"\n'

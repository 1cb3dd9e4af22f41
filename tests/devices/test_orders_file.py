"""Files of a site: orders, and programs of the emulated controller."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from emulators.devices.s3 import S3Site
from hil_bridge.cli import cli
from hil_bridge.devices.robots.s3 import orders_file
from hil_bridge.devices.robots.s3.orders_file import parse_orders, read_orders
from hil_bridge.devices.robots.s3.program_folder import read_programs
from hil_bridge.devices.robots.s3.room import ROBOT as S3
from hil_bridge.devices.robots.s3.room import robot_site
from hil_bridge.errors import ConfigError
from hil_bridge.settings.configuration import Config, load_config
from hil_bridge.settings.kinds import settings_of
from protocol.devices.s3.arap import KNOWN
from protocol.marks import Mark

SITE = """\
# orders of our controller in addition to the usual ones
[read_register]
function = 6
meaning = "read a register"
mark = "observed"
suffixes = { 0 = "one register" }
order = [{ name = "number", byte = 8, type = "u16" }]
answer = [
    { name = "number", byte = 8, type = "u16" },
    # a register in units of 0.1 V
    { name = "value", byte = 10, type = "s16", scale = 0.1, unit = "V", mark = "assumed" },
]
emulator = { memory = "register", key = ["number"], initial = { value = 1.5 } }

[write_register]
function = 14
answer_length = 8
emulator = { memory = "register", key = ["number"] }

[[write_register.order]]
name = "number"
byte = 8
type = "u16"

[[write_register.order]]
name = "value"
byte = 10
type = "s16"
scale = 0.1

[send_program]
function = 1
blocks = "several"
order = [{ name = "program", byte = 8, type = "u16" }, { name = "content", byte = 10, type = "bytes" }]
"""


def test_orders_file_defines_orders() -> None:
    book = parse_orders(SITE, 128)
    assert book.names[-3:] == ("read_register", "write_register", "send_program")
    read = book.named("read_register")
    assert (read.function, read.suffixes, read.mark) == (6, {0: "one register"}, Mark.OBSERVED)
    number, value = read.answer.layout.fields
    assert (number.offset, number.format, number.mark) == (0, "H", Mark.OBSERVED)
    assert (value.offset, value.format, value.scale, value.unit) == (2, "h", 0.1, "V")
    assert value.mark is Mark.ASSUMED
    assert (read.emulation.memory, read.emulation.key) == ("register", ("number",))
    assert read.emulation.initial == {"value": 1.5}
    assert book.named("write_register").suffixes == {0: ""}
    send = book.named("send_program")
    assert send.order.encode({"program": 7, "content": b"x"}) == b"\0\7x"
    assert parse_orders("", 128).names == KNOWN.names


def test_orders_file_example_of_docstring_is_valid() -> None:
    lines = str(orders_file.__doc__).splitlines()
    example = "\n".join(line for line in lines if line.startswith("    "))
    read = parse_orders(example, 128).named("read_register")
    assert (read.order.layout.size, read.answer.layout.size) == (2, 4)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (
            'byte = 10, type = "s16"',
            'byte = 9, type = "s16"',
            ": read_register.answer.value.byte: bytes 9 to 10 overlap the field number at 8 to 9",
        ),
        ('"s16", scale', '"int", scale', ": read_register.answer.value.type: must be 'u8', 's8', "),
        (
            'mark = "assumed"',
            'mark = "sure"',
            ": read_register.answer.value.mark: must be 'observed', ",
        ),
        ('mark = "observed"', "mark = 1", ": read_register.mark: must be 'observed', "),
        (
            "function = 14",
            "function = 6",
            ": write_register.function: 6 is already the function of read_register",
        ),
        (
            "function = 14",
            "function = 24",
            ": write_register.function: the payload of 24 (move) is known; "
            "use another code, or extends = true to add fields",
        ),
        ("function = 14", "function = 256", ": write_register.function: 256 is outside 1 … 255"),
        (
            "function = 14",
            'function = "14"',
            ": write_register.function: must be a valid integer, got '14'",
        ),
        ("function = 14\n", "", ": write_register.function: is missing"),
        ("[send_program]", "[read_status]", ": read_status: this name belongs to an order"),
        (
            'name = "value"\nbyte = 10',
            'name = "value"\nbyte = 127',
            ": write_register.order.value.byte: the field ends with byte 128, past a block of 128 bytes",
        ),
        (
            'name = "value"\nbyte',
            'name = "number"\nbyte',
            ": write_register.order.number.name: the name number is used twice",
        ),
        ('name = "value"\nbyte', "byte", ": write_register.order.2.name: is missing"),
        (
            "scale = 0.1\n",
            "scal = 0.1\n",
            ": write_register.order.value.scal: unknown entry; known: name, byte, type, ",
        ),
        (
            "answer_length = 8",
            "answer_length = 7",
            ": write_register.answer_length: 7 must be between 8",
        ),
        (
            "answer_length = 8",
            "lenght = 8",
            ": write_register.lenght: unknown entry; known: fun",
        ),
        ("answer_length = 8", "order = 3", " is not valid TOML: "),
        (
            "initial = { value = 1.5 }",
            "initial = { value = 5000 }",
            ": read_register.emulator.initial.value: "
            "read_register answer: value = 5000 is outside -3276.8 … 3276.7 V",
        ),
        (
            "initial = { value",
            "inital = { value",
            ": read_register.emulator.inital: unknown entry; known: memory, key, initial",
        ),
        (
            'key = ["number"] }\n\n[[',
            'key = ["n"] }\n\n[[',
            ": write_register.emulator.key: the order has no",
        ),
        (
            '{ 0 = "one register" }',
            '{ one = "" }',
            ": read_register.suffixes.one: a suffix must be a whole number",
        ),
        ('{ 0 = "one register" }', "{}", ": read_register.suffixes: "),
        ('blocks = "several"', 'blocks = "many"', ": send_program.blocks: must be 'one' or 'several'"),
        (
            'blocks = "several"',
            "order_length = 12",
            ": send_program.order_length: a field of type bytes sets",
        ),
        (
            'type = "bytes"',
            'type = "bytes", scale = 2.0',
            ": send_program.order.content: a field of type bytes has no scale",
        ),
        (
            'byte = 8, type = "u16" }, {',
            'byte = 8, type = "bytes" }, {',
            ": send_program.order.program.type: only the last field",
        ),
        (
            "[send_program]",
            "move = 3\n[send_program]",
            ": write_register.order.value.move: unknown entry",
        ),
    ],
)
def test_orders_file_error_names_file_and_entry(before: str, after: str, message: str) -> None:
    assert SITE.count(before) == 1, f"{before!r} occurs {SITE.count(before)} times in the sample"
    with pytest.raises(ConfigError) as caught:
        parse_orders(SITE.replace(before, after), 128, "site.toml")
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"site.toml{message}")


def test_orders_file_entry_must_be_table() -> None:
    with pytest.raises(ConfigError, match=r"site\.toml: x: must be a table, got 3"):
        parse_orders("# nothing\nx = 3", 128, "site.toml")


def test_orders_file_unreadable_is_named(tmp_path: Path) -> None:
    (tmp_path / "latin.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match=r"latin\.toml is not valid utf-8"):
        read_orders(tmp_path / "latin.toml", 128)
    with pytest.raises(ConfigError, match="No such file"):
        read_orders(tmp_path / "none.toml", 128)
    with pytest.raises(ConfigError, match="No such file"):
        read_programs(tmp_path / "none", 128)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["main.prg"], "name it by its program number"),
        (["65536"], "0 to 65535"),
        (["7", "07.prg"], "program 7 has two files"),
    ],
)
def test_program_files_are_read_by_number(tmp_path: Path, names: list[str], message: str) -> None:
    for name in names:
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(ConfigError, match=message):
        read_programs(tmp_path, 128)


def test_program_file_too_long_is_refused(tmp_path: Path) -> None:
    (tmp_path / "7.prg").write_bytes(bytes(4096 * 52 - 3))
    assert len(read_programs(tmp_path, 128)) == 1
    with pytest.raises(ConfigError, match="too long to be received, at most 212988 bytes"):
        read_programs(tmp_path, 60)


def site_of(config: Config) -> S3Site:
    return robot_site(settings_of(config, S3))


def test_files_are_relative_to_configuration(tmp_path: Path) -> None:
    programs = tmp_path / "programs"
    programs.mkdir()
    (programs / "7.prg").write_bytes(b"seven")
    (programs / ".hidden").write_bytes(b"")
    (tmp_path / "site.toml").write_text(SITE)
    path = tmp_path / "hil.toml"
    path.write_text(
        '[robot.s3]\norders_file = "site.toml"\n[cell.s3.robot]\nprogram_folder = "programs"\n'
        '[controller]\nname = "fuzzy"\nparameters.rules_file = "rules.toml"\n'
    )
    with pytest.raises(ConfigError, match=str(tmp_path / "rules.toml")):
        load_config(path, {})
    path.write_text(path.read_text().rpartition("[controller]")[0])
    site = site_of(load_config(path, {}))
    assert site.programs == {7: b"seven"}
    assert "read_register" in site.orders.names
    for invalid in ("robot = 3", "[robot]\norders_file = 3"):
        path.write_text(invalid)
        with pytest.raises(ConfigError, match=r"hil\.toml: robot"):
            load_config(path, {})
    empty = site_of(load_config(None, {}))
    assert (empty.orders, empty.programs) == (KNOWN, {})


def test_decode_uses_orders_file(tmp_path: Path) -> None:
    path = tmp_path / "site.toml"
    path.write_text(SITE)
    block = "10 02 00 0A 01 00 06 01 00 00 00 03 10 03 0C"
    result = CliRunner().invoke(cli, ["decode", "computer-link", "--orders", str(path), block])
    (item,) = json.loads(result.output)
    assert (result.exit_code, item["header"]["order"]) == (0, "read_register")
    assert [(field["name"], field["value"]) for field in item["fields"]] == [("number", 3)]
    path.write_text(SITE.replace("function = 14", "function = 6"))
    result = CliRunner().invoke(cli, ["decode", "computer-link", "--orders", str(path), block])
    assert isinstance(result.exception, ConfigError)

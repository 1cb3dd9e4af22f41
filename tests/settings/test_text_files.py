"""Hostile texts, for every reader of a file: a message of one line and exit code 2, no traceback."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hil_bridge.cli
from hil_bridge.control.laws.rules import parse_rules, read_rules
from hil_bridge.devices.robots.s3.orders_file import parse_orders, read_orders
from hil_bridge.devices.robots.s3.program_folder import read_programs
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import TOML_LIMIT_BYTES, format_value, parse_json, read_text
from hil_bridge.record import Recording
from hil_bridge.runs.replay import changes_of, recorded_config
from hil_bridge.settings.configuration import Config, dump, load_config, read_config
from hil_bridge.site.tool.files import read_poses
from hil_bridge.transports.urls import CONNECT_BYTES, CONNECT_CAN, LISTEN_BYTES, parse_url

DEEP = 10_000
HOSTILE = {
    "nested arrays": "x = " + "[" * DEEP + "]" * DEEP,
    "nested tables": "x = " + "{a=" * DEEP + "1" + "}" * DEEP,
    "dotted key": ".".join("a" * DEEP) + " = 1",
    "dotted header": f"[{'.'.join('a' * DEEP)}]\nx = 1",
    "array in an array": "x = " + "[" * 40 + "]" * 40,
    "decimal digits": f"x = {'9' * 5000}",
    "hexadecimal digits": f"x = 0x{'f' * 20_000}",
    "65 bits": f"[run]\nseed = {1 << 64}",
    "NUL in a text": '[robot]\nx = "a\\u0000b"',
    "NUL in a path": '[robot]\norders_file = "a\\u0000b"',
    "line break in a key": '[run]\n"a\\nb" = 1',
}
READERS: dict[str, Callable[[Path], object]] = {
    "configuration": lambda path: load_config(path, {}),
    "changes": lambda path: changes_of(path, None),
    "orders": lambda path: read_orders(path, 240),
    "rules": read_rules,
}


def one_line(error: ConfigError) -> str:
    text = str(error)
    assert "\n" not in text
    assert len(text) < 1000
    return text


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_hostile_toml_file_is_refused_in_one_line(
    tmp_path: Path, reader: Callable[[Path], object], text: str
) -> None:
    path = tmp_path / "h.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        reader(path)
    assert "h.toml" in one_line(caught.value)


@pytest.mark.parametrize("reader", [*READERS.values(), read_poses], ids=[*READERS, "poses"])
def test_invalid_path_or_binary_file_is_one_line(tmp_path: Path, reader: Callable[[Path], object]) -> None:
    (tmp_path / "bytes").write_bytes(b"\xff\xfe")
    for path, reason in (
        (Path("a\0b"), "its path contains a NUL$"),
        (Path("a\nb"), "No such file"),
        (Path("x" * 5000), "too long"),
        (tmp_path / "bytes", "is not valid utf-8"),
        (tmp_path, "Is a directory"),
    ):
        with pytest.raises(ConfigError, match=reason) as caught:
            reader(path)
        assert "\n" not in str(caught.value)


def test_program_folder_is_not_trusted(tmp_path: Path) -> None:
    (tmp_path / "7.prg").write_bytes(bytes(1 << 20))
    with pytest.raises(ConfigError, match=r"7\.prg: too long to be received"):
        read_programs(tmp_path, 240)
    with pytest.raises(ConfigError, match=r"its path contains a NUL$"):
        read_programs(Path("a\0b"), 240)
    (tmp_path / "7.prg").rename(tmp_path / "a\nb")
    with pytest.raises(ConfigError, match="name it by its program number") as caught:
        read_programs(tmp_path, 240)
    one_line(caught.value)


def test_too_large_file_is_not_read_completely(tmp_path: Path) -> None:
    path = tmp_path / "long.toml"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(ConfigError, match=r"long\.toml is too large; allowed: at most 1048576 bytes"):
        load_config(path, {})
    with pytest.raises(ConfigError, match="too large"):
        read_text(path, TOML_LIMIT_BYTES)


@pytest.mark.parametrize("text", ["[" * DEEP, "[" * 40 + "]" * 40, "9" * 5000, str(1 << 64), '"\\u0000"'])
def test_hostile_recorded_configuration_is_one_line(text: str) -> None:
    with pytest.raises(ValueError, match=r"deep|digits|64 bits|NUL"):
        parse_json(text)
    with pytest.raises(ConfigError) as caught:
        recorded_config(Recording((), metadata={"config": text}), {})
    one_line(caught.value)


def test_long_invalid_value_is_truncated_in_message(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text(f'[run]\nduration_s = "{"x" * 100_000}"')
    with pytest.raises(ConfigError, match=r"must be a valid number, .*got .xxx") as caught:
        load_config(path, {})
    one_line(caught.value)


@pytest.mark.parametrize(
    "arguments",
    [
        ("replay", "a\0b"),
        ("replay", "r.mcap", "a\0b"),
        ("report", "a\0b"),
        ("report", "r.mcap", "--output", "a\0b"),
        ("latency", "a\0b"),
        ("monitor", "a\0b"),
        ("monitor", "r.mcap", "--config", "a\0b"),
        ("config", "init", "a\0b"),
        ("list", "facts", "a\0b"),
        ("doctor", "a\0b"),
        ("decode", "computer-link", "10", "--orders", "a\0b"),
        ("probe", "robot", "s3+serial:///dev/tty%00"),
        ("probe", "robot", "s3+serial:///dev/tty", "-o", "a\0b"),
        ("probe", "robot", f"s3+tcp://127.0.0.1:{'9' * 5000}"),
        ("emulate", "cell", "a\0b"),
        ("emulate", "robot", "--robot-port", "s3+pty:?link=/tmp/a%00b"),
        ("identify", "tool", "--from", "a\0b"),
        ("campaign", "experiment", "rules", "--output", "a\0b"),
        ("emulate", "jr3-pci", "--pci", "0000:03:00.0", "--program", "a\0b"),
        ("doctor", "deep.toml"),
        ("list", "facts", "deep.toml"),
        ("emulate", "cell", "deep.toml"),
        ("decode", "computer-link", "10", "--orders", "deep.toml"),
    ],
)
def test_command_line_reports_hostile_file_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: tuple[str, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("deep.toml").write_text(HOSTILE["nested arrays"])
    monkeypatch.setattr(sys, "argv", ["hil-bridge", *arguments])
    with pytest.raises(SystemExit) as ended:
        hil_bridge.cli.main()
    errors = capfd.readouterr().err
    assert (ended.value.code, errors.count("\n")) == (2, 1), errors


# --- whatever a generator comes upon

SCALARS = st.one_of(
    st.integers().map(str),
    st.sampled_from(
        ["nan", "inf", "-inf", "1e999", "true", "1979-05-27", "07:32:00", "1979-05-27T07:32:00Z"]
    ),
    st.floats().map(repr),
    st.text(st.characters(exclude_characters='"\\', exclude_categories=("Cc", "Cs")), max_size=5).map(
        '"{}"'.format
    ),
    st.sampled_from(['""', '"a\\u0000b"', '"\\n"', '"\\uFFFF"']),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=7).map(lambda items: f"[{', '.join(items)}]"),
        st.tuples(st.sampled_from(["name", "byte", "x", "url", "0"]), inner).map(
            lambda p: f"{{ {p[0]} = {p[1]} }}"
        ),
    ),
    max_leaves=8,
)


def setting_names(prefix: str, value: object) -> list[str]:
    if isinstance(value, dict):
        return [
            name
            for key, item in value.items()
            for name in (f"{prefix}{key}", *setting_names(f"{prefix}{key}.", item))
        ]
    return []


NAMES = setting_names("", Config().model_dump())


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(NAMES), VALUES), max_size=3))
def test_fuzzed_setting_is_accepted_or_one_line(
    tmp_path_factory: pytest.TempPathFactory, pairs: list[tuple[str, str]]
) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzzed.toml"
    path.write_text("\n".join(f"{name} = {value}" for name, value in pairs), encoding="utf-8")
    try:
        config = load_config(path, {})
    except ConfigError as error:
        one_line(error)
    else:
        assert dump(read_config(json.loads(dump(config)))) == dump(config)


ORDER_KEYS = [
    "function",
    "meaning",
    "mark",
    "suffixes",
    "order_length",
    "answer_length",
    "order",
    "answer",
    "emulator",
]
RULE_KEYS = [
    "levels",
    "terms",
    "error",
    "error.terms",
    "change.levels",
    "output",
    "inference",
    "inference.rules",
]


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(ORDER_KEYS), VALUES), max_size=4))
def test_fuzzed_orders_file_is_accepted_or_one_line(pairs: list[tuple[str, str]]) -> None:
    try:
        orders = parse_orders("[o]\n" + "\n".join(f"{name} = {value}" for name, value in pairs), 240)
    except ConfigError as error:
        one_line(error)
    else:
        assert [order.name for order in orders.site] == ["o"]


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(RULE_KEYS), VALUES), max_size=4))
def test_fuzzed_rules_file_is_accepted_or_one_line(pairs: list[tuple[str, str]]) -> None:
    try:
        rules = parse_rules("\n".join(f"{name} = {value}" for name, value in pairs))
    except ConfigError as error:
        one_line(error)
    else:
        assert rules.rules


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(["serial", "tcp", "rfc2217", "memory", "can+slcan", "pty", "tcp-listen"]),
    st.text(st.sampled_from("/:@[]?&=%0019#a\0\n٣²"), max_size=20),
)
def test_fuzzed_url_is_accepted_or_one_line(scheme: str, rest: str) -> None:
    for schemes in (CONNECT_BYTES, CONNECT_CAN, LISTEN_BYTES):
        try:
            parsed = parse_url(f"{scheme}:{rest}", schemes)
        except ConfigError as error:
            one_line(error)
        else:
            assert parsed.scheme == scheme


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.1 + 0.2, "0.3"),
        (-10 / 3, "-3.33333333"),
        (1e-17, "1e-17"),
        (0.25, "0.25"),
        ("0.30000000000000004", "'0.300"),
    ],
)
def test_long_number_is_rounded_in_messages(value: object, text: str) -> None:
    assert format_value(value).startswith(text)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32"])
def test_configuration_with_byte_order_mark_is_read(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "c.toml"
    path.write_text("[run]\r\nduration_s = 7.0  # µ\r\n", encoding=encoding, newline="")
    assert load_config(path, {}).run.duration_s == 7.0

"""PCI board whose memory is a file: position of its words, its program, and invalid boards."""

from collections.abc import Callable
from pathlib import Path
from unittest import mock

import pytest
from click.testing import CliRunner

from emulators.devices.jr3.board import Board
from hil_bridge.cli import cli
from hil_bridge.devices.sensors.jr3.registers import open_pci, read_program
from hil_bridge.errors import BridgeError, ConfigError, DeviceError, TransportUnavailable
from protocol.devices.jr3.registers import ProgramWord, ResetRefused
from protocol.endpoint import RemoteProtocolError

BLOCK = 0x80000


@pytest.fixture
def sysfs(tmp_path: Path) -> Path:
    """One board of two channels."""
    folder = tmp_path / "0000:03:00.0"
    folder.mkdir()
    (folder / "vendor").write_text("0x1762\n")
    (folder / "device").write_text("0x3112\n")
    (folder / "enable").write_text("1\n")
    (folder / "resource0").write_bytes(bytes(2 * BLOCK))
    return tmp_path


def put(sysfs: Path, byte: int, *values: int) -> None:
    with (sysfs / "0000:03:00.0" / "resource0").open("r+b") as file:
        file.seek(byte)
        for value in values:
            file.write(value.to_bytes(4, "little"))


def get(sysfs: Path, byte: int) -> int:
    data = (sysfs / "0000:03:00.0" / "resource0").read_bytes()
    return int.from_bytes(data[byte : byte + 4], "little")


@pytest.mark.parametrize("address", ["0000:03:00.0", "03:00.0"])
@pytest.mark.parametrize(("channel", "offset"), [(0, 0x18000), (1, 0x18000), (1, 0x10000)])
def test_pci_words_are_spaced_by_four_bytes(sysfs: Path, address: str, channel: int, offset: int) -> None:
    at = channel * BLOCK + offset
    put(sysfs, at + 4 * 0x90, 0xDEAD4000, 0x0000FFFF)
    board = open_pci(address, channel, offset, sysfs=sysfs)
    assert board.read(0x90, 3) == (0x4000, 0xFFFF, 0)
    board.write(0xE5, (1, 2, 0x0800))
    board.close()
    board.close()
    assert [get(sysfs, at + 4 * word) for word in (0xE5, 0xE6, 0xE7)] == [1, 2, 0x0800]


def test_pci_copyright_confirms_offset_of_words(sysfs: Path) -> None:
    put(sysfs, 0x18000 + 4 * 0x40, *(ord(letter) << 8 for letter in "Copyright  JR3,  Inc   1994"[:24]))
    board = open_pci("03:00.0", sysfs=sysfs)
    assert board.text == "Copyright JR3, Inc 1"
    board.close()
    elsewhere = open_pci("03:00.0", offset=0x10000, sysfs=sysfs)
    assert elsewhere.text == ""
    elsewhere.close()


def test_pci_words_outside_block_are_refused(sysfs: Path) -> None:
    board = open_pci("03:00.0", offset=0x3FF00, sysfs=sysfs)
    assert board.read(0x3F, 1) == (0,)
    for address, count in ((0x40, 1), (0x3F, 2), (-1, 1), (0, 0)):
        with pytest.raises(RemoteProtocolError):
            board.read(address, count)
    with pytest.raises(RemoteProtocolError):
        board.write(0x40, (1,))
    board.close()


def test_pci_reset_without_program_is_refused(sysfs: Path) -> None:
    board = open_pci("03:00.0", channel=1, sysfs=sysfs)
    with pytest.raises(ResetRefused, match="no program file was given"):
        board.reset()
    board.close()
    put(sysfs, BLOCK + 0x60000, 77)
    program = (ProgramWord(0, 0x1234, 0x56), ProgramWord(0x3FFF, 0xABCD, 0xEF))
    board = open_pci("03:00.0", channel=1, program=program, sysfs=sysfs)
    board.reset()
    board.close()
    at = [BLOCK + byte for byte in (0x60000, 0, 0x40000, 4 * 0x3FFF, 0x40000 + 4 * 0x3FFF)]
    assert [get(sysfs, byte) for byte in at] == [0, 0x1234, 0x56, 0xABCD, 0xEF]


def test_pci_client_program_replaces_board_program(sysfs: Path) -> None:
    put(sysfs, BLOCK + 0x60000, 77)
    board = open_pci("03:00.0", channel=1, sysfs=sysfs)
    board.load(0, ())
    board.load(0x3FFE, (0x1234, 0x56, 0xABCD, 0xEF))
    with pytest.raises(RemoteProtocolError, match="not within the program's memory"):
        board.load(0x3FFF, (1, 2, 3, 4))
    board.close()
    at = [BLOCK + byte for byte in (0x60000, 4 * 0x3FFE, 4 * 0x3FFF, 0x40000 + 4 * 0x3FFF)]
    assert [get(sysfs, byte) for byte in at] == [0, 0x1234, 0xABCD, 0xEF]


@pytest.mark.parametrize(
    ("text", "message"),
    [(None, "cannot read"), ("0002 0000 1 2", "is not a board program: it has no end mark")],
)
def test_run_with_invalid_board_program_is_refused(tmp_path: Path, text: str | None, message: str) -> None:
    path, config = tmp_path / "p.idm", tmp_path / "run.toml"
    if text is not None:
        path.write_text(text)
    config.write_text(f'[sensor]\nemulated = "jr3-board"\n[sensor.jr3.board]\nprogram = "{path}"\n')
    ended = CliRunner().invoke(cli, ["run", str(config), "--virtual", "--no-view"])
    assert isinstance(ended.exception, ConfigError)
    assert message in str(ended.exception)
    assert "\n" not in str(ended.exception)


def test_run_loads_configured_board_program(tmp_path: Path) -> None:
    path, config = tmp_path / "p.idm", tmp_path / "run.toml"
    path.write_text("0002 0000 1 2 ffff")
    config.write_text(
        f'[sensor]\nemulated = "jr3-board"\n[sensor.jr3.board]\nprogram = "{path}"\n[run]\nduration_s = 1.0\n'
    )
    loaded: list[tuple[int, ...]] = []
    with mock.patch.object(Board, "load", lambda self, address, words, now: loaded.append((address, *words))):
        ended = CliRunner().invoke(cli, ["run", str(config), "--virtual", "--no-view"])
    assert ended.exit_code == 0, ended.stderr
    assert loaded == [(0,), (0, 1, 2)]


def test_board_program_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "jr3pci.idm"
    path.write_text("0004\n0010\n1111 0022\n3333 0044\n0002\n4000\n9999 9999\n0002 0000\n5555 0066\nffff\n")
    assert read_program(path) == (
        ProgramWord(0x10, 0x1111, 0x22),
        ProgramWord(0x11, 0x3333, 0x44),
        ProgramWord(0, 0x5555, 0x66),
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0004 0010 1111 0022", "has no end mark"),
        ("0001 0010 1111 ffff", "1 words for 0x0010"),
        ("0004 3fff 1 2 3 4 ffff", "4 words for 0x3fff"),
        ("0002 0000 12345 0 ffff", "2 words for 0x0000"),
        ("ffff", "it is empty"),
        ("µ", "is not valid ascii"),
    ],
)
def test_board_program_file_invalid_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "p.idm"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_program(path)
    with pytest.raises(ConfigError, match="cannot read"):
        read_program(tmp_path / "nothing")


def change(name: str, text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(text)


@pytest.mark.parametrize(
    ("spoil", "options", "kind", "message"),
    [
        (
            None,
            {"address": "3:0"},
            ConfigError,
            "must be an address such as 0000:03:00.0, got '3:0'; `lspci -d 1762:`",
        ),
        (None, {"address": "03:00.9"}, ConfigError, "must be an address such as"),
        (None, {"address": "../../x"}, ConfigError, "must be an address such as"),
        (None, {"address": "04:00.0"}, TransportUnavailable, "PCI device 0000:04:00.0 does not exist"),
        (
            None,
            {"channel": 2},
            ConfigError,
            r"--channel: must be one of 0, 1 on this board \(1762:3112\), got 2",
        ),
        (None, {"channel": -1}, ConfigError, "--channel"),
        (
            None,
            {"offset": 0x18001},
            ConfigError,
            "--offset: must be a multiple of 4 below 0x40000, got 0x18001",
        ),
        (None, {"offset": 0x40000}, ConfigError, "--offset"),
        (change("vendor", "0x8086\n"), {}, DeviceError, "0000:03:00.0 is 8086:3112, not a JR3 board"),
        (change("device", "0x1112\n"), {}, DeviceError, "is 1762:1112, not a JR3 board"),
        (change("device", "?\n"), {}, TransportUnavailable, "cannot read its type from"),
        (change("enable", "0\n"), {}, DeviceError, "is disabled"),
        (change("resource0", "x"), {}, DeviceError, "has 1 bytes, channel 0 needs 524288"),
        (lambda folder: (folder / "resource0").unlink(), {}, TransportUnavailable, "it has no memory to map"),
    ],
)
def test_pci_wrong_board_is_reported_in_one_line(
    sysfs: Path,
    spoil: Callable[[Path], object] | None,
    options: dict[str, object],
    kind: type[BridgeError],
    message: str,
) -> None:
    if spoil is not None:
        spoil(sysfs / "0000:03:00.0")
    with pytest.raises(kind, match=message) as caught:
        open_pci(**{"address": "03:00.0", "sysfs": sysfs, **options})  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (1, "the kernel forbids it"),
        (13, "no permission; run as root"),
        (22, "the kernel forbids it"),
        (5, "Input"),
    ],
)
def test_pci_kernel_refusal_is_reported(
    sysfs: Path, monkeypatch: pytest.MonkeyPatch, number: int, message: str
) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise OSError(number, "Input/output error")

    monkeypatch.setattr("mmap.mmap", refuse)
    with pytest.raises(TransportUnavailable, match=message):
        open_pci("03:00.0", sysfs=sysfs)
    monkeypatch.undo()
    monkeypatch.setattr("os.open", refuse)
    with pytest.raises(TransportUnavailable, match=message):
        open_pci("03:00.0", sysfs=sysfs)


def test_emulate_jr3_pci_reports_errors(sysfs: Path) -> None:
    def refusal(*options: str) -> str:
        result = CliRunner().invoke(cli, ["emulate", "jr3-pci", *options])
        assert result.exit_code
        return str(result.exception) if isinstance(result.exception, BridgeError) else result.output

    assert "not a JR3" not in refusal("--pci", "03:00.0", "--sysfs", str(sysfs), "--channel", "2")
    assert "must be a number such as 0x18000, got 'x'" in refusal("--pci", "03:00.0", "--offset", "x")
    assert "does not exist" in refusal("--pci", "09:00.0", "--sysfs", str(sysfs))
    assert "host and port must be such as" in refusal(
        "--pci", "03:00.0", "--sysfs", str(sysfs), "--listen", "here"
    )

"""Programs of the emulated controller, one file per program. The file name contains the program number: `7`,
`7.prg`.
"""

from collections.abc import Mapping
from pathlib import Path

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, open_ordinary, read_up_to, refuse_nul
from protocol.devices.s3.adlp import HEADER_SIZE, MESSAGE_LIMIT

NUMBER_LIMIT = 0xFFFF
"""Largest program number that fits into a word."""


def read_programs(folder: Path, max_telegram: int) -> Mapping[int, bytes]:
    """Return the contents of the programs by number. Hidden files are ignored. Raises ConfigError that names the
    invalid file.
    """
    size_limit = MESSAGE_LIMIT * (max_telegram - HEADER_SIZE) - 4
    contents: dict[int, bytes] = {}
    refuse_nul(folder, format_path(folder))
    try:
        for path in sorted(folder.iterdir()):
            if path.name.startswith("."):
                continue
            number = _number(path)
            if number in contents:
                raise ConfigError(f"{path}: program {number} has two files; remove one of them")
            with open_ordinary(path) as file:
                contents[number] = read_up_to(file, size_limit + 1)
            if len(contents[number]) > size_limit:
                raise ConfigError(f"{format_path(path)}: too long to be received, at most {size_limit} bytes")
    except OSError as error:
        raise ConfigError(f"cannot read {error.filename or folder}: {error.strerror}") from error
    return contents


def _number(path: Path) -> int:
    stem = path.name.partition(".")[0]
    if not (stem.isascii() and stem.isdecimal() and int(stem) <= NUMBER_LIMIT):
        raise ConfigError(
            f"{format_path(path)}: name it by its program number, 0 to {NUMBER_LIMIT}, as in 7.prg"
        )
    return int(stem)

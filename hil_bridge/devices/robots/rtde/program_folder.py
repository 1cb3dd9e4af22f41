"""Programs that the emulated controller holds: text in URScript, one file each, `NAME.script`."""

from collections.abc import Mapping
from pathlib import Path

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, open_ordinary, read_up_to, refuse_nul

FILES_MAX = 256
"""Chosen: programs of a folder."""
_SUFFIX = ".script"


def read_programs(folder: Path, room: int) -> Mapping[str, bytes]:
    """Texts by name, each of `room` bytes at most. Others are passed over. Raises ConfigError that names a file."""
    programs: dict[str, bytes] = {}
    refuse_nul(folder, format_path(folder))
    try:
        for path in sorted(folder.glob(f"*{_SUFFIX}")):
            if len(programs) == FILES_MAX:
                raise ConfigError(f"{format_path(folder)}: more than {FILES_MAX} programs; remove some")
            with open_ordinary(path) as file:
                text = read_up_to(file, room + 1)
            if len(text) > room:
                raise ConfigError(f"{format_path(path)}: too long for a program, at most {room} bytes")
            programs[path.stem] = text
        if not programs:
            next(folder.iterdir(), None)  # a folder that is not there is told by its name
    except OSError as error:
        raise ConfigError(f"cannot read {error.filename or folder}: {error.strerror}") from error
    return programs

"""Programs of the emulated controller as URScript text, one file `NAME.script` per program."""

from collections.abc import Mapping
from pathlib import Path

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, open_ordinary, read_up_to, refuse_nul

FILES_MAX = 256
"""Maximum number of programs in a folder. Chosen."""
_SUFFIX = ".script"


def read_programs(folder: Path, size_limit: int) -> Mapping[str, bytes]:
    """Return the program texts by name, each of at most `size_limit` bytes. Other files are ignored. Raises
    ConfigError that names the invalid file.
    """
    programs: dict[str, bytes] = {}
    refuse_nul(folder, format_path(folder))
    try:
        for path in sorted(folder.glob(f"*{_SUFFIX}")):
            if len(programs) == FILES_MAX:
                raise ConfigError(f"{format_path(folder)}: more than {FILES_MAX} programs; remove some")
            with open_ordinary(path) as file:
                text = read_up_to(file, size_limit + 1)
            if len(text) > size_limit:
                raise ConfigError(f"{format_path(path)}: too long for a program, at most {size_limit} bytes")
            programs[path.stem] = text
        if not programs:
            next(folder.iterdir(), None)  # raises an error that names a missing folder
    except OSError as error:
        raise ConfigError(f"cannot read {error.filename or folder}: {error.strerror}") from error
    return programs

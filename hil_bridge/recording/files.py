"""Writing a file whole or not at all."""

import os
from pathlib import Path

from hil_bridge.errors import ConfigError


def write_new(path: Path, text: str) -> None:
    """Write a file that is not there yet. Raises ConfigError where there is one, or where it cannot be written."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        raise ConfigError(f"{path} is there already; name another file or remove it") from error
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error


def write_whole(path: Path, data: bytes) -> None:
    """Replace a file at once, so that no reader ever sees half of it.

    Behind a link the file that it names is replaced; a device or a pipe is written to as it is. Raises ConfigError
    when the place cannot be written; the file that was there stays as it was.
    """
    try:
        path = path.resolve()
        if path.exists() and not path.is_file():
            path.write_bytes(data)
            return
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror or error}") from error
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise ConfigError(f"cannot write {path}: {error.strerror or error}") from error

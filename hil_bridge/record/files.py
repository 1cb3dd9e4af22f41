"""Output files. Each is written completely or not at all, and replaces an existing file only on request."""

import fcntl
import os
import stat
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import BinaryIO

from hil_bridge.errors import ConfigError

REMEDY = "name another file, or give --overwrite"


def check_place(path: Path, overwrite: bool) -> None:
    """Check in advance whether `write_atomically` can write this path. Raises ConfigError with the remedy."""
    mode = _stat_mode(path)
    if mode is not None and stat.S_ISREG(mode) and not overwrite:
        raise ConfigError(f"{path} already exists; {REMEDY}")
    if mode is not None and (stat.S_ISDIR(mode) or stat.S_ISBLK(mode)):
        kind = "a folder; name a file in it" if stat.S_ISDIR(mode) else "a disk; name a file"
        raise ConfigError(f"cannot write {path}: it is {kind}")
    if (mode is None or stat.S_ISREG(mode)) and not os.access(path.resolve().parent, os.W_OK | os.X_OK):
        missing = "no permission" if path.resolve().parent.is_dir() else "no such folder"
        raise ConfigError(f"cannot write {path}: {missing}; name another place")


def check_record_path(path: Path, overwrite: bool) -> None:
    """Check the path of a recording in advance for `open_record`, which accepts only a file. Raises ConfigError."""
    mode = _stat_mode(path)
    if mode is not None and not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise ConfigError(f"cannot record into {path}: it is a pipe or device, not a file; name a file")
    check_place(path, overwrite)


def open_record(path: Path, overwrite: bool) -> BinaryIO:
    """Open a file for incremental writing. The file must be new; with `overwrite`, an existing one is truncated.

    An existing file is truncated only after the check that it is a regular file that no other run writes. Raises
    ConfigError.
    """
    check_record_path(path, overwrite)
    flags = os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | os.O_NOCTTY | os.O_NONBLOCK
    try:
        descriptor = os.open(path, flags if overwrite else flags | os.O_EXCL, 0o666)
        try:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise ConfigError(
                    f"cannot record into {path}: it is a pipe or device, not a file; name a file"
                )
            _lock(descriptor, path)
            os.ftruncate(descriptor, 0)
            return os.fdopen(descriptor, "wb")
        except BaseException:
            os.close(descriptor)
            raise
    except FileExistsError as error:
        raise ConfigError(f"{path} already exists; {REMEDY}") from error
    except OSError as error:
        raise ConfigError(f"cannot write the recording {path}: {error.strerror or error}") from error


def write_atomically(path: Path, data: bytes, overwrite: bool = False) -> None:
    """Write a new file atomically, or with `overwrite` replace one; a reader never sees an incomplete file.

    A symbolic link is followed. A device or a pipe is written to directly. Raises ConfigError if the file exists or
    the path is not writable; an existing file then stays unchanged.
    """
    check_place(path, overwrite)
    try:
        place = path.resolve()
        if place.exists() and not place.is_file():
            _write_through(place, data)
        else:
            _write_temporary(place, data, overwrite)
    except FileExistsError as error:  # created since the check
        raise ConfigError(f"{path} already exists; {REMEDY}") from error
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror or error}") from error


def _stat_mode(path: Path) -> int | None:
    """Return type and permissions of an existing path, following links; None if it does not exist.

    Raises ConfigError.
    """
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror or error}") from error


def _lock(descriptor: int, path: Path) -> None:
    """Lock this file against other runs while it is open. Raises ConfigError if another run writes it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ConfigError(f"cannot record into {path}: another run writes it; name another file") from error
    except OSError:
        pass  # a file system without locks


def _write_through(place: Path, data: bytes) -> None:
    """Write to a device or a pipe. A pipe without a reader is an error: the function does not wait for a reader."""
    descriptor = os.open(place, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    os.set_blocking(descriptor, True)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)


def _write_temporary(place: Path, data: bytes, overwrite: bool) -> None:
    """Write a new file in the same folder, then rename it. Raises FileExistsError without `overwrite`."""
    part, descriptor = _create_temporary(place)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if overwrite:
            part.replace(place)
            return
        try:
            os.link(part, place)
        except FileExistsError:
            raise
        except OSError:  # a file system without hard links
            with place.open("xb") as file:
                file.write(data)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _create_temporary(place: Path) -> tuple[Path, int]:
    """Create an empty file with an unused name next to `place`; return its path and its descriptor."""
    for number in count():
        part = place.with_name(f".{place.name[:200]}.{os.getpid()}-{number}.part")
        with suppress(FileExistsError):
            return part, os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    raise AssertionError("counting ends never")

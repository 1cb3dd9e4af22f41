"""Output files: written completely or not at all, and never over an existing one unless requested."""

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
    """Find out before the work whether `write_whole` may put a file here. Raises ConfigError with what to do."""
    mode = _mode(path)
    if mode is not None and stat.S_ISREG(mode) and not overwrite:
        raise ConfigError(f"{path} is there already; {REMEDY}")
    if mode is not None and (stat.S_ISDIR(mode) or stat.S_ISBLK(mode)):
        kind = "a folder; name a file in it" if stat.S_ISDIR(mode) else "a disk; name a file"
        raise ConfigError(f"cannot write {path}: it is {kind}")
    if (mode is None or stat.S_ISREG(mode)) and not os.access(path.resolve().parent, os.W_OK | os.X_OK):
        missing = "no permission" if path.resolve().parent.is_dir() else "there is no such folder"
        raise ConfigError(f"cannot write {path}: {missing}; name another place")


def check_record_place(path: Path, overwrite: bool) -> None:
    """Check the place of a record for `open_record`, which accepts only a file. Raises ConfigError."""
    mode = _mode(path)
    if mode is not None and not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise ConfigError(f"cannot record into {path}: it is no file but a pipe or device; name a file")
    check_place(path, overwrite)


def open_record(path: Path, overwrite: bool) -> BinaryIO:
    """Open a file that is written bit by bit: a new one, or with `overwrite` an emptied one.

    Nothing that is there is emptied before it is known to be a file that no other run writes. Raises ConfigError.
    """
    check_record_place(path, overwrite)
    flags = os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | os.O_NOCTTY | os.O_NONBLOCK
    try:
        descriptor = os.open(path, flags if overwrite else flags | os.O_EXCL, 0o666)
        try:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise ConfigError(
                    f"cannot record into {path}: it is no file but a pipe or device; name a file"
                )
            _hold(descriptor, path)
            os.ftruncate(descriptor, 0)
            return os.fdopen(descriptor, "wb")
        except BaseException:
            os.close(descriptor)
            raise
    except FileExistsError as error:
        raise ConfigError(f"{path} is there already; {REMEDY}") from error
    except OSError as error:
        raise ConfigError(f"cannot write the recording {path}: {error.strerror or error}") from error


def write_whole(path: Path, data: bytes, overwrite: bool = False) -> None:
    """Write a file that is not there yet, or with `overwrite` replace one; no reader ever sees half of it.

    Behind a link the file that it names is meant; a device or a pipe is written to as it is. Raises ConfigError
    where there is a file already or the place cannot be written; what was there stays as it was.
    """
    check_place(path, overwrite)
    try:
        place = path.resolve()
        if place.exists() and not place.is_file():
            _write_through(place, data)
        else:
            _write_temporary(place, data, overwrite)
    except FileExistsError as error:  # since the check
        raise ConfigError(f"{path} is there already; {REMEDY}") from error
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror or error}") from error


def _mode(path: Path) -> int | None:
    """Kind and rights of what is there, behind a link too; None where nothing is. Raises ConfigError."""
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror or error}") from error


def _hold(descriptor: int, path: Path) -> None:
    """Keep other runs from this file while it is open. Raises ConfigError where another run writes it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ConfigError(f"cannot record into {path}: another run writes it; name another file") from error
    except OSError:
        pass  # a file system without locks


def _write_through(place: Path, data: bytes) -> None:
    """Write to a device or a pipe; a pipe without a reader is an error, not a wait."""
    descriptor = os.open(place, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    os.set_blocking(descriptor, True)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)


def _write_temporary(place: Path, data: bytes, overwrite: bool) -> None:
    """Into a new file in the same folder, which then gets the name. Raises FileExistsError without `overwrite`."""
    part, descriptor = _part(place)
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


def _part(place: Path) -> tuple[Path, int]:
    """Return a new file beside `place` that nothing else uses, and its descriptor."""
    for number in count():
        part = place.with_name(f".{place.name[:200]}.{os.getpid()}-{number}.part")
        with suppress(FileExistsError):
            return part, os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    raise AssertionError("counting ends never")

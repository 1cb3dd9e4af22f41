"""Unpacking a bundle. Nothing in it is trusted: it may be cut off, altered, a bomb, or lead out of its folder."""

import hashlib
import os
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, open_ordinary

FILES_MOST = 2000
"""Files of a bundle at most. Chosen: more recordings than a person looks at."""
UNPACKED_LIMIT_BYTES = 1 << 30
"""Of all its files, unpacked, and of the bundle itself. Chosen: a thousand recordings of 1 MB."""
MANIFEST_LIMIT_BYTES = 1 << 26
"""Of the manifest. Chosen: that of half a million seeds."""
MANIFEST = "manifest.json"
RESULTS = "results.sqlite"
PLAN = "plan.json"
RECORDINGS = "recordings"
INPUTS = "inputs"
"""Folder of the files that settings name, each under the SHA-256 of its content."""

_NAME = re.compile(
    rf"(?:{re.escape(MANIFEST)}|{re.escape(RESULTS)}|{re.escape(PLAN)}|{RECORDINGS}/[0-9a-f]{{16}}\.mcap"
    rf"|{INPUTS}/[0-9a-f]{{64}})"
)
_FOLDERS = (f"{RECORDINGS}/", f"{INPUTS}/")
"""Other programs give a folder an entry of its own, which holds nothing."""
_PIECE_BYTES = 1 << 20
_END = struct.Struct("<4s4H2LH")
"""End of a zip file. Source: APPNOTE.TXT of PKWARE, 4.3.16."""
_LOCATOR_BYTES = 20
"""Before it, where the file has the form for very many or very long files. Source: the same, 4.3.15."""
_ENTRY_LIMIT_BYTES = 512
"""Of the directory for each file at most. Chosen: five times what a name of ours needs."""
_DAMAGES = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    ValueError,
    NotImplementedError,
    RuntimeError,
    struct.error,
)


def unpack(path: Path, folder: Path) -> dict[str, str]:
    """Write the files of a bundle into an empty folder; SHA-256 by name, empty for a file that is damaged.

    Raises ConfigError for a file that is no bundle, is too large, or holds what no bundle has.
    """
    with open_ordinary(path) as file:
        try:
            _check_end(file, path)
            with zipfile.ZipFile(file) as packed:
                entries = [one for one in packed.infolist() if one.filename not in _FOLDERS]
                for problem in _problems(entries):
                    raise ConfigError(f"{format_path(path)} {problem}; it is not a bundle of this program")
                return {entry.filename: _unpack_one(packed, entry, folder) for entry in entries}
        except OSError as error:
            raise ConfigError(f"cannot unpack {format_path(path)}: {error.strerror or error}") from error
        except _DAMAGES as error:
            raise ConfigError(
                f"{format_path(path)} is no zip file, or its end is damaged: {error}"
            ) from error


def hash_file(path: Path) -> str:
    """SHA-256 of a file. Raises ConfigError."""
    digest = hashlib.sha256()
    with open_ordinary(path) as file:
        while piece := file.read(_PIECE_BYTES):
            digest.update(piece)
    return digest.hexdigest()


def _check_end(file: BinaryIO, path: Path) -> None:
    """Look at size and number of files before anything is read by them."""
    size = file.seek(0, os.SEEK_END)
    if size > UNPACKED_LIMIT_BYTES:
        raise ConfigError(
            f"{format_path(path)} has {size} bytes, of which at most {UNPACKED_LIMIT_BYTES} are read"
        )
    file.seek(max(size - _END.size - _LOCATOR_BYTES, 0))
    tail = file.read()
    if len(tail) < _END.size:
        raise zipfile.BadZipFile("it is too short")
    mark, _, _, _, count, directory, _, _ = _END.unpack(tail[-_END.size :])
    if mark != b"PK\5\6":
        raise zipfile.BadZipFile("its last bytes are not those of one")
    if (
        tail[: -_END.size].startswith(b"PK\6\7")
        or count > FILES_MOST
        or directory > count * _ENTRY_LIMIT_BYTES
    ):
        raise ConfigError(f"{format_path(path)} has more files than the {FILES_MOST} of a bundle")


def _problems(entries: Sequence[zipfile.ZipInfo]) -> Iterator[str]:
    seen: set[str] = set()
    for entry in entries:
        name, kind = entry.orig_filename, stat.S_IFMT(entry.external_attr >> 16)
        if not _NAME.fullmatch(name) or entry.filename != name:
            yield f"holds {name[:80]!r}"
        elif name in seen:
            yield f"holds {name} twice"
        elif kind not in (0, stat.S_IFREG):
            yield f"holds {name} as a link or a device"
        elif entry.flag_bits & 1 or entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            yield f"holds {name} encrypted, or packed in another way"
        seen.add(name)
    if sum(entry.file_size for entry in entries) > UNPACKED_LIMIT_BYTES:
        yield f"holds more than {UNPACKED_LIMIT_BYTES} bytes"
    if MANIFEST not in seen:
        yield f"holds no {MANIFEST}"


def _unpack_one(packed: zipfile.ZipFile, entry: zipfile.ZipInfo, folder: Path) -> str:
    """Write a file as far as its directory entry says, no farther; its SHA-256, empty where it is damaged."""
    place, digest = folder / entry.filename, hashlib.sha256()
    place.parent.mkdir(exist_ok=True)
    with place.open("xb") as target:
        try:
            with packed.open(entry) as source:
                while piece := source.read(_PIECE_BYTES):
                    target.write(piece)
                    digest.update(piece)
        except _DAMAGES:
            return ""
    return digest.hexdigest()

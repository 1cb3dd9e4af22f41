"""Bundles of campaigns, taken apart and packed again: for tests that verify them."""

import hashlib
import json
import zipfile
from pathlib import Path
from typing import Any

Files = dict[str, bytes]
"""Content of the files of a bundle by their names."""


def files_of(bundle: Path) -> Files:
    with zipfile.ZipFile(bundle) as packed:
        return {name: packed.read(name) for name in packed.namelist()}


def packed_anew(place: Path, files: Files) -> Path:
    """A sound zip file of these files."""
    with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as target:
        for name, data in files.items():
            target.writestr(name, data)
    return place


def with_manifest(files: Files, **changes: Any) -> Files:
    """The same with other values in the manifest, and the hash of each file as it is now."""
    manifest = json.loads(files["manifest.json"])
    hashes = {
        name: hashlib.sha256(data).hexdigest() for name, data in files.items() if name != "manifest.json"
    }
    return {**files, "manifest.json": json.dumps({**manifest, "files": hashes, **changes}).encode()}

"""Bundles of campaigns, unpacked and packed again, for tests that verify them."""

import hashlib
import json
import zipfile
from pathlib import Path
from typing import Any

Files = dict[str, bytes]
"""Contents of the files of a bundle by name."""


def files_of(bundle: Path) -> Files:
    with zipfile.ZipFile(bundle) as packed:
        return {name: packed.read(name) for name in packed.namelist()}


def repack(place: Path, files: Files) -> Path:
    """Return a valid zip file of these files."""
    with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as target:
        for name, data in files.items():
            target.writestr(name, data)
    return place


def with_manifest(files: Files, **changes: Any) -> Files:
    """Return the bundle with other values in the manifest, and the present hash of each file."""
    manifest = json.loads(files["manifest.json"])
    hashes = {
        name: hashlib.sha256(data).hexdigest() for name, data in files.items() if name != "manifest.json"
    }
    return {**files, "manifest.json": json.dumps({**manifest, "files": hashes, **changes}).encode()}

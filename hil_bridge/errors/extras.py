"""The command that installs an extra, as it works for this installation: from an index, or from a checkout."""

import json
import shlex
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

NAME = "hil-bridge"


def install_command(extra: str = "") -> str:
    """`pip install …` with this extra, or without one.

    Where a folder was installed, it names the folder, and `-e` if it was so.
    """
    return f"pip install {requirement(_origin(), extra)}"


def requirement(origin: object, extra: str) -> str:
    """Return the rest of the command, for the origin that pip keeps (PEP 610); None for that of an index."""
    extras = f"[{extra}]" if extra else ""
    match origin:
        case {"url": str(url), "dir_info": dict(folder)} if url.startswith("file://"):
            place = Path(unquote(urlsplit(url).path))
            if (place / "pyproject.toml").is_file():
                edited = "-e " if folder.get("editable") is True else ""
                return edited + shlex.quote(f"{place}{extras}")
    return shlex.quote(f"{NAME}{extras}")


def _origin() -> Any:
    try:
        text = distribution(NAME).read_text("direct_url.json")
        return json.loads(text) if text else None
    except (PackageNotFoundError, OSError, ValueError):
        return None

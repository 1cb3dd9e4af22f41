"""Command that installs an extra in this installation, from an index or from a checkout."""

import json
import shlex
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

NAME = "hil-bridge"


def install_command(extra: str = "") -> str:
    """Return the `pip install …` command with the given extra, or without an extra.

    If hil-bridge was installed from a folder, the command names the folder, with `-e` for an editable installation.
    """
    return f"pip install {requirement(_origin(), extra)}"


def requirement(origin: object, extra: str) -> str:
    """Return the argument of `pip install` for the origin that pip recorded (PEP 610); None if the origin is an
    index.
    """
    extras = f"[{extra}]" if extra else ""
    match origin:
        case {"url": str(url), "dir_info": dict(folder)} if url.startswith("file://"):
            path = Path(unquote(urlsplit(url).path))
            if (path / "pyproject.toml").is_file():
                option = "-e " if folder.get("editable") is True else ""
                return option + shlex.quote(f"{path}{extras}")
    return shlex.quote(f"{NAME}{extras}")


def _origin() -> Any:
    try:
        text = distribution(NAME).read_text("direct_url.json")
        return json.loads(text) if text else None
    except (PackageNotFoundError, OSError, ValueError):
        return None

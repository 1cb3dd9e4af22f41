"""Environments of third-party clients, unmodified from the package index. Each is separate from the project's own
environment.

Tests run these clients in separate processes, and tools/client_transcripts.py records what they send.
"""

import shutil
import subprocess
import sys
from pathlib import Path

ENVIRONMENTS = Path(sys.prefix) / "cache" / "clients"
INSTALL_S = 240
UV = (sys.executable, "-m", "uv")


class ClientMissing(Exception):
    """Error that a client cannot be installed from the package index. The text gives the reason in one line."""


def interpreter(*requirements: str) -> Path:
    """Return the Python of an environment with these pinned packages. The environment is created if it is missing
    or incomplete.

    Raises ClientMissing.
    """
    place = ENVIRONMENTS / "+".join(requirement.replace("==", "-") for requirement in requirements)
    python, done = place / "bin" / "python", place / "complete"
    if not done.exists():
        shutil.rmtree(place, ignore_errors=True)
        for step in (
            ("venv", "--quiet", "--python", sys.executable, str(place)),
            ("pip", "install", "--quiet", "--python", str(python), *requirements),
        ):
            _run_uv(step, ", ".join(requirements))
        done.touch()
    return python


def _run_uv(step: tuple[str, ...], names: str) -> None:
    try:
        done = subprocess.run((*UV, *step), capture_output=True, text=True, check=False, timeout=INSTALL_S)
    except subprocess.TimeoutExpired as error:
        raise ClientMissing(f"{names} not received from the package index within {INSTALL_S} s") from error
    if done.returncode:
        why = (done.stderr.strip().splitlines() or ["no reason given"])[-1].strip()
        raise ClientMissing(f"{names} not available from the package index: {why}")

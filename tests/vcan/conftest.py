"""CAN bus of the kernel, one for each test."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count

import pytest

REQUIRE = "HIL_BRIDGE_REQUIRE_VCAN"
SECONDS = "HIL_BRIDGE_VCAN_SECONDS"
_FOLDERS = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
_numbers = count()


def _missing(text: str) -> None:
    """Skip, or fail if the tests must run."""
    if os.environ.get(REQUIRE):
        pytest.fail(text)
    pytest.skip(f"{text}; `python tools/vcan_vm.py` runs them elsewhere")


@dataclass(frozen=True, slots=True)
class Vcan:
    """vcan interface, with operations on it."""

    name: str

    @property
    def url(self) -> str:
        return f"can+socketcan://{self.name}"

    def link(self, *arguments: str) -> None:
        """Run `ip link …` with the interface's name last."""
        ip = shutil.which("ip", path=_FOLDERS)
        if ip is None:
            _missing("the command ip is missing")
        done = subprocess.run(
            [str(ip), "link", *arguments[:1], "dev", self.name, *arguments[1:]],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise OSError(done.stderr.strip())

    def down(self) -> None:
        self.link("set", "down")

    def up(self) -> None:
        self.link("set", "up")

    def add(self) -> None:
        self.link("add", "type", "vcan")
        self.up()

    def delete(self) -> None:
        self.link("delete")


@pytest.fixture
def vcan() -> Iterator[Vcan]:
    """Yield an interface that is up and that no other program uses."""
    bus = Vcan(f"vcan{os.getpid()}x{next(_numbers)}")
    try:
        bus.add()
    except OSError as error:
        _missing(f"no vcan interface can be made here: {error}")
    yield bus
    if os.path.exists(f"/sys/class/net/{bus.name}"):
        bus.delete()


@pytest.fixture
def command() -> Callable[[str], str]:
    """Return the path of a command of can-utils."""

    def find(name: str) -> str:
        path = shutil.which(name, path=_FOLDERS)
        if path is None:
            _missing(f"the command {name} is missing; `apt-get install can-utils`")
        return str(path)

    return find


@pytest.fixture(scope="session")
def stream_seconds() -> float:
    """Return how long the fast stream is watched, s."""
    return float(os.environ.get(SECONDS, "3"))

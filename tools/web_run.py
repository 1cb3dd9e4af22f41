"""Command that serves a page in a separate process, for tests, pictures and benchmarks."""

import subprocess
import sys
import time
from pathlib import Path

PATIENCE_S = 60.0


class Serving:
    """Process of a command that serves a page."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.log = folder / "page.log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "hil_bridge", *arguments],
                cwd=folder,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        self.url = self._line("page: ").split()[0]
        self.origin, _, fragment = self.url.partition("/#token=")
        self.token = fragment
        self.port = int(self.origin.rstrip("/").rpartition(":")[2])

    def _line(self, begin: str) -> str:
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until and self.process.poll() is None:
            for line in self.log.read_text().splitlines():
                if line.startswith(begin):
                    return line.removeprefix(begin)
            time.sleep(0.05)
        raise AssertionError(f"the command never printed {begin!r}: {self.log.read_text()}")

    def ended(self) -> int:
        """Return the exit code after the command has ended."""
        return self.process.wait(PATIENCE_S)


class WebRun(Serving):
    """Run that serves a page."""

    def __init__(self, folder: Path, arguments: tuple[str, ...], config: str) -> None:
        file = folder / "run.toml"
        file.write_text(config)
        super().__init__(folder, "run", str(file), "--web", "--no-view", *arguments)

    def server(self) -> int:
        """Process that serves the page."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        for child in map(int, children):
            if b"hil_bridge.show.web" in Path(f"/proc/{child}/cmdline").read_bytes():
                return child
        raise AssertionError("no process serves the page")

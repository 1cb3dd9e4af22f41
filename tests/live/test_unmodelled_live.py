"""`emulate` tells a client of today what it relied on and is not modelled: at once, and at its end."""

import json
import signal
import socket
import subprocess
import sys
from urllib.parse import parse_qs, urlsplit

import pytest

pytestmark = pytest.mark.live


def test_emulate_tells_each_thing_once_and_all_at_its_end() -> None:
    """A dashboard client asks for a variable twice, for what no dashboard knows, and for a log."""
    command = [sys.executable, "-m", "hil_bridge", "emulate", "robot", "--robot", "rtde", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as serving:
        try:
            assert serving.stdout is not None
            url = urlsplit(json.loads(serving.stdout.readline())["robot"])
            assert url.hostname is not None
            port = int(parse_qs(url.query)["dashboard"][0])
            with (
                socket.create_connection((url.hostname, port), timeout=10) as dashboard,
                dashboard.makefile("rw") as lines,
            ):
                assert lines.readline().startswith("Connected")
                for line in ("get variable x", "get variable x", "dance", "log all"):
                    lines.write(line + "\n")
                    lines.flush()
                    assert lines.readline().startswith("could not understand")
            serving.send_signal(signal.SIGINT)
            _, told = serving.communicate(timeout=30)
        finally:
            serving.kill()
    assert serving.returncode == 0
    detail = "answered as one that is not understood"
    assert told.splitlines() == [
        f"dashboard command get variable of rtde is not modelled: {detail}",
        f"dashboard command log of rtde is not modelled: {detail}",
        "your client relied on 2 things that are not modelled: "
        f"dashboard command get variable ({detail}); dashboard command log ({detail})",
    ]

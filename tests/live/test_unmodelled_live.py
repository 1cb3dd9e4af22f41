"""Test that `emulate` reports features used by a client and not modelled: at once, and at its end."""

import json
import signal
import socket
import subprocess
import sys
from urllib.parse import parse_qs, urlsplit

import pytest

pytestmark = pytest.mark.live


def test_emulate_reports_each_feature_once_and_a_summary() -> None:
    """A dashboard client requests a variable twice, an unknown command, and a log."""
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
            _, reported = serving.communicate(timeout=30)
        finally:
            serving.kill()
    assert serving.returncode == 0
    detail = "answered as not understood"
    assert reported.splitlines() == [
        f"dashboard command get variable of rtde is not modelled: {detail}",
        f"dashboard command log of rtde is not modelled: {detail}",
        "your client relied on 2 things that are not modelled: "
        f"dashboard command get variable ({detail}); dashboard command log ({detail})",
    ]

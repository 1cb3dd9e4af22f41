"""Requests that the page's server accepts, and how many."""

import pytest

from hil_bridge.show.web.admission import CSP, Admission, Bucket

OTHER = "https://app.foxglove.dev"
OURS = "127.0.0.1:8000"


@pytest.mark.parametrize(
    ("host", "origin", "is_accepted"),
    [
        (OURS, None, True),
        (OURS, f"http://{OURS}", True),
        ("localhost:9", "http://localhost:9", True),  # the near end of a tunnel
        ("[::1]:8000", "http://[::1]:8000", True),
        (OURS, OTHER, True),
        (OURS, "null", False),
        (OURS, f"https://{OURS}", False),
        (OURS, "http://127.0.0.1:8001", False),
        (OURS, "http://localhost:8000", False),
        (OURS, f"{OTHER}.evil.example", False),
        ("evil.example:8000", None, False),
        ("evil.example:8000", "http://evil.example:8000", False),
        ("127.0.0.1.evil.example", None, False),
        ("192.168.0.7:8000", None, False),
        ("", None, False),
        ("[::1", None, False),
        ("localhost@evil.example", None, False),
    ],
)
def test_admission_accepts_loopback_and_named_origins(
    host: str, origin: str | None, is_accepted: bool
) -> None:
    assert (not Admission("token", (OTHER,)).refusal(host, origin)) is is_accepted


def test_only_complete_token_ends_a_run() -> None:
    admission = Admission("a-long-token")
    assert admission.may_end("a-long-token")
    assert not any(map(admission.may_end, ("", "a-long-toke", "a-long-token ", "A-long-token", "\ud800")))


def test_bucket_limits_the_rate() -> None:
    now = 0.0
    bucket = Bucket(10.0, 5.0, lambda: now)
    accepted = 0
    for _ in range(1000):  # 10 s of 100 a second
        accepted += bucket.take()
        now += 0.01
    assert 5 + 98 <= accepted <= 5 + 101


def test_headers_forbid_external_scripts() -> None:
    assert "unsafe" not in CSP
    assert "*" not in CSP
    assert CSP.startswith("default-src 'none'")

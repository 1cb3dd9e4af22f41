"""Types of the fixture `bench`: a test reads what a run left without asking whether it is there."""

from collections.abc import Callable
from typing import Any

Bench = Any
RunBench = Callable[..., Bench]

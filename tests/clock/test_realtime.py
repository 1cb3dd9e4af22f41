"""Priority, processor, memory and garbage collection of the loop's thread: set inside the context, then restored."""

import ctypes
import errno
import gc
import os
import resource
import sys
import threading
from pathlib import Path

import pytest

from hil_bridge.clock import realtime
from hil_bridge.clock.realtime import (
    SWITCH_INTERVAL_S,
    RealTime,
    collect_generation_1,
    gc_frozen,
    gc_off,
    gc_paused,
    real_time_thread,
    short_switch_interval,
)
from hil_bridge.errors import ConfigError


def locked_kilobytes() -> int:
    status = Path("/proc/self/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmLck:"))


def may_be_first() -> bool:
    return os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_RTPRIO)[0] > 0


def test_realtime_busy_poll_excludes_fifo_priority() -> None:
    assert RealTime(busy_poll_ms=1000.0).busy_poll_ms == 1000.0
    with pytest.raises(ValueError, match="fifo_priority and busy_poll_ms exclude each other"):
        RealTime(fifo_priority=1, busy_poll_ms=0.1)
    with pytest.raises(ValueError, match="busy_poll_ms must be at most 1000"):
        RealTime(busy_poll_ms=1001.0)


def test_realtime_defaults_change_nothing() -> None:
    before = os.sched_getaffinity(0), os.sched_getscheduler(0), locked_kilobytes()
    with real_time_thread(RealTime()) as executor:
        assert executor is None
        assert (os.sched_getaffinity(0), os.sched_getscheduler(0), locked_kilobytes()) == before


def test_realtime_computing_thread_yields_soon() -> None:
    before = sys.getswitchinterval()
    with short_switch_interval():
        assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)
    assert sys.getswitchinterval() == before


def test_realtime_pins_only_thread_of_loop() -> None:
    before = os.sched_getaffinity(0)
    one = min(before)
    with real_time_thread(RealTime(cpus=(one,))) as executor:
        assert os.sched_getaffinity(0) == {one}
        assert executor is not None
        assert executor.submit(os.sched_getaffinity, 0).result() == before
    assert os.sched_getaffinity(0) == before


@pytest.mark.parametrize("others", [(), (min(os.sched_getaffinity(0)),)])
def test_realtime_missing_processor_is_refused(others: tuple[int, ...]) -> None:
    before = os.sched_getaffinity(0)
    with (
        pytest.raises(ConfigError, match=r"realtime\.cpus: this process may not run on 999"),
        real_time_thread(RealTime(cpus=(*others, 999))),
    ):
        pass
    assert os.sched_getaffinity(0) == before


@pytest.mark.skipif(not may_be_first(), reason="SCHED_FIFO is not permitted here")
def test_realtime_priority_applies_to_thread_of_loop_only() -> None:
    before = os.sched_getscheduler(0)
    priorities: list[int] = []
    try:
        with real_time_thread(RealTime(fifo_priority=1)):
            assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
            thread = threading.Thread(target=lambda: priorities.append(os.sched_getscheduler(0)))
            thread.start()
            thread.join()
    except ConfigError:
        pytest.skip("SCHED_FIFO is not permitted here")
    assert priorities == [os.SCHED_OTHER]
    assert os.sched_getscheduler(0) == before


def test_realtime_missing_permission_reports_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with (
        pytest.raises(ConfigError, match="SCHED_FIFO 50 is not permitted; set an rtprio limit"),
        real_time_thread(RealTime(fifo_priority=50)),
    ):
        pass


def test_realtime_locks_memory_inside_context() -> None:
    before = locked_kilobytes()
    if ctypes.CDLL(None).mlockall(1) != 0:
        pytest.skip("locking memory is not permitted here")
    ctypes.CDLL(None).munlockall()
    with real_time_thread(RealTime(lock_memory=True)):
        assert locked_kilobytes() > before + 1000
    assert locked_kilobytes() <= before


def test_realtime_keeps_processors_awake_inside_context(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    latency_file = tmp_path / "cpu_dma_latency"
    latency_file.touch()
    monkeypatch.setattr(realtime, "LATENCY_FILE", str(latency_file))

    def is_open() -> bool:
        return any(
            Path(f"/proc/self/fd/{fd}").resolve() == latency_file for fd in os.listdir("/proc/self/fd")
        )

    with real_time_thread(RealTime()):
        assert not is_open()
    with real_time_thread(RealTime(keep_awake=True)):
        assert is_open()
    assert not is_open()
    assert latency_file.read_bytes() == bytes(4)  # no latency at all


@pytest.mark.parametrize(
    ("error", "remedy"), [(errno.EACCES, "by a udev rule"), (errno.ENOENT, "this kernel does not offer it")]
)
def test_realtime_keep_awake_refusal_is_one_line(
    monkeypatch: pytest.MonkeyPatch, error: int, remedy: str
) -> None:
    def refuse(*arguments: object) -> int:
        raise OSError(error, os.strerror(error))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(ConfigError) as caught, real_time_thread(RealTime(keep_awake=True)):
        pass
    line = str(caught.value)
    assert line.startswith("realtime.keep_awake: /dev/cpu_dma_latency: ")
    assert remedy in line
    assert "\n" not in line


@pytest.mark.parametrize("collect", [True, False])
@pytest.mark.parametrize("frozen", [True, False])
def test_realtime_garbage_is_collected_on_request(collect: bool, frozen: bool) -> None:
    class Node:
        """Node that refers to itself."""

        alive = 0

        def __init__(self) -> None:
            self.me = self
            Node.alive += 1

        def __del__(self) -> None:
            Node.alive -= 1

    gc.enable()
    gc.unfreeze()
    if frozen:
        gc.freeze()
    with gc_paused(collect):
        for _ in range(5000):
            Node()
        assert Node.alive == 5000
        collect_generation_1()
        assert Node.alive == 0
        assert not gc.isenabled()
    assert gc.isenabled()
    assert (gc.get_freeze_count() > 0) == frozen
    gc.freeze()  # the tests that were collected, as it was before


def test_gc_frozen_keeps_collector_enabled() -> None:
    gc.unfreeze()
    with gc_frozen():
        assert gc.get_freeze_count() > 0
        assert gc.isenabled()
        with gc_off():
            assert not gc.isenabled()
        assert gc.isenabled()
    assert gc.get_freeze_count() == 0
    gc.freeze()  # the tests that were collected, as it was before


@pytest.mark.parametrize("wrong", [{"fifo_priority": 100}, {"fifo_priority": -1}, {"cpus": (-1,)}])
def test_realtime_invalid_settings_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        RealTime(**wrong)  # type: ignore[arg-type]

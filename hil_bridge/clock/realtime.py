"""Settings with which one thread of a Linux process meets its deadlines: priority, processor, sleep, memory, other
threads.

A loop of a few hertz needs none of these settings. They are meant for a 1 kHz sensor on a busy machine.
"""

import asyncio
import ctypes
import gc
import os
import struct
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

from hil_bridge.errors import SettingRefused
from protocol.marks import Mark, SettingError, at_least, between, check_settings, setting

SWITCH_INTERVAL_S = 1e-4
"""Longest time for which a computing thread keeps the interpreter from a thread that was woken, s. Chosen: the
default is 5 ms, and the recorder's writer would block the loop for the time of its complete encoding.
"""

LATENCY_FILE = "/dev/cpu_dma_latency"
"""File to which the longest wake-up time of a processor, µs, is written. The value applies while the file is open.
Source: Linux, Documentation/power/pm_qos_interface.rst.
"""
UDEV_RULE = 'KERNEL=="cpu_dma_latency", GROUP="dialout", MODE="0660"'
"""Udev rule that lets every user in the group of the serial ports write to `LATENCY_FILE`."""
_NO_LATENCY = struct.pack("=i", 0)
_MCL_CURRENT, _MCL_FUTURE = 1, 2
"""Flags of mlockall. Source: Linux, sys/mman.h."""


@dataclass(frozen=True)
class RealTime:
    """Settings of the loop's thread, which apply in real time only."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    fifo_priority: int = setting(
        0, Mark.CHOSEN, "SCHED_FIFO priority of the loop's thread; 0: normal scheduling", between(0, 99)
    )
    lock_memory: bool = setting(False, Mark.CHOSEN, "lock the memory of the process (mlockall)")
    cpus: tuple[int, ...] = setting(
        (), Mark.CHOSEN, "processors on which the loop's thread may run; empty: all", at_least(0)
    )
    keep_awake: bool = setting(
        False,
        Mark.CHOSEN,
        "keep idle processors of this machine out of sleep states: faster wake-up, more power",
    )
    busy_poll_ms: float = setting(
        0.0,
        Mark.CHOSEN,
        "time for which the loop polls before its processor may sleep, ms; fully uses one processor",
        between(0.0, 1000.0),
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if self.fifo_priority and self.busy_poll_ms:
            raise SettingError(
                "fifo_priority",
                "and busy_poll_ms exclude each other: a thread that comes first and never sleeps is "
                "stopped by the kernel for 50 ms of every second",
            )


@contextmanager
def real_time_thread(settings: RealTime) -> Iterator[ThreadPoolExecutor | None]:
    """Run the calling thread with these settings inside the context. Other threads stay unchanged.

    Threads that are started inside keep ordinary priority. The threads of the yielded executor also run on all
    processors (None if the thread is not pinned). Raises ConfigError for settings that the machine or its limits do
    not permit.
    """
    undo: list[Callable[[], object]] = []
    executor = None
    try:
        if settings.cpus:
            before = os.sched_getaffinity(0)
            _pin(settings.cpus, before)
            undo.append(lambda: os.sched_setaffinity(0, before))
            executor = ThreadPoolExecutor(initializer=os.sched_setaffinity, initargs=(0, before))
            undo.append(executor.shutdown)
        if settings.keep_awake:
            latency = _keep_awake()
            undo.append(lambda: os.close(latency))
        if settings.lock_memory:
            _lock_memory()
            undo.append(_unlock_memory)
        if settings.fifo_priority:
            policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
            _prefer(settings.fifo_priority)
            undo.append(lambda: os.sched_setscheduler(0, policy, parameter))
        yield executor
    finally:
        for step in reversed(undo):
            step()


@contextmanager
def real_time_loop(settings: RealTime, is_virtual: bool) -> Iterator[None]:
    """Run the loop's thread with these settings inside the context. Threads that are already running stay
    unchanged.

    Errors as for `real_time_thread`.
    """
    if is_virtual:
        with gc_paused(collect=False):
            yield
        return
    with gc_paused(), short_switch_interval(), real_time_thread(settings) as executor:
        if executor is not None:
            asyncio.get_running_loop().set_default_executor(executor)
        yield


@contextmanager
def short_switch_interval() -> Iterator[None]:
    """Let a woken thread wait for a computing thread no longer than `SWITCH_INTERVAL_S`, inside the context."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


@contextmanager
def gc_frozen(collect: bool = True) -> Iterator[None]:
    """Exclude existing objects from garbage collection inside the context, because a pass over all objects of a
    process blocks its loop for 0.1 s.

    `collect` collects garbage first. Objects that are already frozen stay frozen.
    """
    frozen = gc.get_freeze_count() > 0
    if collect:
        gc.collect()
    if not frozen:
        gc.freeze()
    try:
        yield
    finally:
        if not frozen:
            gc.unfreeze()


@contextmanager
def gc_off() -> Iterator[None]:
    """Disable automatic garbage collection inside the context."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextmanager
def gc_paused(collect: bool = True) -> Iterator[None]:
    """Freeze existing objects and disable automatic collection inside the context. `collect_generation_1` collects
    new garbage.
    """
    with gc_frozen(collect), gc_off():
        yield


def collect_generation_1() -> None:
    """Collect the garbage since the last call. Called while the run only waits for a wire."""
    gc.collect(1)


def _refused(setting: str, problem: str) -> SettingRefused:
    return SettingRefused("", ("realtime", setting), problem)


def _pin(cpus: tuple[int, ...], allowed: set[int]) -> None:
    if missing := sorted(set(cpus) - allowed):  # the system call would omit these silently
        there = ", ".join(map(str, sorted(allowed)))
        raise _refused(
            "cpus", f"this process may not run on {', '.join(map(str, missing))}; it may on {there}"
        )
    os.sched_setaffinity(0, cpus)


def _prefer(priority: int) -> None:
    try:
        # Without the flag, every thread that is started later would have this priority too.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError as error:
        raise _refused(
            "fifo_priority",
            f"SCHED_FIFO {priority} is not permitted; set an rtprio limit of at least {priority} for this user in "
            "/etc/security/limits.d, or leave it 0",
        ) from error


def _keep_awake() -> int:
    """Return the descriptor that keeps the processors awake until it is closed."""
    try:
        latency = os.open(LATENCY_FILE, os.O_WRONLY | os.O_CLOEXEC)
        try:
            os.write(latency, _NO_LATENCY)
        except OSError:
            os.close(latency)
            raise
    except OSError as error:
        match error:
            case PermissionError():
                remedy = f"permit this user to write to it by a udev rule, for example {UDEV_RULE}, or leave it false"
            case FileNotFoundError():
                remedy = "this kernel does not offer it: leave it false"
            case _:
                remedy = "leave it false"
        raise _refused("keep_awake", f"{LATENCY_FILE}: {error.strerror}; {remedy}") from error
    return latency


def _lock_memory() -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        raise _refused(
            "lock_memory",
            f"{os.strerror(ctypes.get_errno())}; set an unlimited memlock limit for this user in "
            "/etc/security/limits.d, or leave it false",
        )


def _unlock_memory() -> None:
    ctypes.CDLL(None).munlockall()

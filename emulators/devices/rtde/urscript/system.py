"""Functions for time, messages, registers, I/O and sockets."""

import math
import struct
from collections.abc import Generator
from typing import Any

from emulators.devices.rtde.urscript.failures import ScriptError
from emulators.devices.rtde.urscript.host import Message, Socket
from emulators.devices.rtde.urscript.limits import LENGTH_MAX, READS_MAX, SOCKETS_MAX, STRING_MAX
from emulators.devices.rtde.urscript.table import Function, modelled, waiting
from emulators.devices.rtde.urscript.values import Struct, Value, integer, number, string, text_of, truth

_SOCKET = "socket_0"
_OPEN_S = 2.0


def _text(value: Value) -> str:
    return value if isinstance(value, str) else text_of(value)


# --- time and messages


def _sync(task: Any) -> Generator[None, None, None]:
    yield


def _sleep(task: Any, seconds: Value) -> Generator[None, None, None]:
    """Wait for a time, at least one cycle (assumed)."""
    time = number(seconds)
    if not math.isfinite(time):
        raise ScriptError("a time that is not a number")
    for _ in range(max(1, math.ceil(time / task.host.period - 1e-6))):
        yield


def _time(task: Any, mode: Value) -> Value:
    now = task.host.clock()
    return Struct({"sec": int(now), "nanosec": int(now % 1.0 * 1e9)})


def _message(task: Any, first: Value, second: Value) -> None:
    task.host.tell(Message.TEXT, (_text(first) + _text(second))[:STRING_MAX])


def _popup(task: Any, text: Value, title: Value, *kinds: Value) -> Generator[None, None, None]:
    """Show a pop-up. A blocking pop-up waits until it is closed at the dashboard or the panel."""
    task.host.tell(Message.POPUP, _text(text)[:STRING_MAX], _text(title)[:STRING_MAX])
    while truth(kinds[2]) and task.host.popup_open:
        yield


# --- registers


def _read(direction: str, kind: str) -> Any:
    def read(task: Any, number_: Value) -> Value:
        value = task.host.read_register(direction, kind, integer(number_))
        return int(value) if kind == "int" else bool(value) if kind == "bit" else float(value)

    return read


def _write(kind: str) -> Any:
    def write(task: Any, number_: Value, value: Value) -> None:
        if kind == "bit":
            new: float = truth(value)
        else:
            new = integer(int(number(value))) if kind == "int" else number(value)
        task.host.write_register(kind, integer(number_), new)

    return write


def _watch(task: Any, name: Value, frequency: Value, action: Value) -> None:
    act = string(action).lower()
    if act not in ("ignore", "pause", "stop"):
        raise ScriptError(f"the action of a watchdog must be pause or stop, got {act[:40]}")
    if act != "ignore":
        task.host.watch_input(string(name), number(frequency), act)


_KINDS = {"boolean": "bit", "float": "double", "integer": "int"}
_REGISTERS: tuple[Function, ...] = (
    *(
        modelled(f"read_{direction}_{word}_register(address)", _read(direction, kind))
        for direction in ("input", "output")
        for word, kind in _KINDS.items()
    ),
    *(
        modelled(f"write_output_{word}_register(address, value)", _write(kind))
        for word, kind in _KINDS.items()
    ),
    modelled('rtde_set_watchdog(variable_name, min_frequency, action="pause")', _watch),
)

# --- inputs and outputs

_DIGITAL = {"": (0, 18), "standard_": (0, 8), "configurable_": (8, 8), "tool_": (16, 2)}
"""First number and size of each group of digital signals. Functions without a group name number all signals
consecutively.
"""


def _place(group: str, number_: Value) -> int:
    first, count = _DIGITAL[group]
    at = integer(number_)
    if not 0 <= at < count:
        raise ScriptError(f"there is no {group.strip('_') or 'digital'} signal {at}")
    return first + at


def _get_digital(group: str, direction: str) -> Any:
    return lambda task, at: task.host.read_digital(direction, _place(group, at))


def _set_digital(group: str) -> Any:
    return lambda task, at, on: task.host.write_digital(_place(group, at), truth(on))


def _analog(value: Value) -> int:
    at = integer(value)
    if at not in (0, 1):
        raise ScriptError(f"there is no analogue signal {at}")
    return at


def _get_analog(direction: str) -> Any:
    return lambda task, at: task.host.read_analog(direction, _analog(at))


def _set_analog(task: Any, at: Value, share: Value) -> None:
    task.host.write_analog(_analog(at), min(max(number(share), 0.0), 1.0))


_SIGNALS: tuple[Function, ...] = (
    *(
        modelled(f"get_{group}digital_{short}(n)", _get_digital(group, direction))
        for group in _DIGITAL
        for short, direction in (("in", "input"), ("out", "output"))
    ),
    *(modelled(f"set_{group}digital_out(n, b)", _set_digital(group)) for group in _DIGITAL),
    *(
        modelled(f"get_{group}analog_{short}(n)", _get_analog(direction))
        for group in ("", "standard_")
        for short, direction in (("in", "input"), ("out", "output"))
    ),
    *(modelled(f"set_{group}analog_out(n, f)", _set_analog) for group in ("", "standard_")),
)

# --- flags and modes


def _flag(value: Value) -> int:
    at = integer(value)
    if not 0 <= at < _FLAGS:
        raise ScriptError(f"there is no flag {at}")
    return at


_FLAGS = 32
"""Number of flags of a program. Assumed."""
_MODES: tuple[Function, ...] = (
    modelled("get_flag(n)", lambda task, at: _flag(at) in task.host.flags),
    modelled("set_flag(n, b)", lambda task, at, on: task.host.set_flag(_flag(at), truth(on))),
)

# --- sockets


def _open(task: Any, address: Value, port: Value, name: Value) -> Generator[None, None, Value]:
    """Connect to a server. The attempt ends after two seconds (source: the script manual)."""
    sockets: dict[str, Socket] = task.machine.sockets
    key = string(name)
    _close(task, key)
    if len(sockets) >= SOCKETS_MAX:
        raise ScriptError("there are too many sockets")
    socket: Socket | None = task.host.open_socket(string(address), integer(port))
    if socket is None:
        return False
    sockets[key] = socket
    for _ in range(round(_OPEN_S / task.host.period)):
        if not socket.opening:
            break
        yield
    if not socket.open and sockets.get(key) is socket:
        _close(task, key)
    return socket.open


def _close(task: Any, name: Value) -> None:
    socket: Socket | None = task.machine.sockets.pop(string(name), None)
    if socket is not None:
        socket.hang_up()


def _send(task: Any, data: bytes, name: Value) -> Value:
    socket: Socket | None = task.machine.sockets.get(string(name))
    return socket is not None and socket.send(data)


def _encode(text: Value) -> bytes:
    return _text(text).encode("latin-1", "replace")


def _send_int(task: Any, value: Value, name: Value) -> Value:
    return _send(task, struct.pack(">i", _integer(value)), name)


def _integer(value: Value) -> int:
    result = integer(value)
    if not -(2**31) <= result < 2**31:
        raise ScriptError("an integer has 32 bits")
    return result


def _wait_for(task: Any, name: Value, timeout: Value, ask: Any) -> Generator[None, None, bytes | None]:
    """Wait for the answer to a request on a socket; None after the timeout. With a timeout of 0 or less, wait for
    ever.
    """
    seconds, waited = number(timeout), 0.0
    if task.reads >= READS_MAX:
        yield
    task.reads += 1
    while True:
        socket: Socket | None = task.machine.sockets.get(string(name))
        if socket is None:
            yield
            return None
        answer: bytes | None = ask(socket)
        if answer is not None or (waited and not socket.open):
            return answer
        yield
        waited += task.host.period
        if 0.0 < seconds <= waited:
            return None


def _count(value: Value) -> int:
    count = integer(value)
    if not 0 < count <= LENGTH_MAX:
        raise ScriptError(f"{count} values cannot be read at once")
    return count


def _read_integers(task: Any, count: Value, name: Value, timeout: Value) -> Generator[None, None, Value]:
    """Read a list: first the number of integers, then the integers."""
    size = _count(count)
    task.spend(size)
    data = yield from _wait_for(task, name, timeout, lambda socket: socket.take(4 * size))
    return (0, *(-1,) * size) if data is None else (size, *struct.unpack(f">{size}i", data))


def _read_bytes(task: Any, count: Value, name: Value, timeout: Value) -> Generator[None, None, Value]:
    size = _count(count)
    task.spend(size)
    data = yield from _wait_for(task, name, timeout, lambda socket: socket.take(size))
    return (0, *(-1,) * size) if data is None else (size, *data)


def _read_floats(task: Any, count: Value, name: Value, timeout: Value) -> Generator[None, None, Value]:
    """Read a text such as `(1.0, 2.0)`, with as many numbers as requested."""
    size = _count(count)
    nothing = (0, *(math.nan,) * size)
    task.spend(size)
    data = yield from _wait_for(task, name, timeout, lambda socket: socket.take_until(b")"))
    if data is None:
        return nothing
    try:
        numbers = [float(part) for part in data.decode("latin-1").strip(" ()\r\n").split(",")]
    except ValueError:
        return nothing
    return (size, *numbers) if len(numbers) == size else nothing


def _read_line(task: Any, name: Value, timeout: Value) -> Generator[None, None, str]:
    data = yield from _wait_for(task, name, timeout, lambda socket: socket.take_until(b"\n"))
    return "" if data is None else data.decode("latin-1").rstrip("\r\n")[:STRING_MAX]


def _set_variable(task: Any, variable: Value, value: Value, name: Value) -> Value:
    """Send `SET NAME VALUE` as a line. Source: the script manual."""
    return _send(task, f"SET {string(variable)} {_integer(value)}\n".encode("latin-1", "replace"), name)


def _get_variable(task: Any, variable: Value, name: Value) -> Generator[None, None, Value]:
    """Send `GET NAME` as a line; the answer is `NAME VALUE`. Return 0 if there is no answer within two seconds.

    Source: the script manual.
    """
    _send(task, f"GET {string(variable)}\n".encode("latin-1", "replace"), name)
    parts = (yield from _read_line(task, name, _OPEN_S)).split()
    try:
        number_ = int(parts[1]) if len(parts) == 2 and parts[0] == variable else 0
    except ValueError:
        return 0
    return number_ if -(2**31) <= number_ < 2**31 else 0


def _read_string(
    task: Any, name: Value, prefix: Value, suffix: Value, *rest: Value
) -> Generator[None, None, Value]:
    """Read a string. `rest` are the interpretation of escapes, which has no effect, and the timeout."""
    begin, end = string(prefix), _encode(suffix)
    data = yield from _wait_for(task, name, rest[1], lambda socket: socket.take_until(end))
    text = "" if data is None else data.decode("latin-1")[:STRING_MAX]
    at = text.find(begin) + len(begin) if begin in text else len(text)
    return text[at:].removesuffix(string(suffix))


_SOCKETS: tuple[Function, ...] = (
    waiting(f'socket_open(address, port, socket_name="{_SOCKET}")', _open),
    modelled(f'socket_close(socket_name="{_SOCKET}")', _close),
    modelled(f'socket_send_int(value, socket_name="{_SOCKET}")', _send_int),
    modelled(
        f'socket_send_byte(value, socket_name="{_SOCKET}")',
        lambda task, value, name: _send(task, bytes((integer(value) & 255,)), name),
    ),
    modelled(
        f'socket_send_string(str, socket_name="{_SOCKET}")',
        lambda task, text, name: _send(task, _encode(text), name),
    ),
    modelled(
        f'socket_send_line(str, socket_name="{_SOCKET}")',
        lambda task, text, name: _send(task, _encode(text) + b"\n", name),
    ),
    modelled(f'socket_set_var(name, value, socket_name="{_SOCKET}")', _set_variable),
    waiting(f'socket_get_var(name, socket_name="{_SOCKET}")', _get_variable),
    waiting(f'socket_read_binary_integer(number, socket_name="{_SOCKET}", timeout=2)', _read_integers),
    waiting(f'socket_read_byte_list(number, socket_name="{_SOCKET}", timeout=2)', _read_bytes),
    waiting(f'socket_read_ascii_float(number, socket_name="{_SOCKET}", timeout=2)', _read_floats),
    waiting(f'socket_read_line(socket_name="{_SOCKET}", timeout=2)', _read_line),
    waiting(
        f'socket_read_string(socket_name="{_SOCKET}", prefix="", suffix="", interpret_escape=False, timeout=2)',
        _read_string,
    ),
)

SYSTEM: tuple[Function, ...] = (
    waiting("sync()", _sync),
    waiting("sleep(t)", _sleep),
    modelled("time(mode=0)", _time),
    modelled("get_steptime()", lambda task: task.host.period),
    modelled('textmsg(s1, s2="")', _message),
    waiting('popup(s, title="Popup", warning=False, error=False, blocking=False)', _popup),
    *_REGISTERS,
    *_SIGNALS,
    *_MODES,
    *_SOCKETS,
)

"""Failures of plug-in code: one line with package and location, and the traceback.

A controller, a robot, a sensor or a surface of a plug-in may raise any exception. An operator then needs the
package and the line. The author of the plug-in needs the traceback, which is recorded.
"""

import inspect
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import CodeType
from typing import Any

from hil_bridge.errors import BridgeError, Cause, DeviceError, Reason, TransportError
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.errors.offers import OWN, packages_of_modules

RAISED = BaseException
"""Exceptions that plug-in code may raise. See `raise_if_interrupt`."""
_PYTHON = tuple({sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")})


class CodeFailed(DeviceError):
    """Failure of a device's code. `__cause__` is the exception that the code raised."""


class WrongAnswer(Exception):
    """Invalid return value of plug-in code. `blamed` holds the object and its method."""

    def __init__(self, thing: Any, method: str, answer: Any, expected: str) -> None:
        """Create the error for the value that a method returned. `expected` describes the valid values."""
        super().__init__(f"{method} returns {type(answer).__name__}, not {expected}")
        self.blamed = thing, method


def one_line(text: str) -> str:
    """Return the first line of a text from a plug-in, with lone surrogates escaped."""
    return (text.splitlines() or [""])[0].encode(errors="backslashreplace").decode()


def quote_error(error: BaseException) -> str:
    """Return the first line of an exception's message. A text is returned even if formatting the exception fails."""
    try:
        return one_line(str(error))
    except Exception as second:
        return f"<{type(second).__name__}>"


def traceback_of(error: BaseException) -> str:
    """Return the traceback of an exception. A text is returned even if formatting the exception fails."""
    try:
        return "".join(traceback.format_exception(error))
    except Exception as second:  # an exception that cannot be shown
        return f"{type(error).__name__}, which cannot be shown: {type(second).__name__}"


def last_line(trace: str) -> str:
    """Return the line of a traceback that names the exception."""
    return trace.strip().rpartition("\n")[2]


def failure(error: BaseException, otherwise: str = "") -> str:
    """Return a one-line description of an exception, with the plug-in and the location that raised it, if any.

    `otherwise` is the location if no plug-in was involved. An exception about the return value of a plug-in holds
    the object and its method in the attribute `blamed`.
    """
    if blamed := getattr(error, "blamed", None):
        otherwise = method_location(*blamed)
    location = otherwise if blamed else plugin_location(error) or _script_location(error) or otherwise
    message = ": ".join(filter(None, (type(error).__name__, quote_error(error))))
    return f"{message}{location and f' ({location})'}"


def report_failure(what: str, cause: BaseException, notice: Callable[[str, str], object]) -> None:
    """Report a failure outside the bridge's own devices: first the traceback, then one line."""
    notice(EventKind.TRACEBACK, traceback_of(cause))
    notice(EventKind.FAILED, f"{what} failed: {failure(cause)}")


def raise_if_interrupt(error: BaseException) -> None:
    """Raise a KeyboardInterrupt again unless a plug-in has raised it, because the operator's KeyboardInterrupt must
    propagate.

    The event loop handles Ctrl-C itself, so that KeyboardInterrupt is not raised in the middle of other code. For
    code that awaits, see `hil_bridge.errors.cancelling`.
    """
    if is_keyboard(error):
        raise error


def is_keyboard(error: BaseException) -> bool:
    """Return whether the exception is a KeyboardInterrupt that no plug-in has raised."""
    if not isinstance(error, KeyboardInterrupt):
        return False
    frames = list(_frames(error))
    return not frames or frames[-1][0].partition(".")[0] not in packages_of_modules()


def blame(error: BaseException, thing: Any, method: str) -> None:
    """Attach to an exception the method of a plug-in whose return value caused it.

    An exception with plug-in code in its traceback needs no such note.
    """
    if isinstance(error, BridgeError) or involves_plugin(error) or not method_location(thing, method):
        return
    with suppress(Exception):  # an exception that accepts no attribute stays unchanged
        error.blamed = thing, method  # type: ignore[attr-defined]


def involves_plugin(error: BaseException) -> bool:
    """Return whether plug-in code was involved in an exception."""
    return bool(getattr(error, "blamed", None) or plugin_location(error))


def failure_event(error: BaseException) -> tuple[str, str]:
    """Return the kind and text of the event that reports the traceback of an unexpected exception."""
    return EventKind.TRACEBACK if involves_plugin(error) else EventKind.BUG, traceback_of(error)


def explain_exception(error: BaseException) -> Reason:
    """Return the reason for a run that ends with an unexpected exception."""
    if involves_plugin(error):
        return Reason(Cause.PLUGIN_CODE, f"plug-in code ended the run: {failure(error)}")
    return Reason(Cause.BUG, f"a bug ended the run: {type(error).__name__}: {quote_error(error)}")


def code_failed(what: str, cause: BaseException, otherwise: Cause) -> BridgeError:
    """Return the error that reports an exception of a device's code. A BridgeError is returned unchanged.

    `otherwise` is the cause of the error if it has none.
    """
    if isinstance(cause, BridgeError):
        cause.blame(otherwise)
        return cause
    failed = CodeFailed(f"{what} stopped: {failure(cause)}", cause=otherwise)
    failed.__cause__ = cause
    return failed


def link_cause(error: BaseException) -> Cause:
    """Return the default cause for an error that ended the link to a robot."""
    return Cause.CUT_WIRE if isinstance(error, TransportError) else Cause.ROBOT_FAILED


def plugin_location(error: BaseException) -> str:
    """Return package, file and line of the innermost plug-in code in a traceback; empty if there is none."""
    packages = packages_of_modules()
    for module, file, line in reversed(list(_frames(error))):
        if (package := packages.get(module.partition(".")[0])) is not None:
            return f"{package}, {_short(module, file)}:{line}"
    return ""


def is_ours(thing: Any) -> bool:
    """Return whether the class of an object belongs to this project."""
    return type(thing).__module__.partition(".")[0] in OWN


def method_location(thing: Any, name: str) -> str:
    """Return package, file and line at which a plug-in defines a method; empty if the method is built in or unknown."""
    kind = type(thing)
    attribute = inspect.getattr_static(thing, name, None)
    if inspect.ismemberdescriptor(attribute):  # a function in a slot
        attribute = getattr(thing, name, None)
    function = inspect.unwrap(_function(attribute))
    code = getattr(function, "__code__", None)
    module = str(getattr(function if isinstance(code, CodeType) else kind, "__module__", ""))
    if not isinstance(code, CodeType) or module.partition(".")[0] in OWN:
        return ""
    package = packages_of_modules().get(module.partition(".")[0])
    location = f"{_short(module, code.co_filename)}:{code.co_firstlineno}"
    return f"{package}, {location}" if package else location


def _function(attribute: Any) -> Any:
    """Return the function that underlies an attribute of a class."""
    return getattr(attribute, "fget", None) or getattr(attribute, "__func__", None) or attribute


def _script_location(error: BaseException) -> str:
    """Return file and line of the innermost code of a user's script; empty if there is none."""
    for module, file, line in reversed(list(_frames(error))):
        if module.partition(".")[0] not in OWN and Path(file).is_file() and not file.startswith(_PYTHON):
            return f"{_short(module, file)}:{line}"
    return ""


def _frames(error: BaseException) -> Iterator[tuple[str, str, int]]:
    """Yield module, file and line of each frame of an exception, outermost first. The file of a SyntaxError comes
    last.
    """
    for frame, line in traceback.walk_tb(error.__traceback__):
        yield str(frame.f_globals.get("__name__", "")), frame.f_code.co_filename, line
    if isinstance(error, SyntaxError) and error.filename:
        for path in map(Path, sys.path):
            if path.is_dir() and path in Path(error.filename).parents:
                module = ".".join(Path(error.filename).relative_to(path).with_suffix("").parts)
                yield module, error.filename, error.lineno or 0
                return


def _short(module: str, file: str) -> str:
    """Return the path of a file relative to the folder that contains its package."""
    parts = Path(file).parts
    depth = len(module.split(".")) if module not in ("", "__main__") else 1
    depth += parts[-1:] == ("__init__.py",)
    return "/".join(parts[-depth:])

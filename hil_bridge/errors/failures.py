"""Failures of code from other packages: in one line with package and place, and as a traceback.

A controller, a robot, a sensor or a surface may come from anywhere, and raise anything. An operator then wants to know
which package it was and in which line; its author wants the traceback, which goes into the record.
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
"""Whatever other packages' code may raise where it should return; see `raise_if_interrupt`."""
_PYTHON = tuple({sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")})


class CodeFailed(DeviceError):
    """The code that speaks for a device has failed; `__cause__` is what it raised."""


class WrongAnswer(Exception):
    """Plug-in code answered with what cannot be used. `blamed` is the object and its method."""

    def __init__(self, thing: Any, method: str, answer: Any, wanted: str) -> None:
        """`wanted` is what it was to be, in words."""
        super().__init__(f"{method} answers {type(answer).__name__}, not {wanted}")
        self.blamed = thing, method


def one_line(text: str) -> str:
    """Return the first line of a plug-in's text; lone surrogates are written out."""
    return (text.splitlines() or [""])[0].encode(errors="backslashreplace").decode()


def quote_error(error: BaseException) -> str:
    """Return the first line of an exception's message, whatever it is."""
    try:
        return one_line(str(error))
    except Exception as second:
        return f"<{type(second).__name__}>"


def traceback_of(error: BaseException) -> str:
    """Return the traceback of an exception, whatever it is."""
    try:
        return "".join(traceback.format_exception(error))
    except Exception as second:  # an exception that cannot be shown
        return f"{type(error).__name__}, which cannot be shown: {type(second).__name__}"


def last_line(trace: str) -> str:
    """Return the line of a traceback that names what was raised."""
    return trace.strip().rpartition("\n")[2]


def failure(error: BaseException, otherwise: str = "") -> str:
    """Describe an exception in one line, and the package and the place that it comes from if that is not ours.

    `otherwise` is the place where no code of others had a part in it. An exception about an answer of such code names
    the object and its method in an attribute `blamed`.
    """
    if blamed := getattr(error, "blamed", None):
        otherwise = place_of_method(*blamed)
    place = otherwise if blamed else plugin_place(error) or _foreign_place(error) or otherwise
    said = ": ".join(filter(None, (type(error).__name__, quote_error(error))))
    return f"{said}{place and f' ({place})'}"


def report_failure(what: str, cause: BaseException, notice: Callable[[str, str], object]) -> None:
    """Tell a failure beside the bridge's own devices: its traceback, then that the thing has failed."""
    notice(EventKind.TRACEBACK, traceback_of(cause))
    notice(EventKind.FAILED, f"{what} failed: {failure(cause)}")


def raise_if_interrupt(error: BaseException) -> None:
    """Raise a KeyboardInterrupt again, unless a plug-in itself has raised it: an operator's continues its way.

    The event loop handles Ctrl-C itself, so that it is not raised in the midst of other code.
    For code that awaits, see `hil_bridge.errors.cancelling`.
    """
    if is_keyboard(error):
        raise error


def is_keyboard(error: BaseException) -> bool:
    """Whether it is a KeyboardInterrupt that no plug-in has raised."""
    if not isinstance(error, KeyboardInterrupt):
        return False
    frames = list(_frames(error))
    return not frames or frames[-1][0].partition(".")[0] not in packages_of_modules()


def blame(error: BaseException, thing: Any, method: str) -> None:
    """Name the method of an object by whose answer an exception was raised, where it is of a plug-in.

    An exception in which plug-in code had a part tells that by itself.
    """
    if isinstance(error, BridgeError) or of_others(error) or not place_of_method(thing, method):
        return
    with suppress(Exception):  # one that takes no attribute stays as it is
        error.blamed = thing, method  # type: ignore[attr-defined]


def of_others(error: BaseException) -> bool:
    """Whether plug-in code had a part in an exception."""
    return bool(getattr(error, "blamed", None) or plugin_place(error))


def failure_event(error: BaseException) -> tuple[str, str]:
    """Kind and text of the event that tells the traceback of an exception that nothing expected."""
    return EventKind.TRACEBACK if of_others(error) else EventKind.BUG, traceback_of(error)


def explain_exception(error: BaseException) -> Reason:
    """Why a run ends with an exception that nothing expected."""
    if of_others(error):
        return Reason(Cause.OTHERS_CODE, f"plug-in code ended the run: {failure(error)}")
    return Reason(Cause.BUG, f"a bug ended the run: {type(error).__name__}: {quote_error(error)}")


def code_failed(what: str, cause: BaseException, otherwise: Cause) -> BridgeError:
    """Return the error that ends a device whose code has raised this; a BridgeError stays as it is.

    `otherwise` is its row of the table of causes where it names none.
    """
    if isinstance(cause, BridgeError):
        cause.blame(otherwise)
        return cause
    failed = CodeFailed(f"{what} stopped: {failure(cause)}", cause=otherwise)
    failed.__cause__ = cause
    return failed


def link_cause(error: BaseException) -> Cause:
    """Row of the table of causes for what ended the link to a robot, where it names none."""
    return Cause.CUT_WIRE if isinstance(error, TransportError) else Cause.ROBOT_FAILED


def plugin_place(error: BaseException) -> str:
    """Package, file and line of the innermost code of a plug-in in an exception; empty where none had a part in it."""
    packages = packages_of_modules()
    for module, file, line in reversed(list(_frames(error))):
        if (package := packages.get(module.partition(".")[0])) is not None:
            return f"{package}, {_short(module, file)}:{line}"
    return ""


def is_ours(thing: Any) -> bool:
    """Whether the class of an object is one of this project."""
    return type(thing).__module__.partition(".")[0] in OWN


def place_of_method(thing: Any, name: str) -> str:
    """Package, file and line where a plug-in defines a method of an object; empty where it is ours or unknown."""
    kind = type(thing)
    found = inspect.getattr_static(thing, name, None)
    if inspect.ismemberdescriptor(found):  # a function in a slot
        found = getattr(thing, name, None)
    function = inspect.unwrap(_function(found))
    code = getattr(function, "__code__", None)
    module = str(getattr(function if isinstance(code, CodeType) else kind, "__module__", ""))
    if not isinstance(code, CodeType) or module.partition(".")[0] in OWN:
        return ""
    package = packages_of_modules().get(module.partition(".")[0])
    place = f"{_short(module, code.co_filename)}:{code.co_firstlineno}"
    return f"{package}, {place}" if package else place


def _function(found: Any) -> Any:
    """Return the function behind an attribute of a class."""
    return getattr(found, "fget", None) or getattr(found, "__func__", None) or found


def _foreign_place(error: BaseException) -> str:
    """File and line of the innermost code of a script that is neither ours nor an installed library's."""
    for module, file, line in reversed(list(_frames(error))):
        if module.partition(".")[0] not in OWN and Path(file).is_file() and not file.startswith(_PYTHON):
            return f"{_short(module, file)}:{line}"
    return ""


def _frames(error: BaseException) -> Iterator[tuple[str, str, int]]:
    """Return module, file and line of each frame of an exception, outermost first, a SyntaxError's file last."""
    for frame, line in traceback.walk_tb(error.__traceback__):
        yield str(frame.f_globals.get("__name__", "")), frame.f_code.co_filename, line
    if isinstance(error, SyntaxError) and error.filename:
        for path in map(Path, sys.path):
            if path.is_dir() and path in Path(error.filename).parents:
                module = ".".join(Path(error.filename).relative_to(path).with_suffix("").parts)
                yield module, error.filename, error.lineno or 0
                return


def _short(module: str, file: str) -> str:
    """Return the file from the folder of its package on."""
    parts = Path(file).parts
    depth = len(module.split(".")) if module not in ("", "__main__") else 1
    depth += parts[-1:] == ("__init__.py",)
    return "/".join(parts[-depth:])

"""Run the console examples of README and `docs/` unchanged: a plug-in of pytest.

`python -m pytest -p tools.page_examples docs README.md` runs them; `make test-all` does it on two processes.

- A fence ```` ```console ```` holds commands after `$ `, each followed by its output; `...` stands for variable parts.
  A command without output is judged by its exit code alone. The code must be 0, unless `echo $?` comes next.
- Each page has a new folder with a copy of `examples/` and `packages/`, its own environment, and one shell for all
  its fences.
- A `code-block` of `console` whose caption begins with "In a second terminal" runs in parallel to the page, until the
  next such block or the end of the page. Its output must come within `PATIENCE_S`.
- A `code-block` of another language with a caption is a file named by the caption; it is written when it is reached.
- `<!--- skip: next "the reason" -->` before a fence skips it. The summary counts the examples run and skipped.
"""

import contextlib
import doctest
import os
import re
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import venv
from collections import Counter
from collections.abc import Generator, Iterable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from sybil import Document, Example, Region, Sybil
from sybil.parsers.markdown.lexers import FencedCodeBlockLexer
from sybil.parsers.myst import SkipParser
from sybil.parsers.myst.lexers import DirectiveLexer

ROOT = Path(__file__).resolve().parent.parent
PATIENCE_S = 90.0
"""Time limit of a command, s."""
BESIDE = "In a second terminal"
MARK = "end-of-command"
SCRIPTS = ("hil-bridge", "pip", "pytest")
"""Commands that pages use. The environment of a page must provide them."""


class Command(NamedTuple):
    """Command of a fence, with the output that the page shows; the output is empty if the page shows none."""

    line: str
    printed: str


def commands(source: str) -> list[Command]:
    """Parse the commands of a fence.

    Raises ValueError for text before the first command, and for an empty output.
    """
    found: list[Command] = []
    for part in re.split(r"^(?=\$ )", source, flags=re.MULTILINE):
        if not part.strip():
            continue
        if not part.startswith("$ "):
            raise ValueError(f"the fence must begin with a command after '$ ': {part.splitlines()[0]!r}")
        lines = part[2:].splitlines(keepends=True)
        last = next(number for number, line in enumerate(lines) if not line.endswith("\\\n"))
        printed = "".join(lines[last + 1 :])
        printed = printed.rstrip("\n") + "\n" if printed.strip() else ""
        if printed.strip() == "...":
            raise ValueError(f"the output must not be '...' alone: {lines[0]!r}")
        found.append(Command("".join(lines[: last + 1]).rstrip("\n"), printed))
    return found


def differs(command: Command, printed: str) -> str:
    """Describe how the output differs from the page; return an empty string if it does not."""
    checker = doctest.OutputChecker()
    if not command.printed or checker.check_output(command.printed, printed, doctest.ELLIPSIS):
        return ""
    expected = doctest.Example(command.line, command.printed)
    return f"$ {command.line}\n{checker.output_difference(expected, printed, doctest.ELLIPSIS)}"


class Page:
    """Environment in which one page is run: a folder, an environment, a shell, and at most one parallel command."""

    def __init__(self) -> None:
        self._kept = contextlib.ExitStack()
        folder = Path(self._kept.enter_context(tempfile.TemporaryDirectory(prefix="page-")))
        work = folder / "hil-bridge"
        for name in ("examples", "packages"):
            shutil.copytree(ROOT / name, work / name, ignore=shutil.ignore_patterns("__pycache__"))
        self._environment = environment(folder / "environment")
        self._shell = self._started("bash", "--noprofile", "--norc", cwd=work, stdout=subprocess.PIPE)
        self._beside: contextlib.ExitStack | None = None

    @property
    def place(self) -> Path:
        """Current folder of the shell."""
        return Path(f"/proc/{self._shell.pid}/cwd").readlink()

    def _started(self, *arguments: str, cwd: Path, stdout: Any) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            arguments,
            cwd=cwd,
            env=self._environment,
            stdin=subprocess.PIPE,
            stdout=stdout,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def run(self, command: Command) -> tuple[int, str]:
        """Run a command in the page's shell. Return exit code and output. Raises TimeoutError if the command takes
        too long.
        """
        assert self._shell.stdin is not None
        # the exit code of the previous command is available to `echo $?`
        script = f"{{ (exit ${{code:-0}})\n{command.line}\n}} </dev/null\ncode=$?; printf '\\n{MARK} %d\\n' $code\n"
        self._shell.stdin.write(script.encode())
        self._shell.stdin.flush()
        printed = b"".join(self._until(rb"\n%s (\d+)\n\Z" % MARK.encode(), command.line)).decode()
        text, _, code = printed.rpartition(f"\n{MARK} ")
        return int(code), text

    def _until(self, end: bytes, line: str) -> Iterator[bytes]:
        assert self._shell.stdout is not None
        tail, until = b"", time.monotonic() + PATIENCE_S
        with selectors.DefaultSelector() as selector:
            selector.register(self._shell.stdout, selectors.EVENT_READ)
            while not re.search(end, tail):
                if not selector.select(max(until - time.monotonic(), 0.0)):
                    raise TimeoutError(
                        f"$ {line}\nis still running after {PATIENCE_S:g} s; it printed\n{tail.decode()}"
                    )
                came = os.read(self._shell.stdout.fileno(), 1 << 16)
                if not came:
                    raise ChildProcessError(f"$ {line}\nended the shell")
                tail += came
        yield tail

    def start_beside(self, command: Command) -> str:
        """Start a parallel command, after ending the previous one. Return how the output of the new one differs
        from the page.
        """
        self.end_beside()
        with contextlib.ExitStack() as stack:
            output = stack.enter_context(tempfile.TemporaryFile())
            process = self._started("bash", "-c", f"exec {command.line}", cwd=self.place, stdout=output)
            stack.callback(ended, process)
            self._beside = stack.pop_all()
        until = time.monotonic() + PATIENCE_S
        while True:
            time.sleep(0.05)
            difference = differs(command, os.pread(output.fileno(), 1 << 20, 0).decode())
            if not difference or process.poll() is not None or time.monotonic() > until:
                return difference

    def end_beside(self) -> None:
        """End the parallel command with Ctrl-C."""
        if self._beside is not None:
            self._beside.close()
            self._beside = None

    def close(self) -> None:
        """End all processes, and remove the folder."""
        self.end_beside()
        ended(self._shell, signal.SIGKILL)
        self._kept.close()


def ended(process: subprocess.Popen[bytes], by: signal.Signals = signal.SIGINT) -> None:
    """End a process and its child processes, by force if necessary."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, by)
    try:
        process.communicate(timeout=10.0)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def environment(place: Path) -> dict[str, str]:
    """Return the variables for a new environment that extends this one, so that a page can install packages."""
    venv.create(place, symlinks=True)
    (site_packages,) = place.glob("lib/python*/site-packages")
    parents = [path for path in sys.path if path.endswith("site-packages")]
    lines = "; ".join(f"site.addsitedir({path!r})" for path in parents)
    (site_packages / "parent.pth").write_text(f"import site; {lines}\n", encoding="utf-8")
    for script in entry_points(group="console_scripts"):
        if script.name in SCRIPTS:
            path = place / "bin" / script.name
            body = f"#!{place}/bin/python\nimport sys\nfrom {script.module} import {script.attr}\n"
            path.write_text(f"{body}sys.exit({script.attr}())\n", encoding="utf-8")
            path.chmod(0o755)
    return {
        "HOME": str(place),
        "LANG": "C.UTF-8",
        "PATH": f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "COLUMNS": "110",
        "PYTHONUNBUFFERED": "1",
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "PIP_NO_BUILD_ISOLATION": "0",  # the value means the opposite of the setting's name
        "PIP_NO_INDEX": "1",
        "PIP_ROOT_USER_ACTION": "ignore",
    }


def run_fence(example: Example) -> str | None:
    """Run the commands of a fence. Return an error text, or None."""
    page: Page = example.namespace["page"]
    parts: list[Command] = example.parsed
    if example.region.lexemes.get("options", {}).get("caption", "").startswith(BESIDE):
        return "\n".join(filter(None, map(page.start_beside, parts))) or None
    for number, command in enumerate(parts):
        code, printed = page.run(command)
        difference = differs(command, printed)
        if not difference and code and [part.line for part in parts[number + 1 : number + 2]] != ["echo $?"]:
            difference = f"$ {command.line}\nended with the exit code {code}; it printed\n{printed}"
        if difference:
            return difference
    return None


def write_file(example: Example) -> None:
    """Write the file that the page shows."""
    path = example.namespace["page"].place / example.region.lexemes["options"]["caption"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(example.parsed, encoding="utf-8")


def fences(document: Document) -> Iterable[Region]:
    """Return the fences that are run, and the fences that are files."""
    for region in FencedCodeBlockLexer("console")(document):
        region.parsed, region.evaluator = commands(region.lexemes["source"]), run_fence
        yield region
    for region in DirectiveLexer("code-block", arguments=".+")(document):
        source = region.lexemes["source"]
        if region.lexemes["arguments"] == "console":
            region.parsed, region.evaluator = commands(source), run_fence
            yield region
        elif "caption" in region.lexemes["options"]:
            region.parsed, region.evaluator = source, write_file
            yield region


def begin(namespace: dict[str, Any]) -> None:
    """Prepare a page before its first example."""
    namespace["page"] = Page()


def end(namespace: dict[str, Any]) -> None:
    """Clean up after the last example of a page."""
    namespace["page"].close()


pytest_collect_file = Sybil(
    [fences, SkipParser()], pattern="*.md", path=str(ROOT), setup=begin, teardown=end
).pytest()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Store the number of commands of a fence in its report."""
    report = yield
    example = getattr(item, "example", None)
    if report.when == "call" and example is not None and example.region.evaluator is run_fence:
        report.user_properties.append(("commands", len(example.parsed)))
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how many examples ran, and which were skipped."""

    def told(outcome: str) -> list[pytest.TestReport]:
        reports = terminalreporter.stats.get(outcome, [])
        return [report for report in reports if "commands" in dict(report.user_properties)]

    ran, excused = told("passed") + told("failed"), told("skipped")
    number = sum(int(str(dict(report.user_properties)["commands"])) for report in ran)
    terminalreporter.section("console examples")
    terminalreporter.line(f"{len(ran)} ran, with {number} commands; {len(excused)} excused")
    reasons = Counter(str(report.longrepr[2]) for report in excused if isinstance(report.longrepr, tuple))
    for reason, times in reasons.most_common():
        terminalreporter.line(f"  {times} excused: {reason.removeprefix('Skipped: ')}")

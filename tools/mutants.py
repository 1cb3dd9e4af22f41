"""Draw mutants by a seed, and report which of them the tests kill.

A mutant is the code with one small mistake: another comparison, `and` for `or`, a sign, a constant, a dropped call. It
is made in a copy of the tree, never in the checkout. The tests of its area run there, up to the first failure; those
that name the module come first. A test that also fails in the copy without the mistake does not count, and is left out.

    python -m tools.mutants --seed 1 --write drawn.json     draws 30 mutants and judges them
    python -m tools.mutants --again drawn.json              judges the same mutants in this tree
    python -m tools.mutants --seed 1 --list                 only lists them
    python -m tools.mutants --area control --count 40       draws from one area

The exit code is 1 if a mutant survived. A mutant that reaches the time limit is reported separately, because further
tests might kill it. Existing libraries mutate the checkout, or run one list of tests for all code. This tool draws, and
selects tests by area.
"""

import argparse
import ast
import copy
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
AREAS = {
    "wires": (("protocol",), ("tests/wire", "tests/emulation")),
    "emulators": (("emulators",), ("tests/emulation", "tests/suites", "tests/devices")),
    "control": (("hil_bridge/control",), ("tests/control", "tests/programs", "tests/guard", "tests/runs")),
    "devices": (("hil_bridge/devices",), ("tests/devices", "tests/guard", "tests/runs")),
    "runs": (("hil_bridge/runs",), ("tests/runs", "tests/guard", "tests/api", "tests/programs")),
    "campaign": (
        ("hil_bridge/lab",),
        ("tests/campaign", "tests/tuning", "tests/conform", "tests/guard"),
    ),
    "web": (("hil_bridge/show",), ("tests/web", "tests/show")),
}
"""Folders of the code, and of the tests that check it."""
LEFT_OUT = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".*_cache", "_build", "dist", ".hypothesis")
COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
SUMS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
}


@dataclass(frozen=True, slots=True)
class Mutant:
    """Mutant: code with one small mistake."""

    area: str
    path: str
    function: str
    """Qualified name of the function; empty at the top level of a module."""
    before: str
    """Text that is replaced."""
    after: str
    occurrence: int
    """Index of this replacement in the function, from 0."""


@dataclass(frozen=True, slots=True)
class Place:
    """Mutant with its location in a text, given in bytes."""

    mutant: Mutant
    line: int
    begin: int
    end: int


def mutations(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the mistakes that can be made in this syntax node."""
    other = copy.deepcopy(node)
    match other:
        case ast.Compare(ops=[operator]) if type(operator) in COMPARISONS:
            other.ops = [COMPARISONS[type(operator)]()]
        case ast.BoolOp(op=operator):
            other.op = ast.Or() if isinstance(operator, ast.And) else ast.And()
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            other = other.operand
        case ast.BinOp(op=operator) if type(operator) in SUMS:
            other.op = SUMS[type(operator)]()
        case ast.Constant(value=bool(value)):
            other.value = not value
        case ast.Constant(value=int(number)):
            other.value = number + 1
        case ast.Constant(value=float(number)):
            other.value = number * 2 or 1.0
        case ast.Expr(value=ast.Call() | ast.Await(value=ast.Call())):
            other = ast.Pass()
        case _:
            return
    yield other


def _is_judged(node: ast.AST) -> bool:
    """Return whether mistakes inside a node can affect a run. They cannot in types; f-strings are excluded because
    they have no locations.
    """
    typing_only = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    return not (typing_only or isinstance(node, ast.JoinedStr))


def _inside(node: ast.AST) -> Iterator[ast.AST]:
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list", "type_params"):
            yield from (
                each for each in (value if isinstance(value, list) else [value]) if isinstance(each, ast.AST)
            )


def places(area: str, path: str, text: str) -> list[Place]:
    """Return all mutants of a module, in the order of its text."""
    lines = [0]
    for line in text.encode().splitlines(keepends=True):
        lines.append(lines[-1] + len(line))
    found: list[Place] = []
    numbers: Counter[tuple[str, str, str]] = Counter()

    def visit(node: ast.AST, function: str) -> None:
        if not _is_judged(node):
            return
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            function = f"{function}.{node.name}".lstrip(".")
        if isinstance(node, (ast.expr, ast.stmt)) and node.end_lineno and node.end_col_offset is not None:
            begin = lines[node.lineno - 1] + node.col_offset
            end = lines[node.end_lineno - 1] + node.end_col_offset
            for other in mutations(node):
                new = "pass" if isinstance(other, ast.Pass) else f"({ast.unparse(other)})"
                key = function, ast.unparse(node), new
                mutant = Mutant(area, path, *key, occurrence=numbers[key])
                numbers[key] += 1
                found.append(Place(mutant, node.lineno, begin, end))
        for each in _inside(node):
            visit(each, function)

    visit(ast.parse(text), "")
    return found


def all_places(root: Path, area: str) -> Iterator[Place]:
    """Return all mutants of an area."""
    for folder in AREAS[area][0]:
        for file in sorted((root / folder).rglob("*.py")):
            yield from places(area, file.relative_to(root).as_posix(), file.read_text(encoding="utf-8"))


def draw_mutants(root: Path, seed: int, count: int, areas: Sequence[str] = tuple(AREAS)) -> list[Place]:
    """Return mutants drawn by a seed. Each area has the same number, and each location the same probability."""
    random_ = random.Random(seed)
    shares = [count // len(areas) + (k < count % len(areas)) for k in range(len(areas))]
    return [
        place
        for area, share in zip(areas, shares, strict=True)
        for place in random_.sample(list(all_places(root, area)), share)
    ]


def again(root: Path, file: Path) -> Iterator[Place | Mutant]:
    """Yield the mutants of an earlier draw at their current locations. A mutant that no longer has a location is
    returned unchanged.
    """
    for record in json.loads(file.read_text(encoding="utf-8")):
        mutant = Mutant(**record["mutant"])
        path = root / mutant.path
        now = places(mutant.area, mutant.path, path.read_text(encoding="utf-8")) if path.is_file() else []
        yield next((place for place in now if place.mutant == mutant), mutant)


def tests_of(root: Path, mutant: Mutant) -> list[str]:
    """Return the test files of the area. Files that name the module are first."""
    module = mutant.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    package, _, name = module.rpartition(".")
    named = re.compile(rf"\b{re.escape(module)}\b|from {re.escape(package)} import [^\n]*\b{name}\b")
    function = mutant.function.rpartition(".")[2]
    ranks: list[tuple[int, int, int, str]] = []
    for order, folder in enumerate(AREAS[mutant.area][1]):
        for file in sorted((root / folder).rglob("test_*.py")):
            text = file.read_text(encoding="utf-8")
            rank = 2 - bool(named.search(text)) - bool(function and re.search(rf"\b{function}\b", text))
            ranks.append((rank, order, len(text), file.relative_to(root).as_posix()))
    return [path for *_, path in sorted(ranks)]


class Judge:
    """Runs tests in a copy of the tree."""

    def __init__(self, root: Path, limit_s: float) -> None:
        self.root, self._limit_s = root, limit_s
        paths = [str(root), *filter(None, [os.environ.get("PYTHONPATH")])]
        self._environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(paths),  # processes that tests start also use the copy
            "PYTHONDONTWRITEBYTECODE": "1",
        }

    def verdict(self, place: Place) -> tuple[str, str]:
        """Return `killed`, `survived` or `out of time`, and the test that killed the mutant."""
        file = self.root / place.mutant.path
        text = file.read_bytes()
        mutated = text[: place.begin] + place.mutant.after.encode() + text[place.end :]
        left_out: list[str] = []
        until = time.monotonic() + self._limit_s
        while True:
            file.write_bytes(mutated)
            try:
                code, output = self._run(tests_of(self.root, place.mutant), left_out, until)
            finally:
                file.write_bytes(text)
            if code is None:
                return "out of time", ""
            if code == 0:
                return "survived", ""
            failed = re.search(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
            name = failed[1] if failed else ""
            if not name or self._run([name], [], time.monotonic() + self._limit_s)[0] == 0:
                return "killed", name or output[-300:]
            left_out.append(name)

    def _run(self, files: Sequence[str], left_out: Sequence[str], until: float) -> tuple[int | None, str]:
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not live and not vcan and not driver"]
        command += ["-p", "no:cacheprovider", "--tb=no", *files]
        command += [f"--deselect={name}" for name in left_out]
        with tempfile.TemporaryFile("w+") as output:
            process = subprocess.Popen(
                command,
                cwd=self.root,
                env=self._environment,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                process.wait(max(1.0, until - time.monotonic()))
            except subprocess.TimeoutExpired:
                return None, ""
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            output.seek(0)
            return process.returncode, output.read()


def judge_all(mutants: Sequence[Place | Mutant], limit_s: float, report: Callable[[object], None]) -> None:
    """Judge each mutant in a copy of the tree, and report the results."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copied = Path(folder) / "tree"
        shutil.copytree(ROOT, copied, ignore=LEFT_OUT)
        judge = Judge(copied, limit_s)
        for number, each in enumerate(mutants, 1):
            mutant = each if isinstance(each, Mutant) else each.mutant
            begun = time.monotonic()
            verdict, by = ("gone", "") if isinstance(each, Mutant) else judge.verdict(each)
            line = 0 if isinstance(each, Mutant) else each.line
            print(
                f"{number:3} {verdict:11} {time.monotonic() - begun:5.0f} s  {text_of(mutant, line)}  {by}",
                flush=True,
            )
            report({"mutant": asdict(mutant), "verdict": verdict, "by": by})


def text_of(mutant: Mutant, line: int) -> str:
    """Describe a mutant."""
    before = mutant.before if len(mutant.before) < 90 else f"{mutant.before[:87]}..."
    after = mutant.after if len(mutant.after) < 90 else f"{mutant.after[:87]}..."
    return f"{mutant.area}: {mutant.path}:{line} {mutant.function}: {before} → {after}"


def main() -> int:
    """Draw mutants, judge them, and report the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument(
        "--area", choices=AREAS, action="append", help="draw from this area (default: from all)"
    )
    parser.add_argument("--limit", type=float, default=240.0, help="time for one mutant, s (default: 240)")
    parser.add_argument("--list", action="store_true", help="name the mutants, and run nothing")
    parser.add_argument("--write", type=Path, help="file for the mutants and the verdicts, JSON")
    parser.add_argument("--again", type=Path, help="file of an earlier --write: judge its mutants")
    options = parser.parse_args()
    areas = options.area or tuple(AREAS)
    mutants = list(
        again(ROOT, options.again)
        if options.again
        else draw_mutants(ROOT, options.seed, options.count, areas)
    )
    if options.list:
        for each in mutants:
            is_gone = isinstance(each, Mutant)
            print(
                text_of(each, 0) if isinstance(each, Mutant) else text_of(each.mutant, each.line),
                "(gone)" * is_gone,
            )
        return 0
    records: list[dict[str, object]] = []

    def report(record: object) -> None:
        assert isinstance(record, dict)
        records.append(record)
        if options.write:
            options.write.write_text(json.dumps(records, indent=1, ensure_ascii=False), encoding="utf-8")

    judge_all(mutants, options.limit, report)
    counts = Counter(str(record["verdict"]) for record in records)
    print(", ".join(f"{count} {verdict}" for verdict, count in counts.most_common()), f"of {len(records)}")
    return int(counts["survived"] > 0)


if __name__ == "__main__":
    sys.exit(main())

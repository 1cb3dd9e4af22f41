"""Shared parts of the tools that write tables into documents: tables, marks on pages, and parallel runs."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from hil_bridge.lab.processes import in_order, own_processes

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def placed(text: str, contents: Mapping[str, str]) -> str:
    """Return the document with each content inserted between the marks with its name. Other text is kept.

    Raises ValueError for a content whose marks are missing.
    """
    for name, content in contents.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        before, has_begin, behind = text.partition(begin)
        _, has_end, after = behind.partition(end)
        if not (has_begin and has_end):
            raise ValueError(f"the document has no marks for {name!r}: {begin} … {end}")
        text = f"{before}{begin}\n{content}\n{end}{after}"
    return text


def where(rows: Iterable[Mapping[str, Any]], **facts: object) -> list[Mapping[str, Any]]:
    """Return the rows in which the columns of these names have these values."""
    return [row for row in rows if all(row[name] == value for name, value in facts.items())]


def run_jobs(run: Callable[[_Job], _Result], jobs: Sequence[_Job]) -> list[_Result]:
    """Return the results of all jobs in order. One job per core runs at a time, and a dot is printed for each."""
    with own_processes() as pool:
        return in_order(pool, run, jobs, lambda count: print(".", end="", flush=True), chunk=1)

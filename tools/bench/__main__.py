"""Run the benchmarks, all or the named ones: `make bench`, `make bench ONLY="wake_up link_use"`.

Results go to runs/bench.json, which is not under version control. With --page (`make bench PAGE=1`) they also go to
docs/explanation/performance.json, and the tables of docs/explanation/performance.md are rewritten from it.
"""

import argparse
import importlib
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tools.bench import machine
from tools.bench.figures import Report
from tools.bench.page import BENCHMARKS
from tools.documents import contents

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "runs" / "bench.json"
PUBLISHED = ROOT / "docs" / "explanation" / "performance.json"


def run(name: str) -> Report:
    """Run one benchmark, and print its steps and figures as they are completed."""
    print(f"── {name}", flush=True)
    began = time.monotonic()
    report: Report = importlib.import_module(f"tools.bench.{name}").measure(
        lambda step: print(f"   … {step}", flush=True)
    )
    for line in (*(figure.line() for figure in report.figures), *(f"left out: {x}" for x in report.left_out)):
        print(f"   {line}")
    print(f"   ({time.monotonic() - began:.0f} s)", flush=True)
    return report


def merge_results(path: Path, facts: Mapping[str, str], fresh: Mapping[str, Any]) -> dict[str, Any]:
    """Merge new results into the results of a file. Results from another machine or version are dropped."""
    old: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    known = {**old["benchmarks"], **fresh} if old.get("machine") == facts else fresh
    return {"machine": dict(facts), "benchmarks": {name: known[name] for name in BENCHMARKS if name in known}}


def write_results(path: Path, results: Mapping[str, Any]) -> None:
    """Write results to a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the selected benchmarks. The exit code is 0 even if targets are missed."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__.splitlines()[0])
    parser.add_argument("benchmark", nargs="*", help=f"one of {', '.join(BENCHMARKS)}; all without a name")
    parser.add_argument(
        "--page", action="store_true", help="also renew docs/explanation/performance.json and .md"
    )
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.benchmark if name not in BENCHMARKS]:
        parser.error(f"unknown benchmark {unknown[0]!r}; known: {', '.join(BENCHMARKS)}")

    facts, fresh = machine.facts(), {}
    for name in options.benchmark or BENCHMARKS:
        load = machine.load()
        fresh[name] = {"load": round(load, 1), **run(name).as_json()}
        results = merge_results(RESULTS, facts, fresh)
        write_results(RESULTS, results)
    print(f"results: {RESULTS.relative_to(ROOT)}")
    if options.page:
        write_results(PUBLISHED, merge_results(PUBLISHED, facts, fresh))
        for page, text in contents("performance"):
            page.write_text(text, encoding="utf-8")
            print(f"page: {page.relative_to(ROOT)}")
    judged = [item for benchmark in fresh.values() for item in benchmark["figures"] if "met" in item]
    print(f"{sum(item['met'] for item in judged)} of {len(judged)} targets met")
    return 0


if __name__ == "__main__":
    sys.exit(main())

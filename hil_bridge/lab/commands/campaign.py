"""`hil-bridge campaign`: a matrix of configurations, faults and seeds in virtual time, judged by criteria."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from hil_bridge.cli.setting_options import set_option
from hil_bridge.console.options import (
    ExtrasCommand,
    GroupedCommand,
    echo_json,
    echo_lines,
    json_option,
    option_group,
    output_option,
    overwrite_option,
)
from hil_bridge.console.paths import FILE
from hil_bridge.errors import ConfigError
from hil_bridge.lab.commands.campaign_results import bundle, compare, export, rerun, verify

if TYPE_CHECKING:
    from hil_bridge.lab.campaign.digest import Digest
    from hil_bridge.lab.campaign.plan import Plan
    from hil_bridge.lab.campaign.store import Store

FAILED = 4
"""Exit code if a run did not meet a criterion."""
FAILING_MOST = 5
"""Maximum number of failed runs listed at the end of a campaign. Chosen: they fit on a screen."""


class _Campaign(click.Group):
    """Command group that treats `campaign FILE` as `campaign run FILE`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ("-h", "--help"):
            if not args[0].startswith("-") and not Path(args[0]).suffix and not Path(args[0]).exists():
                known = ", ".join(self.commands)
                raise click.UsageError(f"no such file or command {args[0]!r}; commands: {known}", ctx)
            args = ["run", *args]
        return super().parse_args(ctx, args)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options of `campaign FILE` by group, followed by the commands."""
        run.format_options(ctx, formatter)
        self.format_commands(ctx, formatter)


class _Outputs(NamedTuple):
    """Additional output files of a command, for build servers."""

    junit: Path | None
    markdown: Path | None
    overwrite: bool

    def check(self) -> None:
        """Check that the files can be written. Raises ConfigError if one cannot, or already exists."""
        from hil_bridge.record.files import check_place

        for place in (self.junit, self.markdown):
            if place is not None:
                check_place(place, self.overwrite)

    def write(self, store: "Store", digest: "Digest") -> None:
        """Write the requested files."""
        from hil_bridge.lab.campaign.report_text import junit_report, markdown_report
        from hil_bridge.record.files import write_atomically

        if self.junit is not None:
            write_atomically(self.junit, junit_report(store, digest), self.overwrite)
        if self.markdown is not None:
            write_atomically(self.markdown, markdown_report(digest).encode(), self.overwrite)


_junit_option = click.option("--junit", type=FILE, metavar="FILE.xml", help="Write the runs as JUnit XML.")
_markdown_option = click.option(
    "--markdown", type=FILE, metavar="FILE.md", help="Write the report as Markdown, for a job's summary."
)


def _seeds(text: str | None) -> tuple[int, ...]:
    from hil_bridge.lab.campaign.plan import seeds_of

    try:
        return seeds_of(text) if text else ()
    except ValueError as error:
        raise click.BadParameter(f"must be FROM:TO, such as 1:20, got {text!r}") from error


def _plan_of(file: Path, seeds: tuple[int, ...], settings: Mapping[str, Any]) -> "Plan":
    """Read the plan of a file. Prints all problems except the last one, which it raises as ConfigError."""
    from hil_bridge.lab.campaign.plan_file import PlanErrors, read_plan

    if file.suffix == ".sqlite":
        raise ConfigError(
            f"{file} contains results, not a plan; run `hil-bridge campaign report {file}` to see them"
        )
    try:
        return read_plan(file, seeds, settings)
    except PlanErrors as error:
        for problem in error.problems[:-1]:
            click.echo(f"hil-bridge: {problem}", err=True)
        raise ConfigError(error.problems[-1]) from error


@click.group(
    cls=_Campaign,
    no_args_is_help=False,
    short_help="Run a matrix of configurations, faults and seeds.",
    subcommand_metavar="FILE.toml | COMMAND [ARGS]…",
)
def campaign() -> None:
    """Run a matrix of configurations, faults and seeds in virtual time, and judge each run by criteria.

    `hil-bridge campaign FILE.toml` executes the runs that are missing from the results file. After Ctrl-C, the same
    command resumes the campaign.
    """


@campaign.command(cls=GroupedCommand, short_help="Run what is missing from the results.")
@click.argument("file", type=FILE)
@option_group(
    "Runs",
    click.option(
        "--seeds",
        metavar="FROM:TO",
        callback=lambda *args: _seeds(args[2]),
        help="Seeds, instead of those of FILE.",
    ),
    set_option,
    click.option(
        "--check", "only_check", is_flag=True, help="Check the file and print the number of runs only."
    ),
)
@option_group(
    "Where they run",
    click.option(
        "--workers",
        type=click.IntRange(min=1),
        metavar="N",
        help="Number of processes.  [default: one per core]",
    ),
    click.option(
        "--scheduler",
        metavar="URL",
        help="Use the workers of a Dask scheduler, tcp://host:8786, instead of local processes.",
    ),
)
@option_group(
    "Results",
    output_option("FILE.sqlite", "Results file.  [default: FILE.sqlite in the current folder]"),
    _junit_option,
    _markdown_option,
    json_option,
    overwrite_option,
)
def run(
    file: Path,
    out: Path | None,
    workers: int | None,
    scheduler: str | None,
    seeds: tuple[int, ...],
    given: dict[str, Any],
    only_check: bool,
    junit: Path | None,
    markdown: Path | None,
    as_json: bool,
    overwrite: bool,
) -> None:
    """Execute the runs that are missing from the results of a campaign.

    Exit code 4 if a run does not meet a criterion.
    """
    import os

    from hil_bridge.console.progress import run_progress
    from hil_bridge.lab.campaign.digest import digest_of
    from hil_bridge.lab.campaign.report_text import failing_lines
    from hil_bridge.lab.campaign.scheduler import dask_workers
    from hil_bridge.lab.campaign.store import Store
    from hil_bridge.lab.campaign.working import missing, work
    from hil_bridge.runs.signals import as_ctrl_c

    outputs = _Outputs(junit, markdown, overwrite)
    outputs.check()
    plan = _plan_of(file, seeds, given)
    echo = partial(click.echo, err=as_json)
    impossible = len(plan.cases) - len(plan.possible)
    without = f"; {impossible} impossible, see the report" if impossible else ""
    share = f", {plan.cases_per_seed} for each seed" if plan.cases_per_seed else ""
    echo(
        f"{plan.name}: {len(plan.possible)} cases{share} × {len(plan.seeds)} seeds = {plan.count} runs{without}"
    )
    if only_check:
        if as_json:
            counts = {"cases": len(plan.possible), "seeds": len(plan.seeds)}
            echo_json({"name": plan.name, "planned": plan.count, **counts})
        return
    if scheduler is not None and workers is not None:
        raise ConfigError(
            "--workers applies to this machine only; a scheduler uses the workers started for it, leave one option out"
        )
    where = dask_workers(scheduler) if scheduler is not None else workers or os.cpu_count() or 1
    place = out or Path(f"{file.stem}.sqlite")
    with Store.begin(place, plan) as store:
        jobs = missing(plan, store)
        if len(jobs) < plan.count:
            echo(f"{place} has {plan.count - len(jobs)} of them already")
        with run_progress(len(jobs)) as advance:
            try:
                with as_ctrl_c():
                    work(plan, store, jobs, where, advance)
            except KeyboardInterrupt:
                kept = len(store.keys())
                click.echo(f"interrupted: {kept} runs are kept; the same command resumes", err=True)
                raise
        digest = digest_of(store)
        outputs.write(store, digest)
        sittings = store.sittings()
    if as_json:
        echo_json(digest)
    else:
        if sittings and jobs:
            last = sittings[-1]
            click.echo(
                f"{last.runs} runs in {last.wall_s:.1f} s: {last.runs / last.wall_s:.2f} runs/s on "
                f"{last.workers} process{'es' if last.workers > 1 else ''}"
            )
        echo_lines(failing_lines(digest, FAILING_MOST))
        click.echo(f"{digest.tally.text}; hil-bridge campaign report {place}")
    if digest.failing:
        click.get_current_context().exit(FAILED)


@campaign.command(
    cls=ExtrasCommand, extras={"the hunt": "tune"}, short_help="Search for the worst run of a campaign."
)
@click.argument("file", type=FILE)
@click.option(
    "--minutes", type=click.FloatRange(min=0.0), default=60.0, show_default=True, help="Duration of the hunt."
)
@output_option("FILE.sqlite", "Results file.  [default: FILE-hunt.sqlite in the current folder]")
@click.option(
    "--workers", type=click.IntRange(min=1), metavar="N", help="Number of processes.  [default: one per core]"
)
@click.option(
    "--voided",
    is_flag=True,
    help="Measure the force against the bound without what the faults add.",
)
@set_option
@json_option
def hunt(
    file: Path,
    minutes: float,
    out: Path | None,
    workers: int | None,
    voided: bool,
    given: dict[str, Any],
    as_json: bool,
) -> None:
    """Search for the worst run that FILE.toml can draw: the largest true force beyond its bound, or a broken promise.

    The worst run is reduced to the fewest faults and the simplest values. Exit code 4 if a promise was broken. After
    Ctrl-C, the same command resumes the hunt. Requires SciPy.
    """
    import os

    from hil_bridge.console.progress import run_progress
    from hil_bridge.lab.campaign.hunting import badness, badness_voided, is_broken, plan_hunt, running
    from hil_bridge.lab.campaign.hunting import hunt as search
    from hil_bridge.lab.campaign.run_text import describe_run, hunt_values
    from hil_bridge.lab.campaign.shrinking import shrink_bad
    from hil_bridge.lab.campaign.store import Store
    from hil_bridge.runs.signals import as_ctrl_c

    plan = plan_hunt(_plan_of(file, (), given))
    place = out or Path(f"{file.stem}-hunt.sqlite")
    score = badness_voided if voided else badness
    with Store.begin(place, plan) as store:
        with run_progress(None) as advance, as_ctrl_c():
            try:
                with running(plan, store, workers or os.cpu_count() or 1, minutes, advance) as runner:
                    worst = search(runner, score)
                    small = None if worst is None else shrink_bad(runner, worst, score)
            except KeyboardInterrupt:
                click.echo(
                    f"interrupted: {len(store.keys())} runs are kept; the same command resumes", err=True
                )
                raise
        if worst is None or small is None:
            raise ConfigError("no run completed; increase --minutes")
        broken = sum(is_broken(done) for done in store.runs())
        store.keep("worst", worst.key)
        store.keep("smallest", small.key)
        if as_json:
            runs = {"results": place.name, "runs": len(store.keys()), "broken": broken}
            echo_json({**runs, "worst": hunt_values(plan, worst), "smallest": hunt_values(plan, small)})
        else:
            click.echo(f"{len(store.keys())} runs, {broken} of them broke a promise; the worst:")
            for done, label in ((worst, "worst"), (small, "shrunk")):
                if label == "worst" or done.key != worst.key:
                    echo_lines(f"  {line}" for line in describe_run(plan, done, label))
                    click.echo(f"    hil-bridge campaign rerun {place} {done.key}")
    if broken:
        click.get_current_context().exit(FAILED)


@campaign.command(short_help="Write the results as a page or as text.")
@click.argument("results", type=FILE, metavar="FILE.sqlite")
@output_option("PAGE.html", "Page.  [default: next to the results]")
@click.option(
    "--reports",
    is_flag=True,
    help="Write a report.html for each of the worst runs, from its recording, and link it.",
)
@click.option("--text", is_flag=True, help="Print the report as text. Writes a page only with --output.")
@json_option
@_junit_option
@_markdown_option
@overwrite_option
def report(
    results: Path,
    out: Path | None,
    reports: bool,
    text: bool,
    as_json: bool,
    junit: Path | None,
    markdown: Path | None,
    overwrite: bool,
) -> None:
    """Write the results as a self-contained page, or as text, JSON, JUnit or Markdown.

    The page is written unless --text, --json, --junit or --markdown is given.
    """
    from hil_bridge.errors.text_files import harmless
    from hil_bridge.lab.campaign.digest import digest_of
    from hil_bridge.lab.campaign.page import page, write_reports
    from hil_bridge.lab.campaign.report_text import text_report
    from hil_bridge.lab.campaign.store import Store
    from hil_bridge.record.files import write_atomically

    outputs = _Outputs(junit, markdown, overwrite)
    outputs.check()
    others = text or as_json or junit is not None or markdown is not None
    place = out if out is not None or others else results.parent / f"{results.stem}.html"
    with Store.open(results) as store:
        if reports:
            write_reports(store)
        if place is not None:
            write_atomically(place, page(store, place).encode(), overwrite)
        digest = digest_of(store)
        outputs.write(store, digest)
    if as_json:
        echo_json(digest)
    elif text:
        echo_lines(harmless(line) for line in text_report(digest))
    else:
        echo_lines(str(written) for written in (place, junit, markdown) if written is not None)


for command in (rerun, compare, export, bundle, verify):
    campaign.add_command(command)

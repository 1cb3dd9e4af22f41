"""The command `hil-bridge experiment`, which reproduces the figures and tables of the paper."""

from pathlib import Path

import click

from hil_bridge.console.options import output_option
from hil_bridge.console.paths import FILE
from hil_bridge.errors import ConfigError

ALL = "all"


@click.command(short_help="Repeat the paper's figures and tables.")
@click.argument("names", metavar="NAME…|all", nargs=-1, required=True)
@output_option("DIR", "Where pictures, numbers and texts go.", Path("experiments"))
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    default=5,
    show_default=True,
    metavar="N",
    help="Noise seeds behind every mean and spread.",
)
@click.option(
    "--page",
    type=FILE,
    metavar="FILE",
    help="Write the page over all of them here.  [default: index.md in DIR]",
)
@click.option(
    "--workers", type=click.IntRange(min=1), metavar="N", help="Processes.  [default: one for each core]"
)
@click.option("--overwrite", is_flag=True, help="Replace the FILE of --page; the files in DIR always are.")
def experiment(
    names: tuple[str, ...],
    out: Path,
    seeds: int,
    page: Path | None,
    workers: int | None,
    overwrite: bool,
) -> None:
    """Repeat figures and tables of the paper, and say where they differ.

    NAME is rules, fig3-5 (simulation), fig7-8, fig9-11 (the emulated cell in virtual time), resolution,
    controllers, or all. Each leaves its numbers as CSV and, but for rules, a picture, and all together one page; the
    same seeds give the same files.
    """
    from hil_bridge.console.progress import run_progress
    from hil_bridge.record.files import check_place
    from hil_bridge.show.picture_files import drawing_library
    from paper_experiments import EXPERIMENTS, run_jobs, write_findings, write_page

    wanted = list(dict.fromkeys(EXPERIMENTS if ALL in names else names))
    if unknown := [name for name in wanted if name not in EXPERIMENTS]:
        raise ConfigError(f"unknown experiment {unknown[0]!r}; known: {', '.join(EXPERIMENTS)}, {ALL}")
    # Before minutes of work, not after them.
    drawing_library()
    for directory in (out, *([page.parent] if page else [])):
        _make(directory)
    if page is not None:
        check_place(page, overwrite)
    chosen = [EXPERIMENTS[name] for name in wanted]
    jobs = {item.name: item.jobs(seeds) for item in chosen}
    everything = list(dict.fromkeys(job for each in jobs.values() for job in each))
    with run_progress(len(everything)) as advance:
        results = run_jobs(everything, workers, lambda count: advance(count, 0))
    found = {}
    for item in chosen:
        done = jobs[item.name]
        found[item.name] = item.evaluate(done, [results[job] for job in done])
        write_findings(item, found[item.name], out)
        click.echo(f"{item.title}: {out / item.name}.csv")
    page = page or out / "index.md"
    command = f"hil-bridge experiment {' '.join(names)} --seeds {seeds} -o {out} --page {page}"
    write_page(page, out, found, chosen, command)
    click.echo(f"page: {page}")


def _make(directory: Path) -> None:
    """Create a folder and check that it is writable. Raises ConfigError."""
    probe = directory / ".writable"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ConfigError(f"cannot write to {directory}: {error.strerror}") from error

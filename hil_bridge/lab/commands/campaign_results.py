"""`hil-bridge campaign rerun`, `compare`, `export`, `bundle` and `verify`: results of a campaign."""

from pathlib import Path

import click

from hil_bridge.console.options import (
    ExtrasCommand,
    echo_json,
    echo_lines,
    json_option,
    output_option,
    overwrite_option,
)
from hil_bridge.console.paths import FILE
from hil_bridge.errors import ConfigError

DIFFERS = 1
"""Exit code if runs, campaigns or files differ."""


@click.command(short_help="Repeat individual runs, with recordings.")
@click.argument("results", type=FILE, metavar="FILE.sqlite")
@click.argument("key", required=False)
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="All runs of this seed.")
@output_option("DIR", "Folder for the recordings.  [default: current folder]")
@json_option
@overwrite_option
def rerun(
    results: Path, key: str | None, seed: int | None, out: Path | None, as_json: bool, overwrite: bool
) -> None:
    """Repeat the run with this KEY (or its beginning), or all runs of a seed, and save their recordings.

    Exit code 1 if any figure differs from the campaign.
    """
    from hil_bridge.errors.text_files import harmless
    from hil_bridge.lab.campaign.judging import configure_run, run
    from hil_bridge.lab.campaign.orders import describe_order
    from hil_bridge.lab.campaign.repeating import compare_run, repeat_of, select_runs
    from hil_bridge.lab.campaign.store import Store
    from hil_bridge.record.files import check_record_path

    folder, repeated = out or Path(), []
    with Store.open(results) as store:
        plan, chosen = store.plan(), select_runs(store, key, seed)
        same_code = store.fact("code") == plan.code
        if not same_code and not as_json:
            click.echo("the results are from another version of the code; figures may differ", err=True)
        for done in chosen:
            check_record_path(folder / f"{done.key}.mcap", overwrite)
        for done in chosen:
            repeat = repeat_of(plan, done)
            config = configure_run(repeat.job)
            new = run(config)
            place = folder / f"{done.key}.mcap"
            saved = "" if new.result is None else str(new.result.save(place, overwrite=overwrite))
            comparison = compare_run(repeat, new, saved, describe_order(config, new.figures))
            repeated.append(comparison)
            if not as_json:
                echo_lines(harmless(line) for line in comparison.lines)
    if as_json:
        echo_json({"results": results.name, "same_code": same_code, "runs": repeated})
    if any(one.differences for one in repeated):
        click.get_current_context().exit(DIFFERS)


@click.command(short_help="Compare two campaigns run by run.")
@click.argument("before", type=FILE, metavar="A.sqlite")
@click.argument("after", type=FILE, metavar="B.sqlite")
@json_option
def compare(before: Path, after: Path, as_json: bool) -> None:
    """List the differences between two campaigns, for runs of the same cell, fault, phase and seed.

    Exit code 1 if anything differs.
    """
    from hil_bridge.lab.campaign.comparison import compare_campaigns
    from hil_bridge.lab.campaign.store import Store

    with Store.open(before) as first, Store.open(after) as second:
        compared = compare_campaigns(first, second)
    if as_json:
        echo_json(compared)
    else:
        echo_lines(compared.lines)
    if compared.differing:
        click.get_current_context().exit(DIFFERS)


@click.command(
    cls=ExtrasCommand,
    extras={"parquet": "parquet"},
    short_help="Export the results as a table, one row per run.",
)
@click.argument("results", type=FILE, metavar="FILE.sqlite")
@click.option(
    "--to",
    "formats",
    type=click.Choice(["csv", "parquet"]),
    multiple=True,
    default=["parquet"],
    help="File format. Repeatable.  [default: parquet]",
)
@output_option("DIR", "Folder for the files.  [default: next to the results]")
@json_option
@overwrite_option
def export(results: Path, formats: tuple[str, ...], out: Path | None, as_json: bool, overwrite: bool) -> None:
    """Write the runs as a table, one row per run, for pandas and similar tools."""
    from hil_bridge.lab.campaign.store import Store
    from hil_bridge.lab.campaign.table import FORMATS, run_table
    from hil_bridge.record.files import check_place, write_atomically

    folder = results.parent if out is None else out
    places = {folder / f"{results.stem}.{name}": FORMATS[name] for name in dict.fromkeys(formats)}
    with Store.open(results) as store:
        table = run_table(store)
    runs = len(table["key"])
    made = {place: encode(table) for place, encode in places.items()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot create {folder}: {error.strerror}; give another folder") from error
    for place in made:
        check_place(place, overwrite)
    for place, data in made.items():
        write_atomically(place, data, overwrite)
        if not as_json:
            click.echo(f"{place}: {runs} runs")
    if as_json:
        echo_json({"files": [str(place) for place in made], "runs": runs})


@click.command(short_help="Pack results with everything needed to repeat them.")
@click.argument("results", type=FILE, metavar="FILE.sqlite")
@click.option(
    "--seeds",
    "count",
    type=click.IntRange(min=0),
    metavar="N",
    default=1,
    show_default=True,
    help="Number of sampled seeds, whose runs are repeated and recorded in the bundle.",
)
@output_option("BUNDLE.zip", "Bundle.  [default: FILE.zip next to the results]")
@json_option
@overwrite_option
def bundle(results: Path, count: int, out: Path | None, as_json: bool, overwrite: bool) -> None:
    """Pack results with configurations, versions, recordings and a hash of each file, for `hil-bridge campaign verify`.

    The bundle contains the recordings of failed runs and of the sampled seeds, and the policies, rules and height maps
    that settings name. If a repeated run differs from the results, no bundle is written, and the exit code is 1.
    """
    from hil_bridge.console.progress import run_progress
    from hil_bridge.errors.text_files import harmless
    from hil_bridge.lab.campaign.bundle import pack
    from hil_bridge.lab.campaign.store import Store
    from hil_bridge.runs.signals import as_ctrl_c

    with Store.open(results) as store, run_progress(None) as advance, as_ctrl_c():
        packed = pack(store, out or results.with_suffix(".zip"), count, overwrite, advance)
    if as_json:
        echo_json(packed)
    else:
        echo_lines(harmless(line) for line in packed.lines)
    if packed.differing:
        click.get_current_context().exit(DIFFERS)


@click.command(short_help="Verify a bundle, and repeat some of its runs.")
@click.argument("bundle", type=FILE, metavar="BUNDLE.zip")
@click.option(
    "--seeds",
    "count",
    type=click.IntRange(min=0),
    metavar="N",
    help="Number of seeds whose runs are repeated.  [default: those sampled for the bundle]",
)
@json_option
def verify(bundle: Path, count: int | None, as_json: bool) -> None:
    """Check each file of a bundle against its hash, and repeat the runs of some seeds.

    Every figure of a repeated run must be identical in every bit. If the bundle contains the recording of the run, so
    must every cycle. Exit code 1 if a file or a seed was altered, or if a run differs or cannot be repeated on this
    computer. A different version is reported, but is not a failure. No code from a bundle is executed. Create bundles
    with `hil-bridge campaign bundle`.
    """
    from hil_bridge.console.progress import run_progress
    from hil_bridge.errors.text_files import harmless
    from hil_bridge.lab.campaign.verifying import verify as check
    from hil_bridge.runs.signals import as_ctrl_c

    with run_progress(None) as advance, as_ctrl_c():
        verified = check(bundle, count, advance)
    if as_json:
        echo_json(verified)
    else:
        echo_lines(harmless(line) for line in verified.lines)
    if not verified.good:
        click.get_current_context().exit(DIFFERS)

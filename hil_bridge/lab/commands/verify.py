"""`hil-bridge verify`: a bundle of a campaign, checked on another computer or years later."""

from pathlib import Path

import click

from hil_bridge.console.options import json_option, tell, tell_json
from hil_bridge.console.paths import FILE

DIFFERS = 1
"""Exit code when a file was altered or a run differs."""


@click.command(short_help="Check a bundle of a campaign, and repeat some of its runs.")
@click.argument("bundle", type=FILE, metavar="BUNDLE.zip")
@click.option(
    "--seeds",
    "count",
    type=click.IntRange(min=0),
    metavar="N",
    help="Seeds whose runs are repeated.  [default: those that were drawn for the bundle]",
)
@json_option
def verify(bundle: Path, count: int | None, as_json: bool) -> None:
    """Check each file of a bundle against its hash, and repeat the runs of some seeds.

    Every figure of a repeated run must be the same to the last bit, and every cycle where the bundle has its
    recording. Exit code 1 when a file or a seed was altered, or a run differs or cannot be repeated here. Another
    version is told, and alone is no failure. No program of a bundle is run. `hil-bridge campaign bundle` makes bundles.
    """
    from hil_bridge.console.progress import run_progress
    from hil_bridge.errors.text_files import harmless
    from hil_bridge.lab.campaign.verifying import verify as check
    from hil_bridge.runs.signals import as_ctrl_c

    with run_progress(None) as advance, as_ctrl_c():
        verified = check(bundle, count, advance)
    if as_json:
        tell_json(verified)
    else:
        tell(harmless(line) for line in verified.lines)
    if not verified.good:
        click.get_current_context().exit(DIFFERS)

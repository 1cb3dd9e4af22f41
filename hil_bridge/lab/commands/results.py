"""Extensions of the core commands by the lab: campaign results in `view` and `compare`, and broken promises in
`why`.

Each function is an entry point of the group `hil_bridge.extensions`.
"""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.console.options import echo_json, echo_lines

if TYPE_CHECKING:
    from hil_bridge.record import Recording

DIFFERS = 1
"""Exit code if the last campaign is significantly worse than the first."""


def view_results(file: Path, port: int) -> None:
    """Serve the page of a campaign's results until Ctrl-C. Raises ConfigError."""
    from hil_bridge.lab.campaign.live import Results
    from hil_bridge.lab.campaign.store import Store
    from hil_bridge.show.web.serving import show

    with Store.open(file) as store:
        show(Results(store), "table.html", port, click.echo)


def compare_results(files: tuple[Path, ...], out: Path, as_json: bool, overwrite: bool) -> None:
    """Compare the results of campaigns, oldest first, on a page or as JSON. Raises ConfigError."""
    from hil_bridge.errors.text_files import harmless
    from hil_bridge.lab.campaign.store import Store
    from hil_bridge.lab.campaign.trend_page import trend_lines, trend_page
    from hil_bridge.lab.campaign.trends import trend_of
    from hil_bridge.record.files import check_place, write_atomically
    from hil_bridge.show.report.compare import names_of

    if not as_json:
        check_place(out, overwrite)
    with ExitStack() as stack:
        stores = zip(names_of(files), (stack.enter_context(Store.open(path)) for path in files), strict=True)
        trend = trend_of(dict(stores))
    if as_json:
        echo_json(trend)
    else:
        write_atomically(out, trend_page(trend).encode(), overwrite)
        echo_lines(harmless(line) for line in trend_lines(trend))
        click.echo(out)
    if trend.worse:
        click.get_current_context().exit(DIFFERS)


def broken_promises(recording: "Recording") -> tuple[str, ...]:
    """Return the guard promises that a run broke, as text."""
    from hil_bridge.lab.invariants import promises_broken

    return promises_broken(recording)

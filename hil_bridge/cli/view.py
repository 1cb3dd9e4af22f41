"""`hil-bridge view`: a recording or a campaign's results on a page in the browser."""

from pathlib import Path

import click

from hil_bridge.cli.paths import FILE

RECORDING, RESULTS = ".mcap", ".sqlite"


@click.command(short_help="Show a recording or a campaign in the browser.")
@click.argument("file", type=FILE, metavar="FILE")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port.  [default: one that is free]"
)
def view(file: Path, port: int) -> None:
    """Serve a page for FILE on this machine alone, until Ctrl-C: a recording (.mcap) with a slider for its time, or the
    results of a campaign (.sqlite), which may go on meanwhile.

    A run that goes on is shown by `hil-bridge run --web`. Needs the extra web.
    """
    from hil_bridge.errors import ConfigError
    from hil_bridge.show.web.feed import check_extra

    check_extra("hil-bridge view")
    if file.suffix == RECORDING:
        from hil_bridge.record import read
        from hil_bridge.show.web.recorded import teller_of
        from hil_bridge.show.web.serving import show

        show(teller_of(read(file), str(file)), "page.html", port, click.echo)
    elif file.suffix == RESULTS:
        from hil_bridge.lab.campaign.live import Results
        from hil_bridge.lab.campaign.store import Store
        from hil_bridge.show.web.serving import show

        with Store.open(file) as store:
            show(Results(store), "table.html", port, click.echo)
    else:
        raise ConfigError(
            f"{file} is neither a recording ({RECORDING}) nor results of a campaign ({RESULTS})"
        )

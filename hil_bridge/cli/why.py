"""`hil-bridge why`: explain how a recorded run ended."""

from pathlib import Path

import click

from hil_bridge.cli.entry_points import extension
from hil_bridge.console.options import echo_json, json_option
from hil_bridge.console.paths import FILE


@click.command(short_help="Explain how a recorded run ended.")
@click.argument("recording", type=FILE)
@json_option
def why(recording: Path, as_json: bool) -> None:
    """Explain how a recorded run ended: last good cycle, first symptom, cause, what followed, and what to check.

    All of it comes from the recording, including the traceback of code that failed. A run that failed before its
    first control cycle has a cause, too. Promises of the guard that the run did not keep are listed as well.
    """
    from msgspec.structs import asdict

    from hil_bridge.errors.text_files import harmless
    from hil_bridge.record import read_with_traffic
    from hil_bridge.record.analysis.why import tracebacks, why, why_values

    record, _ = read_with_traffic(recording)
    broken = extension("broken-promises", "promises of the guard")(record)
    if as_json:
        echo_json({**asdict(why_values(record, recording)), "promises_broken": list(broken)})
        return
    click.echo(harmless(why(record, recording)))
    for text in broken:
        click.echo(harmless(f"A promise was broken. {text}."))
    for trace in tracebacks(record):
        click.echo(harmless(f"\n{trace.rstrip()}"))

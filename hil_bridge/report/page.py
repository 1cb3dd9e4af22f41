"""The report of a run: one picture, and one page that needs nothing beside itself."""

import base64
import json
from html import escape
from pathlib import Path

from hil_bridge.analysis.summary import Summary
from hil_bridge.analysis.why import why
from hil_bridge.errors import ConfigError
from hil_bridge.recording.files import check_place, write_whole
from hil_bridge.recording.reader import Recording
from hil_bridge.report.figures import merit_rows, quantity, run_rows
from hil_bridge.report.latency_section import latency_section
from hil_bridge.report.markup import pairs, rows, table
from hil_bridge.report.plots import draw, size_px
from hil_bridge.report.sections import controller_section, stability_section, start_time
from hil_bridge.report.steps_section import criteria_paragraph, steps_section
from hil_bridge.report.surface_section import surface_section
from hil_bridge.text_files import parse_json

PICTURE = "report.png"
PAGE = "report.html"
FILES = (PICTURE, PAGE)
EVENTS_SHOWN = 500

_CSS = """
body { font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; color: #222; background: #fff;
       max-width: 1100px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: .3rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; }
.outcome { display: inline-block; padding: .1rem .7rem; border-radius: 1rem; color: #fff; font-weight: 600; }
.completed { background: #00795a; } .stopped { background: #b34700; } .interrupted { background: #6b5b00; }
table { border-collapse: collapse; width: 100%; }
td { text-align: left; padding: .25rem .8rem .25rem 0; border-bottom: 1px solid #ddd; vertical-align: top; }
table.narrow { width: auto; min-width: 20rem; }
td.value { white-space: nowrap; font-variant-numeric: tabular-nums; font-weight: 600; text-align: right; }
th { text-align: left; vertical-align: bottom; padding: .25rem .8rem .25rem 0; border-bottom: 2px solid #bbb;
     font-weight: 600; color: #555; }
p { max-width: 52rem; } p.verdict { border-left: .3rem solid #0072B2; padding-left: .8rem; }
details { margin: .8rem 0; } summary { cursor: pointer; font-weight: 600; }
.scroll { overflow: auto; max-height: 40rem; } table.dense { font-size: 12px; }
table.dense th { position: sticky; top: 0; background: #fff; }
table.dense th, table.dense td { padding: .15rem .7rem .15rem 0; font-variant-numeric: tabular-nums; }
td.note { color: #555; } img { max-width: 100%; height: auto; border: 1px solid #ddd; }
pre { background: #f5f5f5; padding: .8rem; overflow: auto; max-height: 30rem; font-size: 13px; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(26rem, 1fr)); gap: 0 2.5rem; }
"""


def write_report(recording: Recording, summary: Summary, directory: Path, overwrite: bool = False) -> Path:
    """Write the picture and the page into a directory, which is made if need be; the answer is the page.

    Raises ConfigError when the directory cannot be written, or without `overwrite` holds such files already.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot make the directory {directory}: {error.strerror or error}") from error
    for name in FILES:
        check_place(directory / name, overwrite)
    picture = draw(recording, summary)
    write_whole(directory / PICTURE, picture, overwrite)
    write_whole(directory / PAGE, page(recording, summary, picture).encode(), overwrite)
    return directory / PAGE


def page(recording: Recording, summary: Summary, picture: bytes) -> str:
    """The page as HTML with the picture (PNG) inside."""
    title = f"{summary.controller or 'run'}: {summary.outcome}"
    cause = f" {escape(summary.cause)}" if summary.cause else ""
    then = "".join(f"<p>then: {escape(text)}</p>" for text in summary.followed)
    left = f"<p>left: <strong>{escape(summary.left)}</strong></p>" if summary.left else ""
    checks = "".join(f"<li>{escape(text)}</li>" for text in summary.checks)
    before = f"<h2>Before the touch</h2><ul>{checks}</ul>" if checks else ""
    cut = (
        "<p>The recording ends early; everything here covers what is there.</p>" if summary.truncated else ""
    )
    data = base64.b64encode(picture).decode()
    width, height = size_px(recording)
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>{_CSS}</style></head><body>
<h1>Force control run: {escape(summary.controller or "no controller named")}</h1>
<p><span class="outcome {escape(summary.outcome)}">{escape(summary.outcome)}</span>{cause}</p>
{criteria_paragraph(summary)}{then}{left}{cut}<p>{escape(why(recording))}</p>
<div class="columns"><section><h2>Figures of merit</h2>{rows(merit_rows(summary))}
<h2>Phases</h2>{pairs((name, quantity(value, 1, ".2f", "s")) for name, value in summary.phases_s.items())}
</section><section><h2>Run</h2>{rows(run_rows(summary))}</section></div>{before}
<h2>Picture</h2><img alt="Force, depth, correction, stiffness and cycle time over time"
 width="{width}" height="{height}" src="data:image/png;base64,{data}">
{steps_section(recording, summary)}{surface_section(recording)}{latency_section(recording)}
{stability_section(recording, summary)}{controller_section(recording)}
<h2>Link counters</h2>{pairs((name, f"{value:g}") for name, value in summary.link.items())}
<h2>Events</h2>{_events(recording)}
<h2>Configuration and versions</h2>{_metadata(recording)}
</body></html>
"""


def _events(recording: Recording) -> str:
    zero = start_time(recording)
    shown = table(
        (
            f'<td class="value">{event.at - zero:.3f} s</td><td>{escape(event.kind)}</td>'
            f"<td>{escape(event.text)}</td>"
            for event in recording.events[:EVENTS_SHOWN]
        ),
        "narrow",
    )
    more = len(recording.events) - EVENTS_SHOWN
    return shown + (f"<p>and {more} more in the recording</p>" if more > 0 else "")


def _metadata(recording: Recording) -> str:
    return "".join(
        f"<h3>{escape(name)}</h3><pre>{escape(_readable(text))}</pre>"
        for name, text in sorted(recording.metadata.items())
    )


def _readable(text: str) -> str:
    """JSON indented, anything else as it is."""
    try:
        return json.dumps(parse_json(text), indent=2, ensure_ascii=False)
    except ValueError:
        return text

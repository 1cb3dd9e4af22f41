"""Report page of a ROS 2 bag: measurements, assumptions of the reader, and missing parts."""

from html import escape

from hil_bridge.record.analysis.summary import Summary
from hil_bridge.record.foreign import BASE_FRAME, HEADER, ROLES, TOOL_FRAME, WRENCH, Foreign
from hil_bridge.record.reader import Recording
from hil_bridge.show.charts.catalogue import catalogue
from hil_bridge.show.charts.facts import facts_of_recording
from hil_bridge.show.charts.run import run_charts
from hil_bridge.show.pages import document, room
from hil_bridge.show.report.figures import figure_tables
from hil_bridge.show.report.identity import identity_rows
from hil_bridge.show.report.markup import cells, pairs, rows

MISSING = (
    "decisions and their reasons",
    "target force",
    "phases and steps",
    "supervisor verdicts",
    "end and cause",
)
"""Parts of a run that no bag contains."""
_FRAMES = {TOOL_FRAME: "child frame of the pose", BASE_FRAME: "parent frame of the pose"}


def bag_page(recording: Recording, origin: Foreign, summary: Summary) -> str:
    """Render the page of a bag as HTML."""
    return document(*bag_body(recording, origin, summary))


def bag_body(recording: Recording, origin: Foreign, summary: Summary) -> tuple[str, str]:
    """Return the title of the page, and its body as HTML."""
    charts = run_charts(recording)
    drawn = {chart.id for chart in charts.charts}
    without_values = [
        chart.title for chart in catalogue(facts_of_recording(recording)) if chart.id not in drawn
    ]
    (contact, figures), (about, facts) = figure_tables(recording, summary)
    cut = (
        "<p>The bag ends early or is damaged; this page covers the readable part.</p>"
        if summary.truncated
        else ""
    )
    body = f"""<h1>ROS 2 bag: {escape(origin.file)}</h1>{cut}
<div class="columns head"><section>{pairs(identity_rows(recording, summary), "facts")}{rows(facts)}</section>
<section><h2>{escape(contact.capitalize())}</h2>{rows(figures)}</section></div>
<h2>Course</h2>
{room("run", charts)}
<h2>Assumptions</h2>
{_topics(origin)}{assumptions_table(origin)}
<h2>Not in the bag</h2>
<p>A bag does not contain {escape(", ".join(MISSING[:-1]))} or {escape(MISSING[-1])}; they are not estimated here.
These charts have no values: {escape("; ".join(without_values))}.</p>"""
    return f"{about}: {origin.file}", body


def _topics(origin: Foreign) -> str:
    lines = (
        (ROLES[role], topic.name, topic.type, topic.frame or "none", f"{topic.messages}")
        for role, topic in origin.topics.items()
    )
    return cells(("role", "topic", "type", "frame_id", "messages"), lines, "narrow")


def assumptions_table(origin: Foreign) -> str:
    """Render the table of the reader's assumptions."""
    choices = origin.choices
    body = "the environment on the tool" if choices.sign == 1 else "the tool on the environment"
    named = {
        "units": "N, N·m, m (REP 103)",
        "wrench": f"exerted by {body}, along the axes of the {_FRAMES[choices.wrench_in]}",
        "contact axis": f"{choices.axis.partition(':')[2]} of the {_FRAMES[choices.axis_frame]}",
        "force": "the wrench against that axis, positive while pressing",
        "depth": "displacement from the first sample along that axis, as oriented then",
        "contact": f"force above {choices.contact_n:g} N",
        "zero": f"mean of the first {choices.zero_s:g} s" if choices.zero_s else "as recorded",
        "times": "time stamps of the headers" if choices.stamps == HEADER else "recording times",
        "moments": "as recorded" if origin.moments else f"not in {origin.topics[WRENCH].name}",
        "left out": f"{origin.left_out} wrenches without a nearby pose" if origin.left_out else "",
    }
    return cells(("quantity", "assumed"), [row for row in named.items() if row[1]], "narrow settings")

"""The page of a bag of ROS 2: what was measured, how it was read, and what it does not tell."""

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

UNTOLD = (
    "decisions and their reasons",
    "wanted force",
    "phases and steps",
    "verdicts of a guard",
    "end and cause",
)
"""Parts of a run that no bag tells."""
_FRAMES = {TOOL_FRAME: "child frame of the pose", BASE_FRAME: "parent frame of the pose"}


def bag_page(recording: Recording, foreign: Foreign, summary: Summary) -> str:
    """The page of a bag as HTML."""
    return document(*bag_body(recording, foreign, summary))


def bag_body(recording: Recording, foreign: Foreign, summary: Summary) -> tuple[str, str]:
    """Title of the page, and its body as HTML."""
    charts, left_out = run_charts(recording)
    drawn = {chart.id for chart in charts.charts}
    untold = [chart.title for chart in catalogue(facts_of_recording(recording)) if chart.id not in drawn]
    (contact, figures), (about, facts) = figure_tables(recording, summary)
    thinned = f'<p class="quiet">{escape(left_out)}</p>' if left_out else ""
    cut = (
        "<p>The bag ends early or is damaged; everything here covers what is there.</p>"
        if summary.truncated
        else ""
    )
    body = f"""<h1>Bag of ROS 2: {escape(foreign.file)}</h1>{cut}
<div class="columns head"><section>{pairs(identity_rows(recording, summary), "facts")}{rows(facts)}</section>
<section><h2>{escape(contact.capitalize())}</h2>{rows(figures)}</section></div>
<h2>Course</h2>
{room("run", charts)}{thinned}
<h2>Read as</h2>
{_topics(foreign)}{taken_table(foreign)}
<h2>Not in the bag</h2>
<p>A bag does not tell {escape(", ".join(UNTOLD[:-1]))} or {escape(UNTOLD[-1])}; nothing stands for them here.
These charts have no values: {escape("; ".join(untold))}.</p>"""
    return f"{about}: {foreign.file}", body


def _topics(foreign: Foreign) -> str:
    lines = (
        (ROLES[role], topic.name, topic.type, topic.frame or "none", f"{topic.messages}")
        for role, topic in foreign.topics.items()
    )
    return cells(("taken as", "topic", "type", "its frame_id", "messages"), lines, "narrow")


def taken_table(foreign: Foreign) -> str:
    """The assumptions of the reader, in words."""
    choices = foreign.choices
    body = "the surroundings on the tool" if choices.sign == 1 else "the tool on the surroundings"
    named = {
        "units": "N, N·m, m, as ROS 2 has them (REP 103)",
        "wrench": f"that of {body}, along the axes of the {_FRAMES[choices.wrench_in]}",
        "contact axis": f"{choices.axis.partition(':')[2]} of the {_FRAMES[choices.axis_frame]}",
        "force": "the wrench against that axis, positive while pressing",
        "depth": "way along that axis from the first sample, as it stood then",
        "contact": f"force above {choices.contact_n:g} N",
        "zero": f"mean of the first {choices.zero_s:g} s" if choices.zero_s else "as recorded",
        "times": "stamps of the headers" if choices.stamps == HEADER else "times of recording",
        "moments": "as told" if foreign.moments else f"not told by {foreign.topics[WRENCH].name}",
        "left out": f"{foreign.left_out} wrenches without a pose near them" if foreign.left_out else "",
    }
    return cells(("quantity", "taken for"), [row for row in named.items() if row[1]], "narrow settings")

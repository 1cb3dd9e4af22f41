"""Files of the experiments: picture and numbers of each, and one page for all."""

from collections.abc import Mapping, Sequence
from os.path import relpath
from pathlib import Path

from hil_bridge.errors import ConfigError
from hil_bridge.lab.drawing import draw
from hil_bridge.lab.text_tables import markdown_table
from paper_experiments.results import Experiment, Findings, markdown, to_csv

PANELS_ACROSS = 4
"""Maximum number of panels in a row. Chosen: the width of a page."""


def write_findings(experiment: Experiment, findings: Findings, folder: Path) -> list[Path]:
    """Write `NAME.csv` and, if present, `NAME.png` and `NAME-curves.csv`; return the paths.

    Raises ConfigError if the folder cannot be written.
    """
    name = experiment.name
    files = {f"{name}.csv": to_csv(findings.table).encode()}
    if panels := experiment.panels(findings.curves or findings.table):
        files[f"{name}.png"] = draw(panels, min(len(panels), PANELS_ACROSS))
    if findings.curves:
        files[f"{name}-curves.csv"] = to_csv(findings.curves).encode()
    for file, content in files.items():
        _write(folder / file, content)
    return [folder / file for file in files]


def write_page(
    page: Path,
    folder: Path,
    found: Mapping[str, Findings],
    experiments: Sequence[Experiment],
    command: str,
) -> None:
    """Write one page for these experiments, whose files are in `folder`. Raises ConfigError if it cannot be written."""
    prefix = relpath(folder, page.parent).replace("\\", "/")
    prefix = "" if prefix == "." else f"{prefix}/"
    sections = [f"## {each.title}\n\n{_section(each, found[each.name], prefix)}" for each in experiments]
    claims = [
        (each.name, claim.paper, claim.found)
        for each in experiments
        for claim in each.claims(found[each.name].table)
    ]
    table = markdown_table(("experiment", "the paper says", "result here"), claims)
    head = (
        "# The paper's results, repeated\n\n"
        'The results of "A Fuzzy Adaptive Control Design for Compliant Motion of a Manipulator" (IEEE, 1994), '
        "compared with its simulation under its own assumptions, and with its experiments on the complete emulated "
        "chain – sensor board, CAN gateway, bridge, 9600 baud computer link, servo with dead band, contact – in "
        "virtual time. One command writes this page with its numbers and pictures, reproducibly:\n\n"
        f"```\n{command}\n```\n\nAll figures are means over the noise "
        "seeds; `sd` is the standard deviation over them. Curves are those of the first seed. Samples are control "
        "cycles."
    )
    _write(page, ("\n\n".join((head, table, *sections)) + "\n").encode())


def _section(experiment: Experiment, findings: Findings, prefix: str) -> str:
    """Return text, picture, table and links in Markdown; `prefix` is the path from the page to the files."""
    name, parts = experiment.name, [experiment.about]
    if experiment.panels(findings.curves or findings.table):
        parts.append(f"![{experiment.title}]({prefix}{name}.png)")
    parts.append(markdown(experiment.summary(findings.table)))
    links = f"Numbers: [{name}.csv]({prefix}{name}.csv)"
    if findings.curves:
        links += f", curves: [{name}-curves.csv]({prefix}{name}-curves.csv)"
    return "\n\n".join((*parts, links))


def _write(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error

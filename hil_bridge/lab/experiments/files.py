"""The files of experiments: picture, numbers and paragraph of each, and one page over all."""

from collections.abc import Mapping, Sequence
from os.path import relpath
from pathlib import Path

from hil_bridge.errors import ConfigError
from hil_bridge.lab.experiments.results import Experiment, Findings, markdown, to_csv


def write_findings(experiment: Experiment, findings: Findings, folder: Path) -> list[Path]:
    """`NAME.png`, `NAME.csv`, `NAME-curves.csv` where there are curves, and `NAME.md`; the paths.

    Raises ConfigError when the folder cannot be written.
    """
    name = experiment.name
    files: dict[str, bytes] = {
        f"{name}.png": findings.picture,
        f"{name}.csv": to_csv(findings.table).encode(),
        f"{name}.md": f"# {experiment.title}\n\n{section(experiment, findings, '')}\n".encode(),
    }
    if findings.series:
        files[f"{name}-curves.csv"] = to_csv(findings.series).encode()
    for file, content in files.items():
        _write(folder / file, content)
    return [folder / file for file in files]


def section(experiment: Experiment, findings: Findings, prefix: str) -> str:
    """Paragraph, picture, table and links in Markdown; `prefix` leads from the page to the files."""
    text, _ = experiment.describe(findings.table)
    parts = [text, f"![{experiment.title}]({prefix}{experiment.name}.png)"]
    if experiment.page_columns:
        parts.append(markdown(findings.table, experiment.page_columns))
    links = f"Numbers: [{experiment.name}.csv]({prefix}{experiment.name}.csv)"
    if findings.series:
        links += f", curves: [{experiment.name}-curves.csv]({prefix}{experiment.name}-curves.csv)"
    return "\n\n".join((*parts, links))


def write_page(
    page: Path,
    folder: Path,
    found: Mapping[str, Findings],
    experiments: Sequence[Experiment],
    command: str,
) -> None:
    """One page over these experiments, whose files lie in `folder`. Raises ConfigError when it cannot be."""
    prefix = relpath(folder, page.parent).replace("\\", "/")
    prefix = "" if prefix == "." else f"{prefix}/"
    claims = ["| experiment | the paper says | what came out |", "|---|---|---|"]
    sections = []
    for experiment in experiments:
        findings = found[experiment.name]
        _, claimed = experiment.describe(findings.table)
        claims += [f"| {experiment.name} | {claim.paper} | {claim.found} |" for claim in claimed]
        sections.append(f"## {experiment.title}\n\n{section(experiment, findings, prefix)}")
    head = (
        "# The paper's results, repeated\n\n"
        'What "A Fuzzy Adaptive Control Design for Compliant Motion of a Manipulator" '
        "(IEEE, 1994) says, and what "
        f"comes out here: its simulation under its own assumptions, and its experiments through the whole "
        f"emulated chain – sensor board, CAN gateway, bridge, 9600 baud computer link, servo with dead "
        f"band, contact – in virtual time. This page, its numbers and its pictures are written by one "
        f"command, and repeat exactly:\n\n```\n{command}\n```\n\nAll figures are means over the noise "
        f"seeds; `sd` is the standard deviation over them. Samples are control cycles."
    )
    _write(page, ("\n\n".join((head, "\n".join(claims), *sections)) + "\n").encode())


def _write(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error

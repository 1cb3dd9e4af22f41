"""Runner of the pages' console examples: examples run, mistakes detected, and examples refused."""

import re
from pathlib import Path

import pytest
from sybil import Document, Example
from sybil.example import SybilFailure
from sybil.parsers.markdown.lexers import RawFencedCodeBlockLexer

from tools.page_examples import ROOT, begin, commands, end, fences

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *(path for path in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in path.parts),
]
COMMAND = re.compile(r"^(?:\$ |hil-bridge |pip install |pytest |make )", re.MULTILINE)
"""Line that a reader would type."""


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_page_commands_are_in_executed_fences(path: Path) -> None:
    plain = RawFencedCodeBlockLexer(re.compile(r"(?:|sh|bash|shell)$\n", re.MULTILINE))
    document = Document(path.read_text(encoding="utf-8"), str(path))
    loose = [
        region.lexemes["source"] for region in plain(document) if COMMAND.search(region.lexemes["source"])
    ]
    assert not loose, "give these fences the language `console`, and a `$ ` before each command"


def outcomes(tmp_path: Path, text: str) -> list[str]:
    """Return the failure of each example on a page; empty for none."""
    path = tmp_path / "page.md"
    path.write_text(text, encoding="utf-8")
    document = Document.parse(str(path), fences)
    begin(document.namespace)
    try:
        return [outcome(example) for example in document.examples()]
    finally:
        end(document.namespace)


def outcome(example: Example) -> str:
    """Return the failure of one example."""
    try:
        example.evaluate()
    except SybilFailure as failure:
        return failure.result
    return ""


def test_page_example_has_shell_files_and_command(tmp_path: Path) -> None:
    page = """
```console
$ mkdir inner && cd inner
$ (exit 3)
$ echo $?
3
```
```{code-block} text
:caption: sub/told.txt
hello
```
```{code-block} console
:caption: In a second terminal
$ tail -f sub/told.txt
hello
```
```console
$ cat \\
    sub/told.txt
hel...
```
"""
    assert outcomes(tmp_path, page) == ["", "", "", ""]


@pytest.mark.parametrize(
    ("fence", "message"),
    [
        ("$ echo one\ntwo\n", "Expected:\n    two\nGot:\n    one"),
        ("$ (exit 3)\n", "exit code 3"),
        ("$ echo one; (exit 3)\none\n", "exit code 3"),
        ("$ exit 0\n", "ended the shell"),
    ],
)
def test_wrong_page_is_detected(fence: str, message: str, tmp_path: Path) -> None:
    if "shell" in message:
        with pytest.raises(ChildProcessError, match=message):
            outcomes(tmp_path, f"```console\n{fence}```\n")
    else:
        assert message in outcomes(tmp_path, f"```console\n{fence}```\n")[0]


def test_empty_expected_output_is_refused() -> None:
    with pytest.raises(ValueError, match="must not be"):
        commands("$ ls\n...\n")
    with pytest.raises(ValueError, match="must begin with a command"):
        commands("hil-bridge run\n")

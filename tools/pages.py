"""Parts of the tools that write tables into a document: a table, and its place between two marks."""

from collections.abc import Iterable, Mapping, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines
    )


def placed(text: str, contents: Mapping[str, str]) -> str:
    """The document with each content between the marks of its name; the prose around them stays.

    Raises ValueError for a content without its place.
    """
    for name, content in contents.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        before, has_begin, behind = text.partition(begin)
        _, has_end, after = behind.partition(end)
        if not (has_begin and has_end):
            raise ValueError(f"the document has no place for {name!r}: {begin} … {end}")
        text = f"{before}{begin}\n{content}\n{end}{after}"
    return text

"""Documents of Robot Web Services 1.0: a tree of items, written as XHTML or as JSON.

Source: the classes and titles that abb_librws (9ba0837) searches for. Observed: the JSON form and the content type
of documents with one state, as public clients read them. abb_robot_client (rws.py) reads a document of `?json=1`
only if its type is exactly application/json. Controllers of RWS 2.0 send application/hal+json;v=2.0, which clients
request by Accept. Assumed: the enclosing frame, and the JSON form of other documents.
"""

import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

XHTML, JSON = "application/xhtml+xml;v=1.0", "application/json"


class Item(NamedTuple):
    """Resource, or part of one."""

    kind: str
    """Class of its list element, such as `pnl-ctrlstate`."""
    title: str
    values: Mapping[str, str]
    """Texts by class."""
    items: Sequence["Item"] = ()
    href: str = ""
    """Path by which events name the resource."""


def write_xhtml(items: Sequence[Item], part: str = "state") -> bytes:
    """Return a document of these items as XHTML. `part` is the class of its block: state or status."""
    rows = "".join(map(_row, items))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<html xmlns="http://www.w3.org/1999/xhtml"><head><title>emulated</title></head>'
        f'<body><div class="{part}"><ul>{rows}</ul></div></body></html>'
    ).encode()


def _row(item: Item) -> str:
    link = f'<a href={quoteattr(item.href)} rel="self"/>' if item.href else ""
    values = "".join(f'<span class="{name}">{escape(text)}</span>' for name, text in item.values.items())
    inner = f"<ul>{''.join(map(_row, item.items))}</ul>" if item.items else ""
    return f"<li class={quoteattr(item.kind)} title={quoteattr(item.title)}>{link}{values}{inner}</li>"


def write_json(items: Sequence[Item]) -> bytes:
    """Return a document of these items as JSON."""
    return json.dumps({"_embedded": {"_state": [_tree(item) for item in items]}}).encode()


def _tree(item: Item) -> dict[str, object]:
    tree: dict[str, object] = {"_type": item.kind, "_title": item.title, **item.values}
    if item.items:
        tree["items"] = [_tree(one) for one in item.items]
    return tree

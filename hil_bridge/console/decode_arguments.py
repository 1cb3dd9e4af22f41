"""Bytes and frames for `hil-bridge decode`: read from its arguments, and printed as JSON after decoding."""

import json
import sys

from hil_bridge.console.options import echo_lines
from hil_bridge.errors import ConfigError


def print_items(items: list[dict[str, object]]) -> None:
    """Print decoded items as JSON. Exit with code 2 if any of them is invalid."""
    echo_lines([json.dumps(items, indent=1, ensure_ascii=False)])
    if any(item.get("problem") or item.get("problems") or item.get("kind") == "noise" for item in items):
        sys.exit(2)


def read_bytes(hex_bytes: tuple[str, ...]) -> bytes:
    """Return the pasted bytes. Raises ConfigError that names the invalid digit."""
    text = "".join(hex_bytes).replace(":", "").replace(",", "")
    text = "".join(text.split())
    if not text:
        raise ConfigError("HEX: nothing to decode; give byte pairs such as 10 02")
    for position, character in enumerate(text):
        if character not in "0123456789abcdefABCDEF":
            raise ConfigError(
                f"HEX: {character!r} at digit {position + 1} is not a hexadecimal digit; give byte pairs such as 10 02"
            )
    if len(text) % 2:
        raise ConfigError(f"HEX: {len(text)} digits are not complete bytes; one digit is missing or too many")
    return bytes.fromhex(text)


def read_frames(texts: tuple[str, ...]) -> tuple[str, ...]:
    """Return the pasted frames as `ID#DATA`. Frames in lines of candump are accepted too. Raises ConfigError that
    names an invalid line.
    """
    from protocol.can.text import parse_candump

    if any(
        text.startswith("(") or len(text.split()) > 1 for text in texts
    ):  # quoted, or a line that the shell split
        quoted = all(len(text.split()) > 1 for text in texts)
        lines = "\n".join(texts).splitlines() if quoted else [" ".join(texts)]
    elif len(texts) > 1 and not all("#" in text for text in texts):
        lines = [" ".join(texts)]
    else:
        return texts
    frames = []
    for line in filter(str.strip, lines):
        try:
            frames.append(str(parse_candump(line).frame))
        except ValueError as error:
            raise ConfigError(f"{line.strip()[:80]!r}: {error}; quote each line of candump") from error
    return tuple(frames)

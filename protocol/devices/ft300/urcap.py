"""Text stream of an FT 300 behind Robotiq's URCap, served by a Universal Robots controller on TCP port 63351.

A text is `( 12.340000 , -2.500000 , -98.099998 , 0.150000 , -0.025000 , 0.007000 )`: six values in N and N·m. The
next text follows without a line end. A text has no counter, checksum or status. A client sends nothing. Sources,
consulted for facts only: the vendor's own server (Linux/UR of robotiq_ft_sensor_dev 1.0.1, in
nbfigueroa/robotiq_ft300_sensor 40097e5), compiled and run; programs that read the port: MobMonRob/PacketCut,
andreastocco01/ft300_driver.
"""

import re
from collections.abc import Sequence

from protocol.devices.ft300.messages import COUNT_END, SCALES
from protocol.geometry import Wrench
from protocol.wrench import AXES

URCAP_PORT = 63351
"""TCP port of the text stream. Source: the vendor's server."""
TEXT_LIMIT = 128
"""Maximum number of characters in a text. Derived: more than six of the longest values with their separators."""
_ENDS = tuple(2.0 * (COUNT_END + 1) * scale for scale in SCALES)
"""Upper limit of the magnitude of each value, N or N·m. Derived: a value is the difference of two counts, because
the URCap subtracts its own zero.
"""
_COUNTED_FROM = 0.25
"""Number of invalid bytes, as a fraction of a text, from which they count as a missed text. Chosen."""
_VALUE = r"\s*([+-]?\d+(?:\.\d+)?)\s*"
_TEXT = re.compile(rf"\({','.join([_VALUE] * len(AXES))}\)", re.ASCII)


def encode_text(values: Sequence[float]) -> bytes:
    """Encode six values, N and N·m, as a text."""
    return f"( {' , '.join(f'{value:f}' for value in values)} )".encode()


def split_texts(data: bytes) -> list[bytes]:
    """Split received bytes into separate texts."""
    return re.findall(rb"[^)]+\)?|\)", data)


class TextReader:
    """Extractor of texts from bytes that may be split at any point and may be invalid."""

    def __init__(self) -> None:
        self._waiting = ""
        self.noises = 0
        """Number of unbroken runs of bytes that belong to no text."""
        self.missed = 0
        """Number of texts lost in runs of invalid bytes, estimated from the length of each run."""
        self._in_noise = False
        self._noise_bytes = 0

    def feed(self, data: bytes) -> list[Wrench]:
        """Process received bytes and return the values of the complete texts, oldest first. At most `TEXT_LIMIT`
        bytes are buffered.
        """
        waiting, at, texts = self._waiting + data.decode("ascii", "replace"), 0, []
        for match in _TEXT.finditer(waiting):
            values = _values(match)
            if values is None:
                continue
            self._count_noise(waiting[at : match.start()])
            at = match.end()
            texts.append(values)
            self.missed += int(self._noise_bytes / len(match[0]) + 1.0 - _COUNTED_FROM)
            self._in_noise, self._noise_bytes = False, 0
        begin = waiting.rfind("(", at)
        if begin < 0 or ")" in waiting[begin:] or len(waiting) - begin > TEXT_LIMIT:
            begin = len(waiting)
        self._count_noise(waiting[at:begin])
        self._waiting = waiting[begin:]
        return texts

    def _count_noise(self, noise: str) -> None:
        """Count the invalid bytes before a text. Blanks and line ends alone do not count."""
        if self._in_noise or noise.strip():
            self.noises += not self._in_noise
            self._in_noise = True
            self._noise_bytes += len(noise)


def describe_texts(raw: bytes) -> list[dict[str, object]]:
    """Describe texts and all other bytes, in order, as plain values for display."""
    text, at = raw.decode("ascii", "replace"), 0
    items: list[dict[str, object]] = []
    for match in _TEXT.finditer(text):
        items += _noise(text[at : match.start()], at)
        values, at = _values(match), match.end()
        problems = [] if values else ["a value that no FT 300 can report, or too long"]
        fields = [
            {"name": axis, "raw": part, "value": float(part), "unit": unit, "mark": "observed", "meaning": ""}
            for axis, part, unit in zip(AXES, match.groups(), ("N",) * 3 + ("N·m",) * 3, strict=True)
        ]
        size = len(match[0])
        items.append(
            {"offset": match.start(), "size": size, "kind": "text", "fields": fields, "problems": problems}
        )
    return items + _noise(text[at:], at)


def _noise(part: str, at: int) -> list[dict[str, object]]:
    if not part.strip():
        return []
    problems = ["not a text of six values in brackets"]
    return [{"offset": at, "size": len(part), "kind": "noise", "fields": [], "problems": problems}]


def _values(match: re.Match[str]) -> Wrench | None:
    """Return the six values of a text; None if a value exceeds the range of any sensor, or if the text is too long."""
    a, b, c, d, e, f = values = tuple(map(float, match.groups()))
    fits = all(abs(value) < end for value, end in zip(values, _ENDS, strict=True))
    fits = fits and len(match[0]) <= TEXT_LIMIT
    return (a, b, c, d, e, f) if fits else None

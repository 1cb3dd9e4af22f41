"""Texts of an FT 300 behind Robotiq's URCap, which a Universal Robots controller serves on TCP port 63351.

`( 12.340000 , -2.500000 , -98.099998 , 0.150000 , -0.025000 , 0.007000 )`: six values in N and N·m. The next text
follows without a line end. There is no counter, check or status. A client sends nothing. Sources, read for facts only:
the maker's own server (Linux/UR of robotiq_ft_sensor_dev 1.0.1, in nbfigueroa/robotiq_ft300_sensor 40097e5), compiled
and run; programs that read the port: MobMonRob/PacketCut, andreastocco01/ft300_driver.
"""

import re
from collections.abc import Sequence

from protocol.devices.ft300.messages import COUNT_END, SCALES
from protocol.geometry import Wrench
from protocol.wrench import AXES

URCAP_PORT = 63351
"""Source: the maker's server."""
TEXT_LIMIT = 128
"""Most characters of a text. Derived: more than six of the longest values and what stands between them."""
_ENDS = tuple(2.0 * (COUNT_END + 1) * scale for scale in SCALES)
"""Derived: a value is the difference of two counts, for the URCap takes off its own zero."""
_COUNTED_FROM = 0.25
"""Chosen: part of a text from which bytes that make none take the place of one."""
_VALUE = r"\s*([+-]?\d+(?:\.\d+)?)\s*"
_TEXT = re.compile(rf"\({','.join([_VALUE] * len(AXES))}\)", re.ASCII)


def encode_text(values: Sequence[float]) -> bytes:
    """Encode six values, N and N·m, as text."""
    return f"( {' , '.join(f'{value:f}' for value in values)} )".encode()


def split_texts(data: bytes) -> list[bytes]:
    """Bytes of the server, each text for itself."""
    return re.findall(rb"[^)]+\)?|\)", data)


class TextReader:
    """Texts out of bytes that begin and end anywhere, and may be anything."""

    def __init__(self) -> None:
        self._waiting = ""
        self.noises = 0
        """Unbroken runs of bytes that belong to no text."""
        self.missed = 0
        """Texts that these runs take the place of, by their length."""
        self._in_noise = False
        self._noise_bytes = 0

    def feed(self, data: bytes) -> list[Wrench]:
        """Take what came; the values of the complete texts, oldest first. At most `TEXT_LIMIT` bytes are kept."""
        waiting, at, found = self._waiting + data.decode("ascii", "replace"), 0, []
        for match in _TEXT.finditer(waiting):
            values = _values(match)
            if values is None:
                continue
            self._note(waiting[at : match.start()])
            at = match.end()
            found.append(values)
            self.missed += int(self._noise_bytes / len(match[0]) + 1.0 - _COUNTED_FROM)
            self._in_noise, self._noise_bytes = False, 0
        begin = waiting.rfind("(", at)
        if begin < 0 or ")" in waiting[begin:] or len(waiting) - begin > TEXT_LIMIT:
            begin = len(waiting)
        self._note(waiting[at:begin])
        self._waiting = waiting[begin:]
        return found

    def _note(self, noise: str) -> None:
        """Count what stands before a text; blanks and line ends are none."""
        if self._in_noise or noise.strip():
            self.noises += not self._in_noise
            self._in_noise = True
            self._noise_bytes += len(noise)


def describe_texts(raw: bytes) -> list[dict[str, object]]:
    """Texts and what is none, in order, as plain values for people to read."""
    text, at = raw.decode("ascii", "replace"), 0
    items: list[dict[str, object]] = []
    for match in _TEXT.finditer(text):
        items += _noise(text[at : match.start()], at)
        values, at = _values(match), match.end()
        problems = [] if values else ["a value that no FT 300 can tell, or too long"]
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
    problems = ["no text of six values in brackets"]
    return [{"offset": at, "size": len(part), "kind": "noise", "fields": [], "problems": problems}]


def _values(match: re.Match[str]) -> Wrench | None:
    """Six values; None where one is larger than any that a sensor can tell, and for a text that is too long."""
    a, b, c, d, e, f = values = tuple(map(float, match.groups()))
    fits = all(abs(value) < end for value, end in zip(values, _ENDS, strict=True))
    fits = fits and len(match[0]) <= TEXT_LIMIT
    return (a, b, c, d, e, f) if fits else None

"""Pages of an emulated Net F/T: its configuration as XML, and the forms that change it."""

import math
from urllib.parse import parse_qsl, urlsplit

import numpy as np

from emulators.devices.netft.box import NetBox
from protocol.devices.netft.http import encode_answer, read_get
from protocol.devices.netft.page import FILTERS_HZ, PAGE
from protocol.devices.netft.records import AXIA_RATES_HZ, BUFFER_LIMIT, FAMILIES
from protocol.endpoint import RemoteProtocolError

CALIBRATION_PAGE = "/netftcalapi.xml"
"""Path of the calibration page. Source: manual."""
_FORMS = ("/setting.cgi", "/comm.cgi", "/config.cgi", "/moncon.cgi")
_VARIABLES = ("setuserfilter", "setbias", "comrdte", "comrdtrate", "comrdtbsiz", "setadcrate")
"""Names of the variables that have an effect, without the number of a gage."""
_GAGE_END = 2.0**31 - 1.0


def answer(request: bytes, box: NetBox, now: float) -> bytes | None:
    """Return the answer to the bytes that a browser has sent so far.

    None if the request is incomplete, and while the box boots.
    """
    try:
        target = read_get(request)
    except RemoteProtocolError:
        return encode_answer(b"", "400 Bad Request", "text/plain")
    if target is None or now < box.ready_at:
        return None
    try:
        parts = urlsplit(target)
    except ValueError:
        return encode_answer(b"", "400 Bad Request", "text/plain")
    if parts.path == PAGE:
        return encode_answer(_document("netft", _configuration(box, now)))
    if parts.path == CALIBRATION_PAGE:
        return encode_answer(_document("netftCalibration", _calibration(box)))
    if parts.path in _FORMS:
        for name, value in parse_qsl(parts.query):
            _set(box, (parts.path, name, value), now)
        return encode_answer(b"<html><body>done</body></html>", kind="text/html")
    return encode_answer(b"", "404 Not Found", "text/plain")


def _document(root: str, values: dict[str, str]) -> bytes:
    tags = "".join(f"<{name}>{value}</{name}>" for name, value in values.items())
    return f'<?xml version="1.0"?>\n<{root}>{tags}</{root}>\n'.encode("ascii")


def _configuration(box: NetBox, now: float) -> dict[str, str]:
    profile = box.profile
    per_force, per_torque = (
        max(1, round(profile.counts_per_unit / (box.reported_scale(kind, now) or 1.0)))
        for kind in ("forces", "moments")
    )
    rates = {"setrate": f"{box.adc_rate_hz}"} if profile.family == "axia" else {}
    return {
        "prodname": "Net F/T emulator",
        "runstat": f"0x{box.status(box.newest(now), now):08x}",
        "runft": _row(box.counts),
        "runrate": f"{box.adc_rate_hz}",
        **rates,
        "setcfgsel": "0",
        "setuserfilter": f"{box.filter.number}",
        "setbias": _row(round(value) for value in box.bias.tolist()),
        "cfgnam": "default",
        "cfgcalsel": "0",
        "cfgfu": "2",
        "scfgfu": "N",
        "cfgtu": "3",
        "scfgtu": "Nm",
        "cfgcpf": f"{per_force}",
        "cfgcpt": f"{per_torque}",
        "cfgmr": _row(f"{value:g}" for value in (*profile.ratings_n, *profile.ratings_nm)),
        "comrdte": "Enabled" if box.streams else "Disabled",
        "comrdtrate": f"{box.rate_used_hz}",
        "comrdtbsiz": f"{box.buffered_records}",
        "netip": "127.0.0.1",
    }


def _calibration(box: NetBox) -> dict[str, str]:
    profile = box.profile
    return {
        "calsn": "EMULATED",
        "calcpf": f"{profile.counts_per_unit}",
        "calcpt": f"{profile.counts_per_unit}",
        "scalfu": "N",
        "scaltu": "Nm",
        "calmr": _row(f"{value:g}" for value in (*profile.ratings_n, *profile.ratings_nm)),
    }


def _row(values: object) -> str:
    return ";".join(str(value) for value in values)  # type: ignore[attr-defined]


def _set(box: NetBox, change: tuple[str, str, str], now: float) -> None:
    """Set a variable, given by form, name and text.

    An unknown variable, a variable of another form and an impossible value are ignored. Mark: assumed.
    """
    form, name, text = change
    if name.rstrip("0123456789") not in _VARIABLES:
        box.unmodelled.touch(f"variable {name} of {form}", "answered as done, without effect")
    value = _number(text)
    if value is None:
        return
    if form == "/setting.cgi":
        if name == "setuserfilter" and 0 <= value < len(FILTERS_HZ):
            box.filter.number = int(value)
        elif name.startswith("setbias") and name[7:] in tuple("012345") and abs(value) <= _GAGE_END:
            bias = np.array(box.bias)
            bias[int(name[7:])] = value
            box.bias = bias
        elif name == "setadcrate" and box.profile.family == "axia" and value in AXIA_RATES_HZ:
            box.set_adc_rate(int(value), now)
    elif form == "/comm.cgi":
        if name == "comrdte" and value in (0, 1):
            box.streams = bool(value)
        elif name == "comrdtrate" and 1 <= value <= FAMILIES[box.profile.family].rate_hz:
            box.rate_hz = float(int(value))
        elif name == "comrdtbsiz" and 1 <= value <= BUFFER_LIMIT:
            box.buffered_records = int(value)


def _number(text: str) -> float | None:
    if len(text) > 20:
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


class PageEndpoint:
    """Pages on a byte wire in memory: an `Endpoint` that answers successive GET requests."""

    def __init__(self, box: NetBox) -> None:
        self._box = box
        self._received = b""
        self._out = b""

    def receive(self, data: bytes, now: float) -> None:
        """Receive bytes of a request."""
        self._received += data
        self._answer(now)

    def next_event(self) -> None:
        """Return None: there are no events."""

    def data_to_send(self, now: float) -> bytes:
        """Return the answer, once."""
        out, self._out = self._out, b""
        return out

    def next_deadline(self) -> float | None:
        """Return None: there is no deadline."""
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing: there is no deadline."""

    def _answer(self, now: float) -> None:
        if (page := answer(self._received, self._box, now)) is not None:
            self._out, self._received = page, b""
        elif now < self._box.ready_at:
            self._received = b""  # a box receives nothing while it boots

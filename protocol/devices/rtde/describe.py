"""Textual description of bytes captured from a controller's connections."""

from collections.abc import Callable, Mapping
from typing import Any

from protocol.devices.rtde import packets
from protocol.devices.rtde.describe_states import NAMED, describe_packet, packet_size
from protocol.devices.rtde.fields import IN_USE, INPUTS, NOT_FOUND, OUTPUTS, Recipe, Value, Variable
from protocol.devices.rtde.packets import HEADER, Kind, Level, Types
from protocol.devices.rtde.states import SafetyBits, StatusBits, name_of
from protocol.endpoint import RemoteProtocolError

_WORDS: Mapping[Kind, str] = {
    Kind.VERSION: "protocol version",
    Kind.CONTROLLER_VERSION: "controller version",
    Kind.TEXT: "text",
    Kind.DATA: "data",
    Kind.OUTPUTS: "output recipe",
    Kind.INPUTS: "input recipe",
    Kind.START: "start",
    Kind.PAUSE: "pause",
}
_TEXT = frozenset(range(0x20, 0x7F)) | {0x09, 0x0A, 0x0D}


def describe(raw: bytes) -> list[dict[str, Any]]:
    """Describe packets of RTDE, of the primary and the real-time interface, lines of text, and all other bytes.

    The bytes may be from one or both directions. Data packets can be decoded only after the negotiation of their
    recipe. Every item has `offset`, `size` and `kind` ("packet", "text" or "noise"). A packet adds `op`, `fields`
    with units, and `problems`. Never raises, regardless of the bytes.
    """
    reader = _Reading()
    items: list[dict[str, Any]] = []
    at = 0
    while at < len(raw):
        if size := packet_size(raw, at):
            packet = describe_packet(raw[at : at + size])
            items.append({"offset": at, "size": size, "kind": "packet", **packet})
            at += size
            continue
        if _begins_packet(raw, at):
            size, kind = HEADER.unpack_from(raw, at)
            items.append(reader.packet(at, Kind(kind), raw[at + HEADER.size : at + size]))
            at += size
            continue
        end = at + 1
        while end < len(raw) and not (_begins_packet(raw, end) or packet_size(raw, end)):
            end += 1
        items.append(_other(at, raw[at:end]))
        at = end
    return items


def _begins_packet(raw: bytes, at: int) -> bool:
    """Return whether a complete packet starts here. Text is not mistaken for a packet, because its first two bytes
    would give a size that is too large.
    """
    if at + HEADER.size > len(raw):
        return False
    size, kind = HEADER.unpack_from(raw, at)
    return HEADER.size <= size <= len(raw) - at and kind in _KINDS and size < 0x2020


_KINDS = frozenset(Kind)


def _other(at: int, raw: bytes) -> dict[str, Any]:
    item: dict[str, Any] = {"offset": at, "size": len(raw)}
    if set(raw) <= _TEXT:
        return {**item, "kind": "text", "meaning": "dashboard or script", "text": raw.decode("ascii")}
    cut = "not a packet, or a damaged or truncated one"
    return {**item, "kind": "noise", "meaning": cut, "bytes": raw.hex(" ").upper()}


class _Reading:
    """Decoder of single packets that keeps track of the negotiated variables."""

    def __init__(self) -> None:
        self._requested: dict[Kind, tuple[str, ...]] = {}
        """Names in the last list of outputs and in the last list of inputs."""
        self._recipes: dict[int, list[Recipe]] = {}
        """Recipes by their numbers, for both directions, the newest last."""

    def packet(self, at: int, kind: Kind, payload: bytes) -> dict[str, Any]:
        """Describe a packet."""
        problems: list[str] = []
        fields: list[dict[str, Any]] = []
        try:
            _READERS[kind](self, payload, fields, problems)
        except RemoteProtocolError as error:
            problems.append(str(error))
        return {
            "offset": at,
            "size": len(payload) + HEADER.size,
            "kind": "packet",
            "op": _WORDS[kind],
            "fields": fields,
            "problems": problems,
        }

    def version(self, payload: bytes, fields: list[dict[str, Any]], problems: list[str]) -> None:
        if len(payload) == 1:
            self.answer(payload, fields, problems)
            return
        version = packets.read_version_request(payload)
        fields += packets.VERSION_REQUEST.describe(payload)
        if version != packets.PROTOCOL_VERSION:
            problems.append("only version 2 is supported")

    def controller_version(self, payload: bytes, fields: list[dict[str, Any]], problems: list[str]) -> None:
        if payload:
            version = ".".join(map(str, packets.read_controller_version(payload)))
            fields.append(_field("version", version, version))

    def answer(self, payload: bytes, fields: list[dict[str, Any]], problems: list[str]) -> None:
        if not payload:
            return
        accepted = packets.read_accepted(payload)
        fields.append(_field("accepted", payload[0], accepted))
        if not accepted:
            problems.append("the controller refuses")

    def text(self, payload: bytes, fields: list[dict[str, Any]], problems: list[str]) -> None:
        message = packets.read_text(payload)
        fields.append(_field("message", message.message, message.message))
        fields.append(_field("source", message.source, message.source))
        fields.append(_field("level", message.level, name_of(Level, message.level)))

    def outputs(self, payload: bytes, fields: list[dict[str, Any]], problems: list[str]) -> None:
        if self._is_answer(payload):
            self._process_types(Kind.OUTPUTS, payload, fields, problems)
            return
        _, names = packets.read_outputs_request(payload)
        fields += packets.OUTPUTS_HEAD.describe(payload)
        self._process_names(Kind.OUTPUTS, names, fields, problems)

    def inputs(self, payload: bytes, fields: list[dict[str, Any]], problems: list[str]) -> None:
        if self._is_answer(payload):
            self._process_types(Kind.INPUTS, payload, fields, problems)
        else:
            self._process_names(Kind.INPUTS, packets.split_names(payload), fields, problems)

    def data(self, payload: bytes, fields: list[dict[str, Any]], problems: list[str]) -> None:
        if not payload:
            problems.append("a data packet without the number of its recipe")
            return
        for recipe in reversed(self._recipes.get(payload[0], [])):
            if recipe.size == len(payload):
                for name, value in recipe.values(recipe.unpack(payload)).items():
                    fields.append(_variable(name, value))
                return
        fields.append(_field("recipe", payload[0], payload[0]))
        problems.append("the negotiation of its recipe is not in the capture, or has another length")

    @staticmethod
    def _is_answer(payload: bytes) -> bool:
        """Return whether a list is a response. A response contains only types, whereas names are in lower case."""
        rest = payload[1:]
        return bool(rest) and rest.upper() == rest

    def _process_names(
        self, kind: Kind, names: tuple[str, ...], fields: list[dict[str, Any]], problems: list[str]
    ) -> None:
        self._requested[kind] = names
        table = OUTPUTS if kind is Kind.OUTPUTS else INPUTS
        fields.extend(_field("name", name, name) for name in names)
        problems.extend(f"unknown variable {name!r}" for name in names if name not in table)

    def _process_types(
        self, kind: Kind, payload: bytes, fields: list[dict[str, Any]], problems: list[str]
    ) -> None:
        answer: Types = packets.read_types(payload)
        fields.append(_field("recipe", answer.recipe, answer.recipe))
        names = self._requested.get(kind, ())
        for number, type_name in enumerate(answer.types):
            name = names[number] if number < len(names) else f"variable {number + 1}"
            fields.append(_field(name, type_name, type_name))
            if type_name in (NOT_FOUND, IN_USE):
                problems.append(f"{name}: {'not found' if type_name == NOT_FOUND else 'in use'}")
        if answer.recipe and len(names) == len(answer.types):
            try:
                recipe = Recipe(answer.recipe, names, answer.types)
                recipe.size  # noqa: B018 - raises for an unknown type
            except KeyError as error:
                problems.append(f"unknown type {error.args[0]}")
                return
            self._recipes.setdefault(answer.recipe, []).append(recipe)


_READERS: Mapping[Kind, Callable[[_Reading, bytes, list[dict[str, Any]], list[str]], None]] = {
    Kind.VERSION: _Reading.version,
    Kind.CONTROLLER_VERSION: _Reading.controller_version,
    Kind.TEXT: _Reading.text,
    Kind.DATA: _Reading.data,
    Kind.OUTPUTS: _Reading.outputs,
    Kind.INPUTS: _Reading.inputs,
    Kind.START: _Reading.answer,
    Kind.PAUSE: _Reading.answer,
}


def _field(name: str, raw: Any, value: Any, unit: str = "", meaning: str = "") -> dict[str, Any]:
    return {"name": name, "raw": raw, "value": value, "unit": unit, "mark": "observed", "meaning": meaning}


_BITS = {"safety_status_bits": SafetyBits, "robot_status_bits": StatusBits}


def _variable(name: str, value: Value) -> dict[str, Any]:
    variable = OUTPUTS.get(name) or INPUTS.get(name) or Variable("")
    text: Any = value
    if not isinstance(value, tuple):
        if name in NAMED:
            text = name_of(NAMED[name], value)
        elif name in _BITS:
            bits = [bit.name or "" for bit in _BITS[name] if int(value) & bit]
            text = ", ".join(bits).lower().replace("_", " ")
    return _field(name, value, text, variable.unit, variable.meaning)

"""Messages of a recording: each fact once, each valid by its schema, even for strict readers."""

import json
import math
import re
from collections import Counter
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from msgspec import structs

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.sample import Sample
from hil_bridge.record import CycleRecord, EventKind, EventRecord, SensorRecord, read
from hil_bridge.record.records import TruthRecord
from hil_bridge.record.scenes import SCENE_TOPICS
from hil_bridge.record.time_axis import ORDER_WINDOW_S
from hil_bridge.record.topics import CYCLE, SENSOR, TOPICS, TRUTH, Record, Topic
from tests.near_surface import CLOSE, merged
from tests.record.written_recordings import cycle, wall_ns, write
from tests.recordings import Recordings


def test_cycle_roundtrip_keeps_complete_sample(recorded: Path) -> None:
    for record in read(recorded).cycles:
        message = json.loads(CYCLE.encode(record))
        assert not message.keys() & message["sample"].keys() - {"force", "held"}, "each fact is recorded once"
        assert repr(CYCLE.decode(CYCLE.encode(record))) == repr(record)


def test_schema_descriptions_match_field_docstrings() -> None:
    schema: Any = CYCLE.schema
    columns = schema["properties"]
    assert columns["correction"] == {
        "type": "number",
        "description": "Change of the commanded depth in this cycle, m; the feedback law's part of it is in "
        "`explanation`.",
    }
    assert columns["stiffness"]["type"] == "number"
    assert columns["sample"]["type"] == "object"
    assert columns["sample"]["properties"]["position"]["items"] == {"type": "number"}
    assert columns["explanation"]["additionalProperties"] == {"type": ["number", "null"]}
    assert columns["verdict"]["enum"] == ["allow", "clamp", "stop"]
    assert columns["phase"]["enum"] == [*Phase]
    assert columns["target"] == {
        "type": "array",
        "prefixItems": [{"type": ["number", "null"]}] * 3,
        "items": {"type": "number"},
        "minItems": 3,
        "maxItems": 3,
        "description": "Tool position that the supervisor allowed, robot base frame, m; "
        "commanded in whole device steps.",
    }
    assert {"cycle", "phase", "controlled_at", "sample"} <= {*schema["required"]}
    assert not {"force", "stiffness", "asked"} & {*schema["required"]}
    sensor: Any = SENSOR.schema["properties"]
    assert sensor["counts"]["items"] == {"type": "number"}  # a device may report N
    for topic in TOPICS:
        properties: Any = topic.schema["properties"]
        assert all(column["description"] for column in properties.values()), topic.name


# --- strict readers


def checked_messages(path: Path) -> tuple[dict[str, int], list[str]]:
    """Return how many messages of each topic are valid by their own schema, and the errors of the others."""
    valid: Counter[str] = Counter()
    wrong = []
    validators: dict[int, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            if schema.id not in validators:
                rules = json.loads(schema.data)
                judge = jsonschema.validators.validator_for(rules, jsonschema.Draft202012Validator)
                judge.check_schema(rules)
                validators[schema.id] = judge(rules)
            reported = json.loads(message.data, parse_constant=pytest.fail)
            flaws = [
                f"{channel.topic} {flaw.json_path}" for flaw in validators[schema.id].iter_errors(reported)
            ]
            valid[channel.topic] += not flaws
            wrong += flaws
    return dict(valid), wrong


def is_accepted_by_foxglove(schema: Any) -> bool:
    """Return whether Foxglove accepts a schema: a single type name everywhere.

    Source: parseJsonSchema.ts of foxglove/studio.
    """
    text = ("boolean", "string", "number", "integer", "object", "array")
    match schema["type"]:
        case "object":
            return all(map(is_accepted_by_foxglove, schema["properties"].values()))
        case "array":
            return schema["items"]["type"] != "array" and is_accepted_by_foxglove(schema["items"])
        case word:
            return isinstance(word, str) and word in text


@pytest.fixture(scope="module", params=["jr3", "jr3-uart", "jr3-board"])
def recorded(request: pytest.FixtureRequest, recordings: Recordings) -> Path:
    """Return a recording of a run with each built-in sensor."""
    line = {"kind": "line", "length_mm": 20.0}
    steps = [{"do": "approach"}, {"do": "track", "path": line, "for_s": 4.0}, {"do": "retract"}]
    return recordings.path(merged(CLOSE, {"task": {"step": steps}, "sensor": {"emulated": request.param}}))


@pytest.mark.sweep
def test_run_messages_are_valid_by_their_schemas(recorded: Path) -> None:
    valid, wrong = checked_messages(recorded)
    assert wrong == []
    assert valid.keys() == {topic.name for topic in (*TOPICS, *SCENE_TOPICS)}
    assert valid["/cycle"] > 20
    assert valid["/sensor"] > 500


def test_schemas_are_accepted_by_foxglove() -> None:
    assert all(is_accepted_by_foxglove(topic.schema) for topic in (*TOPICS, *SCENE_TOPICS))
    assert not is_accepted_by_foxglove({"type": "object", "properties": {"a": {"type": ["number", "null"]}}})


def test_log_times_decrease_at_most_by_window(recorded: Path) -> None:
    newest, behind = 0, 0
    with recorded.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(log_time_order=False):
            newest = max(newest, message.log_time)
            behind = max(behind, newest - message.log_time)
            assert message.publish_time == message.log_time  # no usual run comes close to the window
    assert 0 < behind < ORDER_WINDOW_S * 1e9


def test_late_record_is_placed_at_window(tmp_path: Path) -> None:
    late = EventRecord(100.0, EventKind.PHASE, "track")
    path = write(tmp_path / "run.mcap", [cycle(0, 150.0), late])
    with path.open("rb") as file:
        ((_, _, reported),) = make_reader(file).iter_messages(topics="/event", log_time_order=False)
    assert reported.log_time == wall_ns(150.0705 - ORDER_WINDOW_S)
    assert reported.publish_time == wall_ns(100.0)
    assert [*read(path).events] == [late]


KNOWN = st.none() | st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.lists(st.floats(), min_size=6, max_size=6),
    st.floats(),
    KNOWN,
    st.dictionaries(st.text(), st.floats()),
)
def test_every_number_gives_a_valid_message(
    six: list[float], force: float, stiffness: float | None, explanation: dict[str, float]
) -> None:
    sample = Sample(force, (force, 0.0, 0.0), force, 1.0, 1.0, 1, wrench=tuple(six), position_at=stiffness)
    sample = structs.replace(sample, peak_force=force, gap=six[0])
    odd = cycle(0, 1.0, force=force, stiffness=stiffness, gain=force)
    odd = structs.replace(odd, explanation=explanation, sample=sample)
    for topic, record in (
        (CYCLE, odd),
        (SENSOR, SensorRecord(1.0, 1, tuple(six))),
        (TRUTH, TruthRecord(1, 1.0, force, force, (force,) * 3, (force,) * 3, tuple(six))),
    ):
        reported = json.loads(topic.encode(record))
        jsonschema.Draft202012Validator(topic.schema).validate(reported)
        decoded = topic.decode(topic.encode(record))
        assert as_read_back(decoded) == as_read_back(record)


def as_read_back(record: Record) -> str:
    """Return a record as text as it is read back: NaN for a value that JSON cannot represent."""
    return re.sub(r"-?\binf\b", "nan", repr(msgspec.to_builtins(record)))


def test_null_is_nan_for_numbers_and_none_for_optionals() -> None:
    message = json.loads(CYCLE.encode(cycle(0, 100.0)))
    message["explanation"] = {"stiffness": None}
    message["stiffness"] = message["force"] = None
    message["sample"]["position"] = [None, 1, 2]
    decoded = CYCLE.decode(json.dumps(message).encode())
    assert isinstance(decoded, CycleRecord)
    assert math.isnan(decoded.explanation["stiffness"])
    assert math.isnan(decoded.force)
    assert math.isnan(decoded.sample.position[0])
    assert decoded.stiffness is None
    message["phase"] = None
    with pytest.raises(ValueError, match=r"\$\.phase"):
        CYCLE.decode(json.dumps(message).encode())


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_schema_covers_any_robot_and_all_phases(topic: Topic) -> None:
    """Every recording contains it, whichever robot moved."""
    reported = json.dumps(topic.schema).lower()
    for word in ("status order", "status answer", "move order", "its bid", "enq", "s3"):
        assert word not in reported, word
    if topic is CYCLE:
        described = json.loads(json.dumps(topic.schema))["properties"]["phase"]["description"]
        assert all(str(phase) in described for phase in Phase)

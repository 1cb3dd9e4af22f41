"""The messages of a recording: each fact once, each valid by its schema, for strict readers too."""

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


def test_cycle_is_read_back_with_its_whole_sample(recorded: Path) -> None:
    for record in read(recorded).cycles:
        message = json.loads(CYCLE.encode(record))
        assert not message.keys() & message["sample"].keys() - {"force", "held"}, "no fact stands twice"
        assert repr(CYCLE.decode(CYCLE.encode(record))) == repr(record)


def test_the_schema_says_what_the_fields_say_of_themselves() -> None:
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
    assert sensor["counts"]["items"] == {"type": "number"}  # a device may tell N
    for topic in TOPICS:
        properties: Any = topic.schema["properties"]
        assert all(column["description"] for column in properties.values()), topic.name


# --- strict readers


def checked_messages(path: Path) -> tuple[dict[str, int], list[str]]:
    """How many messages of each topic are valid by their own schema, and what is wrong with the others."""
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
            told = json.loads(message.data, parse_constant=pytest.fail)
            flaws = [f"{channel.topic} {flaw.json_path}" for flaw in validators[schema.id].iter_errors(told)]
            valid[channel.topic] += not flaws
            wrong += flaws
    return dict(valid), wrong


def as_foxglove_takes_it(schema: Any) -> bool:
    """Whether its reader finds a type of one word everywhere. Source: parseJsonSchema.ts of foxglove/studio."""
    words = ("boolean", "string", "number", "integer", "object", "array")
    match schema["type"]:
        case "object":
            return all(map(as_foxglove_takes_it, schema["properties"].values()))
        case "array":
            return schema["items"]["type"] != "array" and as_foxglove_takes_it(schema["items"])
        case word:
            return isinstance(word, str) and word in words


@pytest.fixture(scope="module", params=["jr3", "jr3-uart", "jr3-board"])
def recorded(request: pytest.FixtureRequest, recordings: Recordings) -> Path:
    """A recording of a run with each of our sensors."""
    line = {"kind": "line", "length_mm": 20.0}
    steps = [{"do": "approach"}, {"do": "track", "path": line, "for_s": 4.0}, {"do": "retract"}]
    return recordings.path(merged(CLOSE, {"task": {"step": steps}, "sensor": {"emulated": request.param}}))


@pytest.mark.sweep
def test_every_message_of_a_run_is_valid_by_its_own_schema(recorded: Path) -> None:
    valid, wrong = checked_messages(recorded)
    assert wrong == []
    assert valid.keys() == {topic.name for topic in (*TOPICS, *SCENE_TOPICS)}
    assert valid["/cycle"] > 20
    assert valid["/sensor"] > 500


def test_schemas_are_those_that_foxglove_takes() -> None:
    assert all(as_foxglove_takes_it(topic.schema) for topic in (*TOPICS, *SCENE_TOPICS))
    assert not as_foxglove_takes_it({"type": "object", "properties": {"a": {"type": ["number", "null"]}}})


def test_log_times_fall_by_no_more_than_the_window(recorded: Path) -> None:
    newest, behind = 0, 0
    with recorded.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(log_time_order=False):
            newest = max(newest, message.log_time)
            behind = max(behind, newest - message.log_time)
            assert message.publish_time == message.log_time  # no usual run comes near the window
    assert 0 < behind < ORDER_WINDOW_S * 1e9


def test_a_record_that_was_put_too_late_is_placed_at_the_window(tmp_path: Path) -> None:
    late = EventRecord(100.0, EventKind.PHASE, "track")
    path = write(tmp_path / "run.mcap", [cycle(0, 150.0), late])
    with path.open("rb") as file:
        ((_, _, told),) = make_reader(file).iter_messages(topics="/event", log_time_order=False)
    assert told.log_time == wall_ns(150.0705 - ORDER_WINDOW_S)
    assert told.publish_time == wall_ns(100.0)
    assert [*read(path).events] == [late]


KNOWN = st.none() | st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.lists(st.floats(), min_size=6, max_size=6),
    st.floats(),
    KNOWN,
    st.dictionaries(st.text(), st.floats()),
)
def test_no_number_makes_a_message_that_its_schema_refuses(
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
        told = json.loads(topic.encode(record))
        jsonschema.Draft202012Validator(topic.schema).validate(told)
        back = topic.decode(topic.encode(record))
        assert in_nan(back) == in_nan(record)


def in_nan(record: Record) -> str:
    """A record in words, as it is read back: what JSON lacks is NaN."""
    return re.sub(r"-?\binf\b", "nan", repr(msgspec.to_builtins(record)))


def test_a_null_is_nan_for_a_number_and_none_where_nothing_is_allowed() -> None:
    message = json.loads(CYCLE.encode(cycle(0, 100.0)))
    message["explanation"] = {"stiffness": None}
    message["stiffness"] = message["force"] = None
    message["sample"]["position"] = [None, 1, 2]
    back = CYCLE.decode(json.dumps(message).encode())
    assert isinstance(back, CycleRecord)
    assert math.isnan(back.explanation["stiffness"])
    assert math.isnan(back.force)
    assert math.isnan(back.sample.position[0])
    assert back.stiffness is None
    message["phase"] = None
    with pytest.raises(ValueError, match=r"\$\.phase"):
        CYCLE.decode(json.dumps(message).encode())


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_the_schema_speaks_of_any_robot_and_of_all_phases(topic: Topic) -> None:
    """Every recording carries it, whatever robot moved."""
    told = json.dumps(topic.schema).lower()
    for word in ("status order", "status answer", "move order", "its bid", "enq", "s3"):
        assert word not in told, word
    if topic is CYCLE:
        described = json.loads(json.dumps(topic.schema))["properties"]["phase"]["description"]
        assert all(str(phase) in described for phase in Phase)

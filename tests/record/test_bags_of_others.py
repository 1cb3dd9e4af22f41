"""ROS 2 bags written by other programs, as recordings, reports and comparisons."""

import json
import math
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin, Writer

import hil_bridge
from hil_bridge import BagChoices
from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.record.analysis.contact import contact_figures
from hil_bridge.record.analysis.figures import CONTACT
from hil_bridge.record.export import export
from protocol.geometry import rotate, turn_about
from tests.bags import (
    DOWN,
    POSE,
    STORAGES,
    STORE,
    TRANSFORMS,
    WRENCH,
    ZERO_NS,
    Row,
    pose,
    press,
    pressed,
    transform,
    wrench,
    write,
)
from tests.near_surface import EMERGENCY_STOP, WHOLE
from tests.recordings import Recordings

pytestmark = pytest.mark.sweep

CHOSEN = BagChoices(topics={"wrench": "/contact/wrench", "pose": "/pose_broadcaster/pose"})


def refusal_of(path: Path, **choices: Any) -> str:
    """Return the single line with which a bag is refused."""
    with pytest.raises(ConfigError) as caught:
        hil_bridge.read(path, BagChoices(**choices))
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("alone", [False, True])
def test_bag_provides_force_depth_and_figures(tmp_path: Path, storage: StoragePlugin, alone: bool) -> None:
    bag = pressed(tmp_path / "press", storage)
    if alone:
        (bag,) = (file for file in bag.iterdir() if file.suffix in (".mcap", ".db3"))
    recording = hil_bridge.read(bag)
    arrays, times = recording.arrays, np.arange(200) / 100.0
    np.testing.assert_allclose(arrays.time, times, atol=1e-9)
    np.testing.assert_allclose(arrays.force, np.maximum(0.0, 10.0 * times - 10.0), atol=1e-12)
    np.testing.assert_allclose(arrays.depth, 0.01 * times, atol=1e-9)
    np.testing.assert_allclose(arrays.position[:, :2], np.tile((0.5, 0.1), (200, 1)))
    assert recording.unix_zero_ns == ZERO_NS
    assert np.isnan(arrays.depth_commanded).all()
    assert np.isnan(arrays.force_reference).all()
    assert {*arrays.phase, *arrays.verdict} == {""}
    force = arrays.force[arrays.force > 1.0]
    figures = recording.figures
    assert figures.outcome == "not told"
    assert figures.figures == {}
    assert dict(figures.contact) == pytest.approx(
        {
            "contact_force_mean_n": force.mean(),
            "contact_force_rms_n": math.sqrt((force**2).mean()),
            "contact_force_deviation_n": force.std(),
            "contact_force_peak_n": 9.9,
            "contact_lateral_peak_n": 0.3,
            "contact_moment_peak_nm": 0.099,
            "contact_s": 0.88,
            "contacts": 1.0,
        }
    )


@pytest.mark.parametrize("faults", [(), (EMERGENCY_STOP,)])
def test_exported_bag_has_figures_of_its_recording(
    recordings: Recordings, tmp_path: Path, faults: Sequence[Mapping[str, Any]]
) -> None:
    shutil.copy(recordings.path(WHOLE, faults=faults), tmp_path / "run.mcap")
    export(tmp_path / "run.mcap", ("rosbag2",), tmp_path)
    recording = hil_bridge.read(tmp_path / "run.mcap")
    bag = hil_bridge.read(tmp_path / "run.rosbag2", CHOSEN)
    figures = recording.figures.contact
    assert set(figures) == {one.key for one in CONTACT}
    assert dict(bag.figures.contact) == pytest.approx(dict(figures), rel=1e-9)
    assert (figures["contact_force_peak_n"] or 0.0) > 8.0
    assert bag.arrays.force.tolist() == pytest.approx(recording.arrays.force.tolist(), abs=1e-9)
    target = BagChoices(topics={**CHOSEN.topics, "target": "/target_pose"})
    commanded = hil_bridge.read(tmp_path / "run.rosbag2", target).arrays.depth_commanded
    assert np.nanmax(commanded) == pytest.approx(recording.arrays.depth_commanded.max(), abs=2e-4)


def test_bag_with_several_topics_lists_them(tmp_path: Path) -> None:
    raw = [wrench(at, (0.0, 0.0, -50.0, 0.0, 0.0, 0.0)) for at, _ in press()[0]]
    bag = pressed(tmp_path / "two", more={"/ft/raw": (WRENCH, raw)})
    message = refusal_of(bag)
    assert (
        "several geometry_msgs/WrenchStamped: /ft/raw, /ft/wrench; name one with --topic wrench=/ft/raw"
        in message
    )
    assert hil_bridge.read(bag, BagChoices(topics={"wrench": "/ft/raw"})).arrays.force[0] == 50.0
    either = BagChoices(topics={"wrench": ("/not/here", "/ft/wrench")})
    assert hil_bridge.read(bag, either).arrays.force[-1] == pytest.approx(9.9)
    assert "no topic /gone; topics of type geometry_msgs/WrenchStamped: /ft/raw, /ft/wrench" in refusal_of(
        bag, topics={"wrench": "/gone"}
    )
    assert "/tcp is geometry_msgs/msg/PoseStamped; expected geometry_msgs/WrenchStamped" in refusal_of(
        bag, topics={"wrench": "/tcp"}
    )


def test_bag_tf_frame_is_a_pose(tmp_path: Path) -> None:
    wrenches, poses = press()
    topics = {
        "/ft": (WRENCH, [wrench(*row) for row in wrenches]),
        "/tf": (TRANSFORMS, [transform(*row) for row in poses]),
    }
    bag = write(tmp_path / "tf", topics)
    assert "no topic of type geometry_msgs/PoseStamped; --topic pose=/tf:CHILD takes one" in refusal_of(bag)
    assert "/tf has many frames; name one with --topic pose=/tf:CHILD" in refusal_of(
        bag, topics={"pose": "/tf"}
    )
    assert "/tf has no frame 'hand'" in refusal_of(bag, topics={"pose": "/tf:hand"})
    recording = hil_bridge.read(bag, BagChoices(topics={"pose": "/tf:tcp"}))
    assert recording.arrays.depth[-1] == pytest.approx(0.0199, abs=1e-9)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("topic", ["/tf", "/tf_static"])
def test_bag_transform_with_moving_parent_is_refused(
    tmp_path: Path, storage: StoragePlugin, topic: str
) -> None:
    """The position of a child in a moving parent is not its position in the base."""
    wrenches, poses = press()
    moving = [transform(*row) for row in poses]
    fixed = [transform(*row) for row in poses[:1] * len(poses)]
    for one in fixed:
        del one.transforms[0]
        (single,) = one.transforms
        single.header.frame_id, single.child_frame_id = "tcp", "tip"
    topics = {"/ft": (WRENCH, [wrench(*row) for row in wrenches]), "/tf": (TRANSFORMS, moving)}
    topics[topic] = (TRANSFORMS, moving + fixed if topic == "/tf" else fixed)
    bag = write(tmp_path / "chain", topics, storage)
    message = refusal_of(bag, topics={"pose": f"{topic}:tip"})
    assert "frame 'tip' is given in 'tcp', which moves with 'tcp' in 'base_link'" in message
    assert hil_bridge.read(bag, BagChoices(topics={"pose": "/tf:tcp"})).arrays.depth[-1] > 0.019


def test_bag_frame_axis_sign_and_zero_are_configurable(tmp_path: Path) -> None:
    """One press in four descriptions: in tool or base frame, on the tool or by it, with or without an offset."""
    wrenches, poses = press()
    leaning = turn_about((1.0, 0.0, 0.0), math.pi - 0.4)
    tilted = [(at, (*place[:3], *leaning)) for at, place in poses]
    based = [(at, (*rotate(leaning, parts[:3]), *rotate(leaning, parts[3:]))) for at, parts in wrenches]
    shifted = [(at, tuple(2.0 - part for part in parts)) for at, parts in wrenches]
    variants: dict[str, list[Row]] = {"tool": wrenches, "base": list(based), "shifted": list(shifted)}
    bags = {
        name: write(
            tmp_path / name,
            {
                "/ft": (WRENCH, [wrench(*row) for row in rows]),
                "/tcp": (POSE, [pose(*row) for row in tilted]),
            },
        )
        for name, rows in variants.items()
    }
    plain = hil_bridge.read(bags["tool"]).arrays
    in_base = hil_bridge.read(bags["base"], BagChoices(wrench_in="base")).arrays
    np.testing.assert_allclose(in_base.wrench, plain.wrench, atol=1e-9)
    np.testing.assert_allclose(in_base.force, plain.force, atol=1e-9)
    np.testing.assert_allclose(plain.depth, math.cos(0.4) * (0.4 - plain.position[:, 2]), atol=1e-9)
    down = hil_bridge.read(bags["tool"], BagChoices(axis="base:-z")).arrays
    np.testing.assert_allclose(down.depth, 0.4 - down.position[:, 2], atol=1e-12)
    np.testing.assert_allclose(
        down.force,
        [sum(np.multiply(rotate(leaning, parts[:3]), (0, 0, 1))) for _, parts in wrenches],
        atol=1e-9,
    )
    zeroed = hil_bridge.read(bags["shifted"], BagChoices(sign=-1, zero_s=0.5)).arrays
    np.testing.assert_allclose(zeroed.force, plain.force, atol=1e-9)
    lateral = hil_bridge.read(bags["tool"], BagChoices(axis="tool:-x")).arrays
    np.testing.assert_allclose(lateral.force, 0.3)


def test_bag_invalid_choices_are_refused_in_one_line() -> None:
    choices: Sequence[Mapping[str, Any]] = (
        {"axis": "z"},
        {"axis": "flange:z"},
        {"axis": "tool:w"},
        {"wrench_in": "world"},
        {"sign": 2},
        {"zero_s": -1.0},
        {"contact_n": math.nan},
        {"stamps": "clock"},
        {"topics": {"force": "/ft"}},
    )
    for choice in choices:
        with pytest.raises(ConfigError, match=rf"^{next(iter(choice))} [^\n]+$"):
            BagChoices(**choice)


def test_bag_wrenches_without_nearby_pose_are_omitted(tmp_path: Path) -> None:
    wrenches, poses = press()
    topics = {
        "/ft": (WRENCH, [wrench(*row) for row in wrenches]),
        "/tcp": (POSE, [pose(*row) for row in poses if not 0.2 < row[0] < 1.0]),
    }
    recording = hil_bridge.read(write(tmp_path / "gap", topics))
    assert recording.foreign is not None
    assert recording.foreign.left_out == 79
    assert len(recording.cycles) == 121
    topics["/tcp"] = (POSE, [pose(at + 60.0, parts) for at, parts in poses])
    assert "no wrench has a pose within 0.5 s" in refusal_of(write(tmp_path / "never", topics))


def test_bag_decreasing_times_are_refused_in_one_line(tmp_path: Path) -> None:
    wrenches, poses = press()
    shaken = list(wrenches)
    shaken[50] = (wrenches[45][0], wrenches[50][1])
    topics = {
        "/ft": (WRENCH, [wrench(*row) for row in shaken]),
        "/tcp": (POSE, [pose(*row) for row in poses]),
    }
    bag = write(tmp_path / "back", topics)
    assert "/ft: the time goes back by 0.04 s at message 51; --stamps log" in refusal_of(bag)
    assert hil_bridge.read(bag, BagChoices(stamps="log")).arrays.time[51] == pytest.approx(0.51)
    topics["/ft"] = (WRENCH, [wrench(math.nan, parts) for _, parts in wrenches])
    assert "/ft has no time stamps in its headers; --stamps log" in refusal_of(
        write(tmp_path / "none", topics)
    )


def test_bag_nan_is_refused_in_one_line(tmp_path: Path) -> None:
    wrenches, poses = press()

    def bag(name: str, index: int, **parts: Sequence[float]) -> Path:
        rows = {"wrench": list(wrenches), "pose": list(poses)}
        for role, values in parts.items():
            rows[role][index] = (rows[role][index][0], values)
        return write(
            tmp_path / name,
            {
                "/ft": (WRENCH, [wrench(*row) for row in rows["wrench"]]),
                "/tcp": (POSE, [pose(*row) for row in rows["pose"]]),
            },
        )

    nan, inf = math.nan, math.inf
    assert "/ft: force z of message 8 is not a number" in refusal_of(bag("a", 7, wrench=(0, 0, nan, 0, 0, 0)))
    assert "/ft: torque x of message 8 is not a number" in refusal_of(
        bag("b", 7, wrench=(0, 0, 0, nan, 0, 0))
    )
    assert "/tcp: y of message 1 is not a number" in refusal_of(bag("c", 0, pose=(0, inf, 0, *DOWN)))
    assert "/tcp: the orientation of message 3 is all zero" in refusal_of(bag("d", 2, pose=(0,) * 7))
    assert "/ft: force x of message 8 is 2e+06: is it in SI units?" in refusal_of(
        bag("e", 7, wrench=(2e6, 0, 0, 0, 0, 0))
    )


def test_bag_without_moments_lacks_moments(tmp_path: Path) -> None:
    wrenches, poses = press()
    untold = [wrench(at, (*parts[:3], *[math.nan] * 3)) for at, parts in wrenches]
    topics = {"/ft": (WRENCH, untold), "/tcp": (POSE, [pose(*row) for row in poses])}
    recording = hil_bridge.read(write(tmp_path / "bag", topics))
    assert recording.figures.contact["contact_moment_peak_nm"] is None
    page = recording.report(tmp_path / "out").read_text()
    assert "not in /ft" in page
    assert re.search(r"These charts have no values: [^.]*Moments about", page)


def test_damaged_bag_or_non_bag_is_refused_in_one_line(tmp_path: Path) -> None:
    wrenches, poses = press()
    good = pressed(tmp_path / "good") / "good.mcap"
    data = good.read_bytes()
    (tmp_path / "empty").mkdir()
    assert "is not a ROS 2 bag: no file in it ends in .mcap or .db3" in refusal_of(tmp_path / "empty")
    (tmp_path / "empty" / "bag.mcap.zstd").write_bytes(b"")
    assert "is compressed; decompress it with `zstd -d`" in refusal_of(tmp_path / "empty")
    (tmp_path / "empty" / "bag.mcap").write_bytes(b"")
    assert "is not an MCAP file" in refusal_of(tmp_path / "empty")
    (tmp_path / "cut.mcap").write_bytes(data[:60])
    assert "has no topic of type geometry_msgs/WrenchStamped" in refusal_of(tmp_path / "cut.mcap")
    broken = bytearray(STORE.serialize_cdr(wrench(*wrenches[0]), WRENCH))[:40]
    odd = write(tmp_path / "odd", {"/tcp": (POSE, [pose(*row) for row in poses])})
    with Writer(tmp_path / "cdr", version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        for name, kind, row in (
            ("/ft", WRENCH, bytes(broken)),
            ("/tcp", POSE, STORE.serialize_cdr(pose(*poses[0]), POSE)),
        ):
            bag.write(bag.add_connection(name, kind, typestore=STORE), ZERO_NS, row)
    assert "/ft: message 1 is damaged, or of another type" in refusal_of(tmp_path / "cdr")
    assert "no topic of type geometry_msgs/WrenchStamped" in refusal_of(odd)
    base = pressed(tmp_path / "base", StoragePlugin.SQLITE3) / "base.db3"
    base.write_bytes(base.read_bytes()[: base.stat().st_size // 2])
    assert "is damaged, or not a ROS 2 bag: " in refusal_of(base)
    assert "cannot read the recording" in refusal_of(tmp_path / "gone")


@pytest.mark.full
def test_cut_off_bag_is_read_to_its_end(tmp_path: Path) -> None:
    many = [wrench(0.001 * k, (0.0, 0.0, -5.0, 0.0, 0.0, 0.0)) for k in range(20_000)]
    places = [pose(0.001 * k, (0.0, 0.0, 0.1, *DOWN)) for k in range(20_000)]
    with Writer(tmp_path / "cut", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        force, position = (
            bag.add_connection(name, kind, typestore=STORE)
            for name, kind in (("/ft", WRENCH), ("/tcp", POSE))
        )
        for number, pair in enumerate(zip(many, places, strict=True)):
            for connection, message in zip((force, position), pair, strict=True):
                at = ZERO_NS + number * 1_000_000
                bag.write(connection, at, STORE.serialize_cdr(message, connection.msgtype))
    file = tmp_path / "cut" / "cut.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    (tmp_path / "cut" / "metadata.yaml").unlink()  # as left by a crash
    recording = hil_bridge.read(tmp_path / "cut")
    assert recording.truncated
    assert 1000 < len(recording.cycles) < 20_000
    page = recording.report(tmp_path / "out").read_text()
    assert "The bag ends early or is damaged" in page


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, bytes]:
    """Return both kinds of files as bytes."""
    folder = tmp_path_factory.mktemp("bags")
    bags = {storage.name: pressed(folder / storage.name, storage) for storage in STORAGES}
    return {
        file.suffix: file.read_bytes()
        for bag in bags.values()
        for file in bag.iterdir()
        if file.suffix in (".mcap", ".db3")
    }


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_bag_random_damage_gives_one_line(
    files: Mapping[str, bytes], tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    suffix = data.draw(st.sampled_from(sorted(files)))
    damaged = bytearray(files[suffix])
    places = st.integers(0, len(damaged) - 1)
    for offset in data.draw(st.lists(places, min_size=1, max_size=8)):
        damaged[offset] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.mktemp("damaged") / f"bag{suffix}"
    path.write_bytes(bytes(damaged[: data.draw(places) + 1 if data.draw(st.booleans()) else None]))
    try:
        recording = hil_bridge.read(path)
    except ConfigError as error:
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert np.isfinite(recording.arrays.force).all()


def run(*arguments: object) -> Any:
    return CliRunner().invoke(cli, [str(one) for one in arguments])


def test_bag_report_draws_data_and_lists_missing_parts(tmp_path: Path) -> None:
    bag = pressed(tmp_path / "press")
    result = run("report", bag, "-o", tmp_path / "out", "--axis", "base:-z", "--png", "--contact", "2")
    assert result.exit_code == 0, result.output
    page = (tmp_path / "out" / "report.html").read_text()
    described = json.loads(re.search(r'<script type="application/json"[^>]*>(.*?)</script>', page, re.S)[1])  # type: ignore[index]
    assert [chart["id"] for chart in described["charts"]] == ["force", "depth", "lateral", "moments", "place"]
    assert "force above 2 N" in page
    assert "-z of the parent frame of the pose" in page
    assert "decisions and their reasons" in page
    assert "Estimated stiffness of the contact" in page.rpartition("Not in the bag")[2]
    assert "completed" not in page
    assert (tmp_path / "out" / "report.png").read_bytes().startswith(b"\x89PNG")


def test_bag_and_run_are_compared(recordings: Recordings, tmp_path: Path) -> None:
    shutil.copy(recordings.path(WHOLE), tmp_path / "run.mcap")
    bag = pressed(tmp_path / "press")
    result = run("compare", tmp_path / "run.mcap", bag, "--json")
    assert result.exit_code == 0, result.output
    variants = json.loads(result.stdout)
    assert variants["runs"]["press"]["outcome"] == "not told"
    assert variants["runs"]["press"]["contact_force_peak_n"] == pytest.approx(9.9)
    assert variants["runs"]["run"]["contact_force_peak_n"] == pytest.approx(
        contact_figures(hil_bridge.read(tmp_path / "run.mcap"))["contact_force_peak_n"]
    )
    assert variants["settings"] == {}
    result = run("compare", tmp_path / "run.mcap", bag, "-o", tmp_path / "both.html")
    assert result.exit_code == 0, result.output
    page = (tmp_path / "both.html").read_text()
    assert "press: assumptions" in page
    assert "it contains neither an end nor a cause" in page


def test_bag_fidelity_of_emulated_contact(tmp_path: Path) -> None:
    """The bag's contact is linear, 1 N/mm. A surface of that stiffness matches it, one of twice that does not."""
    bag, differences = pressed(tmp_path / "press"), []
    for stiffness in (1000.0, 2000.0):
        cell = tmp_path / "cell.toml"
        cell.write_text(f"[cell.surface]\nstiffness_n_m = {stiffness}\ndamping_ns_m = 0.0\n")
        result = run(
            "identify", "fidelity", bag, "--as", "contact", "--config", cell, "--axis", "base:-z", "--json"
        )
        assert result.exit_code == 0, result.output
        (line,) = json.loads(result.stdout)["lines"]
        assert line["output"] == "press"
        differences.append(line["apart_rms"])
    assert differences[0] < 1e-3
    assert differences[1] > 1.0
    refusal = run("identify", "fidelity", bag, "--as", "contact", "--columns", cell).exception
    assert "is a ROS 2 bag; give --topic instead of --columns" in str(refusal)


def test_bag_options_are_validated(tmp_path: Path) -> None:
    bag = pressed(tmp_path / "press")
    for options, text in (
        (("--topic", "/ft"), "'/ft' must be ROLE=TOPIC"),
        (("--topic", "force=/ft"), "topics has no role 'force'; known: wrench, pose, target"),
        (("--axis", "up"), "axis 'up' must be tool or base"),
        (("--sign", "3"), "--sign"),
    ):
        result = run("report", bag, "-o", tmp_path / "out", *options)
        assert result.exit_code != 0
        assert text in f"{result.output}{result.exception}"
    assert not (tmp_path / "out").exists()


def test_other_commands_list_commands_that_read_bags(tmp_path: Path) -> None:
    bag = pressed(tmp_path / "press")
    readers = "`hil-bridge report`, `view`, `compare` and `identify fidelity` read a bag"
    for command in ("why", "replay", "export"):
        for path, text in (
            (bag / "press.mcap", "is a ROS 2 bag, not a recording of a run"),
            (bag, "is a folder, not a recording of a run"),
        ):
            result = run(command, path)
            assert isinstance(result.exception, ConfigError)
            assert str(result.exception).endswith(f"{path} {text}; {readers}")


def test_folder_without_bag_is_refused_without_rosbags(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    assert "is not a ROS 2 bag: no file in it ends in" in refusal_of(tmp_path)


def test_bag_without_rosbags_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = pressed(tmp_path / "press")
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    assert refusal_of(bag) == f"a ROS 2 bag needs the package rosbags; {install_command('ros')}"


def test_notebook_displays_bag(tmp_path: Path) -> None:
    recording = hil_bridge.read(pressed(tmp_path / "press"))
    assert repr(recording) == "<Recording: the bag press; 200 samples>"
    output = recording._repr_html_()
    assert "<b>press</b>" in output
    assert "mean contact force" in output
    assert "<svg" in output

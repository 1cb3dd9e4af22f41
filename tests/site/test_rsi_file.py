"""Ethernet configuration of a KUKA controller compared with a configuration: the doctor reports each difference."""

import re
from pathlib import Path

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.settings.configuration import load_config
from hil_bridge.site.doctor import differences
from hil_bridge.site.facts import Level

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "rsi.md"
FILE = re.search(r"```xml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]  # type: ignore[index]
"""File recommended by the RSI page."""


def compare(
    folder: Path, text: str | bytes, settings: str = "", url: str = "rsi+udp-bind://192.168.1.10:49152"
) -> list[str]:
    """Return the differences that the doctor reports."""
    config, file = folder / "cell.toml", folder / "RSI.xml"
    config.write_text(f'[robot]\nurl = "{url}"\nemulated = "rsi"\n[robot.rsi]\n{settings}\n')
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    facts = differences(load_config(config, {}), file)
    assert all("\n" not in str(fact) for fact in facts)
    return [str(fact) for fact in facts if fact.level is Level.FAIL]


def test_documented_rsi_file_matches_defaults(tmp_path: Path) -> None:
    assert compare(tmp_path, FILE) == []
    assert compare(tmp_path, FILE, url="rsi+udp-bind://0.0.0.0:49152") == []
    assert compare(tmp_path, FILE, url="") == []
    assert compare(tmp_path, FILE.replace("HOLDON", "holdon").encode("utf-16"))[0].count("HOLDON is 1") == 1


@pytest.mark.parametrize(
    ("old", "new", "settings", "message"),
    [
        ("49152", "49153", "", "PORT is 49153, and robot.url listens on 49152"),
        (
            "192.168.1.10",
            "192.168.1.33",
            "",
            "IP_NUMBER is 192.168.1.33, and robot.url listens on 192.168.1.10",
        ),
        ("ImFree", "KROSHU", "", "SENTYPE is KROSHU, and robot.rsi.sentype is ImFree"),
        ("<SENTYPE>ImFree</SENTYPE>", "", "", "SENTYPE is missing"),
        ("FALSE", "true", "", "ONLYSEND is TRUE"),
        ("DEF_RIst", "DEF_RSoll", "", "DEF_RIst is not in SEND"),
        ("RKorr.B", "RKorr.D", "", "RECEIVE has no RKorr.B, which a run sends"),
        ("", "", 'correction_tag = "Corr"', "RECEIVE has no Corr.X Corr.Y Corr.Z Corr.A Corr.B Corr.C"),
        (
            'INDX="2" HOLDON="0"',
            'INDX="2" HOLDON="1"',
            "",
            "HOLDON is 1 for RKorr.Y, and robot.rsi.mode is relative",
        ),
        ('INDX="2" HOLDON="0"', 'INDX="2"', "", "HOLDON is 1 for RKorr.Y"),
        ("", "", 'mode = "absolute"', "HOLDON is 0 for RKorr.X RKorr.Y RKorr.Z RKorr.A RKorr.B RKorr.C"),
        ('INDX="2"', 'INDX="1"', "", "RKorr.X and RKorr.Y have the same INDX"),
    ],
)
def test_rsi_file_differences_are_named(
    tmp_path: Path, old: str, new: str, settings: str, message: str
) -> None:
    result = compare(tmp_path, FILE.replace(old, new, 1), settings)
    assert len(result) == 1
    assert result[0].startswith("fail  RSI.xml: ")
    assert message in result[0]


def test_rsi_file_for_axes_needs_more_tags(tmp_path: Path) -> None:
    result = compare(tmp_path, FILE, 'correction = "axes"\nmode = "absolute"')
    assert [text.partition("; ")[0].partition(": ")[2] for text in result] == [
        "DEF_AIPos is not in SEND",
        "DEF_ASPos is not in SEND",
        "RECEIVE has no AK.A1 AK.A2 AK.A3 AK.A4 AK.A5 AK.A6, which a run sends",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "invalid XML: no element found"),
        (b"\xff\xfe\x00", "invalid XML"),
        (b"<ROOT/>", "its root must be ROOT with a CONFIG in it"),
        (b"<robot name='a'/>", "its root must be ROOT"),
        (b"<!DOCTYPE a [<!ENTITY b 'c'>]><ROOT>&b;</ROOT>", "it has a document type, 'a'; remove it"),
        (b"<?xml version='1.0' encoding='klingon'?><ROOT/>", "invalid XML"),
        (FILE.replace('HOLDON="0"', 'HOLDON="yes"', 1), "HOLDON of 'RKorr.X' must be 0 or 1, got 'yes'"),
        (FILE.replace("RKorr.Y", "RKorr.X"), "'RKorr.X' is in RECEIVE twice"),
        (FILE.replace('TAG="RKorr.X"', ""), "an ELEMENT has no TAG"),
        (FILE.replace("FALSE", "maybe"), "ONLYSEND must be TRUE or FALSE, got 'MAYBE'"),
        (FILE.replace("ImFree", "Im&#10;Free"), "SENTYPE is not a plain word: 'Im\\nFree'"),
        (FILE.replace("RKorr.Y", "a&#x9b;b"), "TAG is not a plain word: 'a\\x9bb'"),
        (FILE.replace("RKorr.Y", "a" * 500), "TAG is not a plain word: 'aaa"),
        (
            FILE.replace(
                "<SEND><ELEMENTS>", '<SEND><ELEMENTS><ELEMENT TAG="a"/>' + "<ELEMENT TAG='b'/>" * 200
            ),
            "more than",
        ),
        (b"<a>" * 300_000, "invalid XML"),
        (b" " * (1 << 20) + b"<ROOT/>", "longer than 1048576 bytes"),
    ],
)
def test_non_rsi_file_is_refused(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        compare(tmp_path, text)
    assert f"RSI.xml is not a file of this controller: {message}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_robot_without_controller_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"the kind egm has no controller file to compare"):
        compare(tmp_path, FILE, url="egm+udp-bind://0.0.0.0:6510")

"""The Ethernet configuration of a KUKA controller against a configuration: each difference is a line of the doctor."""

import re
from pathlib import Path

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.settings.configuration import load_config
from hil_bridge.site.doctor import differences
from hil_bridge.site.facts import Level

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "rsi.md"
FILE = re.search(r"```xml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]  # type: ignore[index]
"""The one that the page of RSI tells people to use."""


def compare(
    folder: Path, text: str | bytes, settings: str = "", url: str = "rsi+udp-bind://192.168.1.10:49152"
) -> list[str]:
    """The differences that the doctor names."""
    config, file = folder / "cell.toml", folder / "RSI.xml"
    config.write_text(f'[robot]\nurl = "{url}"\nemulated = "rsi"\n[robot.rsi]\n{settings}\n')
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    facts = differences(load_config(config, {}), file)
    assert all("\n" not in str(fact) for fact in facts)
    return [str(fact) for fact in facts if fact.level is Level.FAIL]


def test_rsi_file_of_the_page_fits_the_defaults(tmp_path: Path) -> None:
    assert compare(tmp_path, FILE) == []
    assert compare(tmp_path, FILE, url="rsi+udp-bind://0.0.0.0:49152") == []
    assert compare(tmp_path, FILE, url="") == []
    assert compare(tmp_path, FILE.replace("HOLDON", "holdon").encode("utf-16"))[0].count("HOLDON is 1") == 1


@pytest.mark.parametrize(
    ("old", "new", "settings", "words"),
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
def test_difference_of_an_rsi_file_is_named(
    tmp_path: Path, old: str, new: str, settings: str, words: str
) -> None:
    found = compare(tmp_path, FILE.replace(old, new, 1), settings)
    assert len(found) == 1
    assert found[0].startswith("fail  RSI.xml: ")
    assert words in found[0]


def test_axes_need_more_tags_of_an_rsi_file(tmp_path: Path) -> None:
    found = compare(tmp_path, FILE, 'correction = "axes"\nmode = "absolute"')
    assert [text.partition("; ")[0].partition(": ")[2] for text in found] == [
        "DEF_AIPos is not in SEND",
        "DEF_ASPos is not in SEND",
        "RECEIVE has no AK.A1 AK.A2 AK.A3 AK.A4 AK.A5 AK.A6, which a run sends",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"", "no XML that can be read: no element found"),
        (b"\xff\xfe\x00", "no XML that can be read"),
        (b"<ROOT/>", "its root must be ROOT with a CONFIG in it"),
        (b"<robot name='a'/>", "its root must be ROOT"),
        (b"<!DOCTYPE a [<!ENTITY b 'c'>]><ROOT>&b;</ROOT>", "it has a document type, 'a'; remove it"),
        (b"<?xml version='1.0' encoding='klingon'?><ROOT/>", "no XML that can be read"),
        (FILE.replace('HOLDON="0"', 'HOLDON="yes"', 1), "HOLDON of 'RKorr.X' must be 0 or 1, got 'yes'"),
        (FILE.replace("RKorr.Y", "RKorr.X"), "'RKorr.X' is in RECEIVE twice"),
        (FILE.replace('TAG="RKorr.X"', ""), "an ELEMENT has no TAG"),
        (FILE.replace("FALSE", "maybe"), "ONLYSEND must be TRUE or FALSE, got 'MAYBE'"),
        (FILE.replace("ImFree", "Im&#10;Free"), "SENTYPE is no plain word: 'Im\\nFree'"),
        (FILE.replace("RKorr.Y", "a&#x9b;b"), "TAG is no plain word: 'a\\x9bb'"),
        (FILE.replace("RKorr.Y", "a" * 500), "TAG is no plain word: 'aaa"),
        (
            FILE.replace(
                "<SEND><ELEMENTS>", '<SEND><ELEMENTS><ELEMENT TAG="a"/>' + "<ELEMENT TAG='b'/>" * 200
            ),
            "more than",
        ),
        (b"<a>" * 300_000, "no XML that can be read"),
        (b" " * (1 << 20) + b"<ROOT/>", "longer than 1048576 bytes"),
    ],
)
def test_other_file_than_of_rsi_is_refused(tmp_path: Path, text: str | bytes, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        compare(tmp_path, text)
    assert f"RSI.xml is not a file of this controller: {words}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_robot_without_such_a_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"the kind egm has no controller file to compare"):
        compare(tmp_path, FILE, url="egm+udp-bind://0.0.0.0:6510")

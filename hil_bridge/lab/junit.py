"""JUnit XML, which build servers display as test results."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from xml.etree import ElementTree

_NOT_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
REQUIREMENT, RECORDING = "hil_requirement", "hil_recording"
"""Properties of a test case, which the pytest plug-in also writes: a requirement that the case verifies, and a
recording of the case. Each may occur several times.
"""


class Verdict(StrEnum):
    """Verdict on a test case. The values are JUnit element names."""

    PASSED = "passed"
    FAILED = "failure"
    ERROR = "error"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class JunitCase:
    """JUnit test case."""

    group: str
    """JUnit class name, by which build servers group the cases."""
    name: str
    seconds: float
    verdict: Verdict = Verdict.PASSED
    message: str = ""
    """Reason why the case did not pass, in one line."""
    details: str = ""
    """Complete text of the reason; empty if the message is sufficient."""
    properties: Sequence[tuple[str, str]] = field(default=())
    output: str = ""


def encode_junit(suite: str, cases: Sequence[JunitCase], properties: Iterable[tuple[str, str]] = ()) -> bytes:
    """Encode a suite of cases as a JUnit file. Characters that are not allowed in XML are replaced."""
    counts = {
        "tests": str(len(cases)),
        "failures": str(sum(one.verdict is Verdict.FAILED for one in cases)),
        "errors": str(sum(one.verdict is Verdict.ERROR for one in cases)),
        "skipped": str(sum(one.verdict is Verdict.SKIPPED for one in cases)),
        "time": f"{sum(one.seconds for one in cases):.3f}",
    }
    root = ElementTree.Element("testsuites", counts)
    parent = _element(root, "testsuite", {"name": suite, **counts})
    _properties(parent, properties)
    for one in cases:
        attributes = {"classname": one.group, "name": one.name, "time": f"{one.seconds:.3f}"}
        case = _element(parent, "testcase", attributes)
        _properties(case, one.properties)
        if one.verdict is not Verdict.PASSED:
            element = _element(case, one.verdict, {"message": one.message})
            if one.verdict is not Verdict.SKIPPED:
                element.text = _xml(one.details or one.message)
        if one.output:
            _element(case, "system-out", {}).text = _xml(one.output)
    ElementTree.indent(root)
    text: str = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'.encode()


def attachment(path: str) -> str:
    """Return the output line by which build servers attach a file to a case."""
    return f"[[ATTACHMENT|{path}]]"


def _element(parent: ElementTree.Element, name: str, attributes: Mapping[str, str]) -> ElementTree.Element:
    return ElementTree.SubElement(parent, name, {key: _xml(value) for key, value in attributes.items()})


def _properties(parent: ElementTree.Element, named: Iterable[tuple[str, str]]) -> None:
    if pairs := list(named):
        element = _element(parent, "properties", {})
        for name, value in pairs:
            _element(element, "property", {"name": name, "value": value})


def _xml(text: str) -> str:
    """Replace the characters that are not allowed in XML."""
    return _NOT_XML.sub("\ufffd", text)

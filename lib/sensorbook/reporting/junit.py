"""JUnit XML of a report, as continuous-integration systems read it: a suite a device.

A chapter is a test case: failed is an error, refused is skipped with its reason. A check against a
limit is one, too: failed is a failure, and so is what cannot be decided (type "undecided"), so that
what reads the file stops a line where `--gate` would.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree import ElementTree

from sensorbook.reporting.words import check_words

# What XML 1.0 (2.2) does not allow, even as a reference.
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit_xml(
    devices: Sequence[dict[str, Any]],
    seconds: Mapping[tuple[str, str, str], float],
    unread: Sequence[str] = (),
) -> str:
    """The XML text.

    Parameters
    ----------
    devices : results.json of each device of the run
    seconds : time that each chapter took, by device, sensor and chapter
    unread : problems of paths that gave no device at all
    """
    suites = [_device(found, seconds) for found in devices]
    if unread:
        suites.append(_suite("sensorbook", [_case("input", problem, 0.0, "error", problem)
                                            for problem in unread], ""))  # fmt: skip
    root = ElementTree.Element("testsuites", name="sensorbook")
    for key in ("tests", "failures", "errors", "skipped"):
        root.set(key, str(sum(int(suite.get(key, "0")) for suite in suites)))
    root.set("time", f"{sum(float(suite.get('time', '0')) for suite in suites):.3f}")
    root.extend(suites)
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, "unicode", xml_declaration=True) + "\n"


def needed(found: dict[str, Any]) -> dict[str, Any]:
    """What of a results.json the XML is made of: many devices are held until the end of a run."""
    calibrations = {
        sensor: {"calibration": result["calibration"]}
        for sensor, result in found["sensors"].items()
        if "calibration" in result
    }
    parts = ("device", "created", "problems", "chapters", "checks")
    return {part: found[part] for part in parts} | {"sensors": calibrations}


def _device(found: dict[str, Any], seconds) -> ElementTree.Element:
    name = found["device"]["id"]
    cases = [
        _case(f"{name}.device", problem, 0.0, "error", problem) for problem in found["problems"]
    ]
    for chapter in found["chapters"]:
        sensor, slug, status = chapter["sensor"], chapter["chapter"], chapter["status"]
        kind = {"failed": "error", "refused": "skipped"}.get(status, "")
        took = seconds.get((name, sensor, slug), 0.0)
        cases.append(_case(f"{name}.{sensor}", slug, took, kind, chapter["reason"] or "", status))
    for check in found["checks"]:
        label = " ".join(part for key in ("quantity", "axis", "bound") if (part := check[key]))
        verdict = check["verdict"]
        kind = "" if verdict == "pass" else "failure"
        words = check_words(check, found)
        cases.append(_case(f"{name}.{check['sensor']}.limits", label, 0.0, kind, words, verdict))
    return _suite(name, cases, found["created"])


def _suite(name: str, cases: Sequence[ElementTree.Element], moment: str) -> ElementTree.Element:
    suite = ElementTree.Element("testsuite", name=_clean(name), tests=str(len(cases)))
    for key, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(key, str(sum(case.find(tag) is not None for case in cases)))
    suite.set("time", f"{sum(float(case.get('time', '0')) for case in cases):.3f}")
    if moment:
        suite.set("timestamp", moment[:19])
    suite.extend(cases)
    return suite


def _case(
    where: str, name: str, seconds: float, kind: str, message: str, about: str = "failed"
) -> ElementTree.Element:
    case = ElementTree.Element(
        "testcase", classname=_clean(where), name=_clean(name), time=f"{seconds:.3f}"
    )
    if kind:
        part = ElementTree.SubElement(case, kind, message=_clean(message))
        if kind != "skipped":
            part.set("type", about)
            part.text = _clean(message)
    return case


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\ufffd", text)

"""Files that CI services read: JUnit XML, and a Markdown page that jobs add to."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from whid.result import Check


def junit_xml(path: Path, name: str, checks: Sequence[Check], code: int) -> None:
    """Write one test case a bound, and one that the study was finished; raises OSError."""
    suite = ElementTree.Element("testsuite", name=f"whid.{name}")
    complete = ElementTree.SubElement(suite, "testcase", classname=f"whid.{name}", name="finished")
    if code == 3:
        ElementTree.SubElement(complete, "failure", message="failed or incomplete")
    for check in checks:
        words = " and ".join(
            f"{side} {limit:g}" for side, limit in (("above", check.above), ("below", check.below)) if limit is not None
        )
        case = ElementTree.SubElement(
            suite, "testcase", classname=f"whid.{name}", name=f"{check.metric}{f' ({check.of})' if check.of else ''} {words}"
        )
        if check.verdict == "breached":
            ElementTree.SubElement(case, "failure", message=f"{check.metric} is {check.value:.6g}, must be {words}")
        elif check.verdict == "not measured":
            ElementTree.SubElement(case, "error", message=f"{check.metric} was not measured")
    suite.set("tests", str(len(suite)))
    for kind in ("failure", "error"):
        suite.set(f"{kind}s", str(len(suite.findall(f"testcase/{kind}"))))
    ElementTree.indent(suite)
    path.parent.mkdir(parents=True, exist_ok=True)
    ElementTree.ElementTree(suite).write(path, encoding="utf-8", xml_declaration=True)


def append(path: Path, text: str) -> None:
    """Add to a page; raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(text)

"""Expanding xacro files by the library `xacro`, in a process of its own with limits (`xacro_child`)."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names
from sqrp_cli.knowledge.robot.robot_source import ROOT, RobotSource, RobotXml, as_text
from sqrp_cli.knowledge.text.xml_file import MAX_DEPTH, Element

MAX_SECONDS = 20
"""Most computing time of an expansion [s]."""

MAX_MEMORY = 1_500_000_000
"""Most memory of an expansion [bytes]."""

MAX_WAIT = 90.0
"""Longest wait for an expansion, on however busy a machine [s]."""


def expand(path: Path, source: RobotSource) -> RobotXml:
    """The `<robot>` that a xacro file stands for.

    Every element has the place where it is written, in this file or an included one. Raises InputError, with that
    place, for whatever prevents it: a wrong expression, an unknown macro or argument, a file that is missing or outside
    the known folders, too much work or memory. Also if the library is not installed.
    """
    if find_spec("xacro") is None:
        message = "this is a xacro file, which needs the extra `xacro`"
        raise bad_input("missing-extra", message, Place(path), mend="pip install 'sqrp[xacro]'")
    asked = {"path": str(path), "arguments": dict(source.arguments),
             "roots": list(map(str, source.roots)), "search": list(map(str, source.search)),
             "seconds": MAX_SECONDS, "memory": MAX_MEMORY}  # fmt: skip
    code = f"import sys; sys.path[:] = {[entry for entry in sys.path if entry]!r}; "
    code += "from sqrp_cli.knowledge.robot.xacro_child import main; main()"
    command = [sys.executable, "-I", "-B", "-c", code]
    try:
        done = subprocess.run(  # noqa: S603 - no shell, and of this program alone
            command, input=json.dumps(asked).encode(), capture_output=True, env={}, timeout=MAX_WAIT, check=False
        )
        found = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError) as error:
        message = "expanding this file takes too much time or memory: a macro or an expression may lead back to itself"
        raise bad_input("xacro", message, Place(path)) from error
    known: dict[str, str | None] = found.get("asked", {})
    if "problem" in found:
        problem = _problem(found["problem"])
        if problem.mend is None and known:  # a missing file often follows from an argument
            given = [f"{name} ({source.arguments.get(name, default)})" if default is not None else name
                     for name, default in [*known.items()][:12]]  # fmt: skip
            problem = replace(problem, mend=f"the file's arguments, with their values: {', '.join(given)}")
        raise InputError(problem)
    for name in source.arguments:
        if name not in known:
            raise bad_input(
                "xacro-argument", f"the file takes no argument `{name}`; {expected_names(name, known)}", Place(path)
            )
    root = _element(found["root"], 0)
    if root.tag != ROOT:
        raise root.error("wrong-root", f"the file begins with <{root.shown_tag}>, expected <{ROOT}>")
    text = as_text(root)
    return RobotXml(root, text, text.encode(), (*found["packages"],), (*map(_problem, found["warnings"]),))


def _problem(told: dict[str, Any]) -> Problem:
    place = told["place"]
    return Problem(**{**told, "place": place and Place(**{**place, "file": Path(place["file"])})})


def _element(told: list[Any], depth: int) -> Element:
    tag, attributes, file, line, column, children = told
    place = Place(Path(file), line, column)
    if depth > MAX_DEPTH:
        raise bad_input("nesting-too-deep", f"elements are nested deeper than {MAX_DEPTH} levels", place)
    return Element(tag, attributes, place, [_element(child, depth + 1) for child in children])

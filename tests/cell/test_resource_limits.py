"""Files that would take for ever or fill the memory are refused at once, and the message says what the limit is."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.robot.read_urdf import read_urdf
from tests.cells import refusal, refused
from tests.damage.bombs import TABLE, text_of


@pytest.fixture(autouse=True)
def at_once() -> Iterator[None]:
    """Refusing takes a moment; unfolded, these would take hours, so that the bound need not be tight."""
    before = time.process_time()
    yield
    assert time.process_time() - before < 60.0


def prepend(path: Path, text: str) -> None:
    path.write_text(text + path.read_text(encoding="utf-8"), encoding="utf-8")


BOMBS = {
    **{name: text_of(TABLE["yaml"][name][1]) for name in ("aliases", "merges", "itself", "dashes", "values", "bytes")},
    "brackets": "x: " + "[" * 100_000 + "\n",
    "braces": "x: " + "{a: " * 100_000 + "\n",
    "indents": "".join(" " * i + "a:\n" for i in range(1200)),
    "digits": "x: " + "9" * 500_000 + "\n",
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_yaml_file_cannot_unfold_without_end(bomb, cell):
    prepend(cell / "workspace.yaml", BOMBS[bomb])
    problem = refusal(cell)
    assert problem.code in {"too-many-values", "nesting-too-deep", "not-finite", "file-too-large"}
    assert problem.place.file == cell / "workspace.yaml"
    assert len(problem.message) < 300


def binary_stl(path: Path, stated: int, present: int) -> Path:
    with path.open("wb") as file:
        file.write(bytes(80) + struct.pack("<I", stated))
        file.truncate(84 + 50 * present)
    return path


def test_a_mesh_of_millions_of_triangles_is_refused_from_its_header(tmp_path):
    for count, code in ((10_000_000, "file-too-large"), (3_900_000, "mesh-too-large")):
        problem = refused(read_mesh, binary_stl(tmp_path / "big.stl", count, count))
        assert (problem.code, problem.mend) == (code, "simplify the mesh")


def in_a_row(count: int, joint: str) -> str:
    """Links one after the other from the wrist on; joint: what each joint has."""
    return "".join(
        f'<link name="l{i}"/><joint name="k{i}" {joint}<parent link="{f"l{i - 1}" if i else "wrist"}"/>'
        f'<child link="l{i}"/></joint>'
        for i in range(count)
    )


CAMERA = "{pose: {position: [1, 0, 1], look_at: [0, 0, 0]}, image: {width: 64, height: 48, fx: 50}, rate: 10 Hz}"
GROUPS = "".join(f'<group name="g{i}"><group name="g{i + 1}"/></group>' for i in range(3000)) + '<group name="g3000"/>'
RAIL = (
    '<joint name="rail" type="prismatic"><limit lower="-1e6" upper="1e6"/><parent link="wrist"/><child link="car"/>'
    '</joint><link name="car"/></robot>'
)
BOX = '<collision>\n<geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
PDDL = "pickup/pickup.pddl"
SKILL = "pickup/skill.yaml"


def quantified(count: int) -> dict[str, str]:
    variables = " ".join(f"?v{i} - object" for i in range(count))
    requires = ":negative-preconditions :universal-preconditions"
    return {":negative-preconditions": requires, "(and (on": f"(and (forall ({variables}) (hand_empty)) (on"}


@pytest.mark.parametrize(("file", "edits", "code", "says"), [
        ("arm.urdf", {"</robot>": in_a_row(3000, 'type="revolute"><limit lower="-1" upper="1"/>') + "</robot>"},
         "too-many-links", "at most 2,000 links and 200 joints"),
        ("arm.urdf", {'<axis xyz="0 0 1"/>': '<axis xyz="0 0 1"/><mimic joint="elbow"/>',
                      '<axis xyz="0 1 0"/>': '<axis xyz="0 1 0"/><mimic joint="shoulder"/>'}, "wrong-mimic", ""),
        ("arm.urdf", {"</robot>": RAIL}, "wrong-value", "<limit>: `lower` is `-1e6`, expected at most 100 in size"),
        ("arm.srdf", {"<group ": GROUPS + "<group "}, "nesting-too-deep", ""),
        ("workspace.yaml", {"cameras:\n": "cameras:\n" + "".join(f"  extra{i}: {CAMERA}\n" for i in range(1000))},
         "wrong-value", "found 1,003 entries, expected at most 200"),
        (SKILL, {"waypoints:\n": "waypoints:\n" + "".join(f"  w{k}: {{from: home, raise: 1}}\n" for k in range(3000))},
         "wrong-value", "expected at most 200"),
        (SKILL, {"faults:\n": "faults:\n" + "".join(f"  f{k}: {{formula: hold}}\n" for k in range(3000))},
         "wrong-value", "expected at most 200"),
        (PDDL, quantified(12), "pddl-too-large", "the limit is 50,000"),
        (PDDL, quantified(100), "pddl-too-large", "the limit is 50,000"),
        (PDDL, {"(and ": "(" * 20_000 + "and "}, "pddl-", ""),
        (PDDL, {"(not (hold ?object))": "(not " * 3000 + "(hold ?object)" + ")" * 3000}, "pddl-", ""),
        (PDDL, {"(hand_empty))": "(hand_empty) " * 20_000 + ")"}, "pddl-", ""),
        (PDDL, {"(:types": "(:types a - b b - a "}, "pddl-", ""),
    ],
    ids=["joints", "mimics", "rail", "groups", "cameras", "waypoints", "faults", "12 variables", "100 variables",
         "brackets", "negations", "conditions", "types"],
)  # fmt: skip
def test_what_has_no_end_is_refused_in_a_short_message(file, edits, code, says, cell):
    path = cell / file
    text = path.read_text(encoding="utf-8")
    for old, new in edits.items():
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")
    problem = refusal(cell)
    assert problem.code.startswith(code)
    assert says in problem.message
    assert problem.place.file == path
    assert code != "pddl-too-large" or problem.place.line == 5
    assert problem.excerpt is None or len(problem.excerpt) < 300


def with_links(cell: Path, text: str) -> None:
    path = cell / "arm.urdf"
    path.write_text(path.read_text(encoding="utf-8").replace("</robot>", text + "</robot>"), encoding="utf-8")


def test_two_thousand_links_in_a_row_are_read_in_a_moment(cell):
    """Looking for a circle from each link took time with the cube of their number."""
    with_links(cell, in_a_row(1950, 'type="fixed">'))
    before = time.process_time()
    assert len(read_urdf(cell / "arm.urdf").links) > 1950
    assert time.process_time() - before < 5.0


def test_a_robot_of_thousands_of_shapes_is_refused_at_the_first_too_many(cell):
    before = (cell / "arm.urdf").read_text(encoding="utf-8").count("\n")
    with_links(cell, f'<link name="many">{BOX * 20_000}</link>')
    problem = refusal(cell)
    assert problem.code == "too-many-shapes"
    assert "expected at most 500" in problem.message
    assert problem.place.file == cell / "arm.urdf"
    assert before + 450 < problem.place.line <= before + 501

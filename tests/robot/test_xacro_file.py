"""Xacro files become the URDF that they stand for, and neither they nor their expressions can do anything else."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import xacro
from hypothesis import given, settings
from hypothesis import strategies as st

from sqrp_cli.errors import InputError
from sqrp_cli.robot import robot_xml
from sqrp_cli.robot.moveit import read_srdf
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.robot.robot_xml import RobotSource, read_robot_xml
from sqrp_cli.robot.urdf import UrdfModel
from sqrp_cli.robot.xacro_expression import UNOFFERED, evaluate
from tests.cells import FILES, read_cases, refused

XMLNS = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'

PACKAGE = "My_ROS2_Description"
TOP = (FILES / PACKAGE / "urdf" / "my_arm.urdf.xacro").read_text()


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package whose folder has another name than the package, as those of Universal Robots."""
    return Path(shutil.copytree(FILES / PACKAGE, tmp_path / PACKAGE))


def top(package: Path) -> Path:
    return package / "urdf" / "my_arm.urdf.xacro"


def read(package: Path, **arguments: str) -> UrdfModel:
    return read_urdf(top(package), RobotSource(arguments=arguments))


def test_a_package_of_includes_macros_and_yaml_becomes_its_urdf(package):
    model = read(package)
    assert model.name == "my_arm"
    assert list(model.joints) == ["left_base", "left_joint_1", "left_joint_2"]
    assert model.joints["left_base"].X_PJ[2, 3] == pytest.approx(0.3)
    assert model.joints["left_joint_1"].X_PJ[0, 3] == 0.25
    assert model.joints["left_joint_2"].X_PJ[0, 3] == 1.0
    assert model.joints["left_joint_2"].velocity == pytest.approx(1.5707963)
    assert model.packages == ("my_arm",)


def test_arguments_choose_the_robot(package):
    model = read(package, arm_type="long", tool="true", name="other")
    assert (model.name, "tool" in model.links, model.joints["left_joint_1"].X_PJ[0, 3]) == ("other", True, 1.0)


def test_what_is_wrong_in_it_is_placed_where_it_is_written(package):
    macro = package / "urdf/inc/arm_macro.xacro"
    macro.write_text(macro.read_text().replace('type="revolute"', 'type="revolving"'))
    problem = refused(read, package)
    assert (problem.code, problem.place.file.name, problem.place.line) == ("unknown-joint-type", "arm_macro.xacro", 10)


def test_the_library_itself_expands_to_the_same(package):
    """The original, unguarded, with the package found by the code below."""
    code = (
        "import sys, xacro; from xacro import substitution_args as s;"
        "s._eval_find = lambda name: sys.argv[2];"
        "d = xacro.process_file(sys.argv[1], mappings={'name': 'my_arm', 'tool': 'true'}); print(d.toxml())"
    )
    done = subprocess.run([sys.executable, "-c", code, top(package), package], capture_output=True, check=True)
    plain = package / "plain.urdf"
    plain.write_bytes(done.stdout)
    expected = read_urdf(plain)
    found = read(package, tool="true")
    assert list(found.links) == list(expected.links)
    for name, joint in expected.joints.items():
        assert (found.joints[name].X_PJ == joint.X_PJ).all()
        assert found.joints[name].upper == joint.upper


def test_its_content_is_what_it_stands_for(package):
    before = read(package).content
    macro = package / "urdf" / "inc" / "arm_macro.xacro"
    macro.write_text(macro.read_text().replace("<link", "<!-- a comment --><link", 1))
    assert read(package).content == before
    (package / "config" / "short" / "lengths.yaml").write_text("lengths: [0.3, 0.5]\n")
    assert read(package).content != before


def test_an_argument_that_it_does_not_take_is_named_and_one_for_which_files_are_missing_is_shown(package):
    with pytest.raises(InputError, match="takes no argument `arm_typ`; did you mean `arm_type`"):
        read(package, arm_typ="long")
    problem = refused(read, package, arm_type="medium")
    assert problem.code == "missing-file"
    assert "arm_type (medium)" in (problem.mend or "")


def test_environment_variables_are_never_read(package, monkeypatch):
    monkeypatch.setenv("ARM_NAME", "secret")
    top(package).write_text(TOP.replace("$(arg name)", "$(optenv ARM_NAME usual)"))
    assert read(package).name == "usual"
    assert read(package, ARM_NAME="given").name == "given"


MACROS = "".join(
    f'<xacro:macro name="m{n}">{f"<xacro:m{n - 1}/>" * 10 if n else "<link/>"}</xacro:macro>' for n in range(9)
)
DOUBLED = "".join(f'<xacro:property name="p{n}" value="${{p{n - 1}}}${{p{n - 1}}}"/>' for n in range(1, 60))
PROPERTY = '<xacro:property name="{}" value="{}"/>'


@pytest.mark.parametrize("body", [
        '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>', f"{MACROS}<xacro:m8/>",
        f'{PROPERTY.format("a", "${b}")}{PROPERTY.format("b", "${a}")}<link name="${{a}}"/>',
        f'{PROPERTY.format("p0", "a" * 10)}{DOUBLED}<link name="${{p59}}"/>',
    ], ids=["itself", "macros", "circle", "text"])  # fmt: skip
def test_no_file_expands_without_end(tmp_path, body):
    (tmp_path / "bomb.xacro").write_text(f'<robot name="r" {XMLNS}>{body}</robot>')
    assert refused(read_robot_xml, tmp_path / "bomb.xacro").code in ("xacro", "too-many-elements")


def test_a_urdf_is_plain_unless_there_is_xacro_in_it(tmp_path):
    arm, start = tmp_path / "arm.urdf", f'<robot name="r" {XMLNS}>'
    joint = '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint></robot>'
    arm.write_text(f'{start}<xacro:macro name="m"><link name="b"/></xacro:macro><link name="a"/><xacro:m/>{joint}')
    assert list(read_urdf(arm).links) == ["a", "b"]
    arm.write_text(f'{start}<link name="a"/></robot>')
    assert read_urdf(arm).expanded is None
    with pytest.raises(InputError, match="takes no arguments; found `size`"):
        read_urdf(arm, RobotSource(arguments={"size": "1"}))
    arm.write_text(f'{start}<include filename="x"/><link name="${{1}}"/></robot>')
    with pytest.raises(InputError, match="is of xacro before 2014"):
        read_urdf(arm)


def test_a_property_without_prefix_is_a_property_too(package):
    text = TOP.replace("0.1 + 0.2", "side").replace("<link", '<property name="side" value="0.4"/><link', 1)
    top(package).write_text(text)
    assert read(package).joints["left_base"].X_PJ[2, 3] == pytest.approx(0.4)


def test_an_srdf_may_be_a_xacro_too(package):
    (package / "arm.srdf.xacro").write_text(
        f"""<robot {XMLNS} name="my_arm"><xacro:arg name="prefix" default=""/>
        <group name="$(arg prefix)arm"><chain base_link="world_link" tip_link="$(arg prefix)link_2"/></group></robot>"""
    )
    srdf = read_srdf(package / "arm.srdf.xacro", read(package), RobotSource(arguments={"prefix": "left_"}))
    assert srdf.groups == {"left_arm": ("left_joint_1", "left_joint_2")}
    assert srdf.tips == {"left_arm": "left_link_2"}


def test_warnings_of_the_file_are_kept(package):
    plain = TOP.replace("$(find my_arm)/urdf", "$(dirname)")  # the folder of the file that says it
    top(package).write_text(plain.replace("<link", "${xacro.warning('old file')}<link", 1))
    (warning,) = read(package).warnings
    assert (warning.code, warning.severity) == ("xacro-warning", "warning")


LONG = ["9**9**9", "[max(range(90000)) for x in range(40000)]"]
LARGE = ["'a' * 10**10", "[0] * 10**10", "'{:>9999999999}'.format(1)", "(" * 300 + "1" + ")" * 300]


@pytest.mark.parametrize("expression", [*LONG, *LARGE])
def test_an_expression_that_takes_long_or_much_memory_ends_by_the_limit(tmp_path, monkeypatch, expression):
    monkeypatch.setattr(robot_xml, "MAX_SECONDS", 1)
    (tmp_path / "bomb.xacro").write_text(f'<robot name="r" {XMLNS}><link name="${{{expression}}}"/></robot>')
    message = refused(read_robot_xml, tmp_path / "bomb.xacro").message
    assert "too much time or memory" in message or expression in LARGE


def test_a_link_inside_a_package_is_not_followed_out_of_it(package, tmp_path):
    secret = tmp_path / "secret.yaml"
    secret.write_text("lengths: [1, 2]\n")
    sizes = package / "config" / "short" / "lengths.yaml"
    sizes.unlink()
    sizes.symlink_to(secret)
    with pytest.raises(InputError, match=f"outside the folders .* it is a link to `{secret}`"):
        read(package)
    model = read_urdf(top(package), RobotSource(roots=(tmp_path,)))
    assert model.joints["left_joint_1"].X_PJ[0, 3] == 1.0


@pytest.mark.parametrize("wrong", [
    "</robot", "${1/0}", "<xacro:none/>", '<xacro:property name="factor" value="${1/0}"/>',
    "<a b=\"${xacro.load_yaml('none.yaml')}\"/>",
])  # fmt: skip
def test_what_is_wrong_in_an_included_file_names_that_file(package, wrong):
    common = package / "urdf" / "inc" / "common.xacro"
    common.write_text(f'<robot {XMLNS}>\n<xacro:if value="true">{wrong}</xacro:if></robot>')
    problem = refused(read, package)
    assert (problem.place.file, problem.place.line) == (common, 2)


HARMS = """
import json, os, socket, subprocess, sys
from sqrp_cli.robot import xacro_child
harms = {
    "read": lambda: open("/etc/passwd"), "write": lambda: open(sys.argv[1] + "/new", "w"),
    "command": lambda: os.system("true"), "process": lambda: subprocess.run(["true"]), "network": socket.socket,
    "removal": lambda: os.remove(sys.argv[1] + "/a.xacro"), "variable": lambda: os.putenv("A", "b"), "fork": os.fork,
}
def run(self):
    done = []
    for name, harm in harms.items():
        try:
            harm()
            done.append(name)
        except PermissionError:
            pass
    raise ValueError(f"done: {done}")
xacro_child._Expansion.run = run
xacro_child.main()
"""


def test_the_process_that_expands_can_do_nothing_else(tmp_path):
    (tmp_path / "a.xacro").write_text(f"<robot {XMLNS}/>")
    asked = {"path": str(tmp_path / "a.xacro"), "arguments": {}, "roots": [], "search": []}
    given, command = json.dumps({**asked, "seconds": 5, "memory": 2**30}), [sys.executable, "-c", HARMS, tmp_path]
    done = subprocess.run(command, input=given, capture_output=True, text=True)
    assert json.loads(done.stdout)["problem"]["message"] == "done: []"


NAMES = {"width": 0.5, "side": "left", "ports": [1, 2, 3], "cfg": {"arm": {"mass": 3.7}, "flag": True}}


def value(expression: str, **names: object) -> object:
    symbols = xacro.create_global_symbols()
    for one in UNOFFERED:
        symbols["python"].pop(one, None)
    return evaluate(expression, {**symbols, **NAMES, **names})


CASES = read_cases("xacro_expressions.yaml")


@pytest.mark.parametrize(("expression", "expected"), CASES["evaluated"])
def test_what_descriptions_use_is_evaluated(expression, expected):
    assert value(expression) == pytest.approx(expected)


@given(st.recursive(
    st.integers(-9, 9).map(str) | st.sampled_from(["0.5", "width", "True"]),
    lambda part: st.tuples(part, st.sampled_from(["+", "-", "*", "<", "==", "and", "or"]), part).map(
        lambda three: f"({' '.join(three)})"
    ),
))  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_arithmetic_is_that_of_python(expression):
    assert value(expression) == eval(expression, {}, dict(NAMES))  # noqa: S307 - made above


@pytest.mark.parametrize("expression", CASES["refused"])
def test_nothing_of_python_itself_can_be_reached(expression):
    with pytest.raises((ValueError, KeyError, AttributeError)):
        value(expression)


def test_a_name_that_is_not_defined_has_a_suggestion():
    with pytest.raises(ValueError, match="`widht` is not defined; did you mean `width`"):
        value("widht + 1")

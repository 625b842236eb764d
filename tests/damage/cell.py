"""A whole cell in a folder, with a file of every kind that a user may get wrong."""

from __future__ import annotations

import shutil
from pathlib import Path

from sqrp_cli.cli.main import run
from sqrp_cli.starter.make import make_starter

CASES = Path(__file__).parents[1] / "cases"

SRDF = """\
<?xml version="1.0"?>
<robot name="six_axis_arm">
  <group name="arm">
    <chain base_link="base" tip_link="flange"/>
  </group>
  <group_state name="upright" group="arm">
    <joint name="joint_1" value="0"/>
    <joint name="joint_2" value="0.1"/>
    <joint name="joint_3" value="0.2"/>
  </group_state>
  <disable_collisions link1="base" link2="shoulder" reason="Adjacent"/>
  <disable_collisions link1="wrist_1" link2="wrist_3" reason="Never"/>
</robot>
"""

HAND_EYE = """\
parameters:
  name: side
  calibration_type: eye_on_base
  robot_base_frame: base
  robot_effector_frame: flange
  tracking_base_frame: camera_optical_frame
transform:
  translation:
    x: 0.4
    y: -0.6
    z: 0.5
  rotation:
    x: -0.92388
    y: 0.0
    z: 0.0
    w: 0.382683
"""

KINDS = (
    "workspace.yaml",
    "skills/pickup/skill.yaml",
    "skills/pickup/pickup.pddl",
    "camera.yaml",
    "opencv.yaml",
    "hand_eye.yaml",
    "robots/six_axis_arm.urdf",
    "robots/suction_cup.urdf",
    "arm.srdf",
    "cube.stl",
    "program.yaml",
)
"""The files that are damaged."""

TASK = "pickup red"


def whole_cell(folder: Path) -> Path:
    """The starter workspace with an SRDF, calibrated cameras, a mesh and a program."""
    made = make_starter(folder, None).folder
    workspace = made / "workspace.yaml"
    text = workspace.read_text(encoding="utf-8")
    cameras, rest = text.split("skills: [", 1)
    first, image = cameras.index("    image:"), "    image: {width: 1280, height: 960, horizontal_fov: 60 deg}\n"
    cameras = cameras[:first] + "    calibration: camera.yaml\n" + cameras[first + len(image) :]
    pose = cameras.index("    pose:", cameras.index("cam2:"))
    cameras = cameras[:pose] + "    hand_eye: hand_eye.yaml\n" + cameras[cameras.index("\n", pose) + 1 :]
    cameras = cameras.replace(image, "    calibration: opencv.yaml\n")
    cameras = cameras.replace("  base:", "  srdf: arm.srdf\n  base:")
    rest = rest.replace(", on: table}\n\nstate", ", on: table, parts: [{mesh: cube.stl, scale: 0.04}]}\n\nstate")
    workspace.write_text(cameras + "skills: [" + rest, encoding="utf-8")
    (made / "arm.srdf").write_text(SRDF, encoding="utf-8")
    (made / "hand_eye.yaml").write_text(HAND_EYE, encoding="utf-8")
    shutil.copyfile(CASES / "cameras" / "camera_calibration.yaml", made / "camera.yaml")
    shutil.copyfile(CASES / "cameras" / "opencv_filestorage.yaml", made / "opencv.yaml")
    shutil.copyfile(CASES / "cell" / "cube.stl", made / "cube.stl")
    if run(["rank", str(made), TASK, "--samples", "2", "--program", str(made / "program.yaml")]) != 0:
        raise AssertionError("the undamaged cell must rank")
    return made

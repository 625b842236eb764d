"""What `init` makes of arms as packages ship them, and of variants that are written here.

Each arm of the matrix gets a new workspace from nothing but its URDF or xacro; its task is ranked, and the best
candidate run once in the simulated cell.
"""

from __future__ import annotations

import os
import re
import site
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqrp_cli import new_cell, open_cell
from tests.task.robots import FEW_AXES, LINKAGES, SIX_AXES, joint, rounded, turning, written_urdf


@dataclass(frozen=True)
class MatrixArm:
    """An arm to try."""

    name: str
    urdf: str
    """A path or `package://...`."""
    tip: str | None = None
    """The link that `--tip` names."""


EXAMPLE = "package://example-robot-data/robots"

EXAMPLES = {
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur5-limited": "ur_description/urdf/ur5_joint_limited_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "ur10-limited": "ur_description/urdf/ur10_joint_limited_robot.urdf",
    "ur5-gripper": "ur_description/urdf/ur5_gripper.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "so100": "so_arm_description/urdf/so100.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    "b1-z1": "b1_description/urdf/b1-z1.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
    "pr2": "pr2_description/urdf/pr2.urdf",
}

TWO_ARMS = {
    "baxter-left": ("baxter_description/urdf/baxter.urdf", "left_gripper"),
    "baxter-right": ("baxter_description/urdf/baxter.urdf", "right_gripper"),
    "talos-left": ("talos_data/robots/talos_full_v2.urdf", "gripper_left_base_link"),
    "tiago-dual": ("tiago_description/robots/tiago_dual.urdf", "arm_left_tool_link"),
}
"""With the link that `--tip` names."""

RTB = "rtbdata/xacro"

TOOLBOX = {
    "irb140": "abb_irb140_description/urdf/irb140.urdf",
    "kr3r540": "kuka_description/kuka_kr3/urdf/kr3r540.xacro",
    "kr5-arc": "kuka_description/kuka_kr5/urdf/kr5_arc.xacro",
    "kr6r700": "kuka_description/kuka_kr6/urdf/kr6r700sixx.xacro",
    "kr6r900": "kuka_description/kuka_kr6/urdf/kr6r900sixx.xacro",
    "kr10r1100": "kuka_description/kuka_kr10/urdf/kr10r1100sixx.xacro",
    "kr16-2": "kuka_description/kuka_kr16/urdf/kr16_2.xacro",
    "kr120r2500": "kuka_description/kuka_kr120/urdf/kr120r2500pro.xacro",
    "kr150-2": "kuka_description/kuka_kr150/urdf/kr150_2.xacro",
    "kr210l150": "kuka_description/kuka_kr210/urdf/kr210l150.xacro",
    "iiwa14": "kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.xacro",
    "puma560": "unimation_puma560_description/urdf/puma560_robot.urdf.xacro",
    "al5d": "lynxmotion_al5d_description/urdf/al5d_robot.urdf",
    "panda-arm": "qut_frankie_description/robots/panda_arm.urdf.xacro",
    "panda-hand": "qut_frankie_description/robots/panda_arm_hand.urdf.xacro",
    "frankie": "qut_frankie_description/robots/frankie_arm_hand.urdf.xacro",
    **{name: f"trossen_descriptions/urdf/{name}.urdf.xacro" for name in (
        "px100", "px150", "rx150", "rx200", "vx250", "vx300", "vx300s", "wx200", "wx250", "wx250s"
    )},
}  # fmt: skip

LABORATORY = {"ur3e": "airo_models/arms/ur3e/ur3e.urdf", "ur5e": "airo_models/arms/ur5e/ur5e.urdf"}

BOX = '<collision><origin xyz="0 0 0.03"/><geometry><box size="0.05 0.05 0.06"/></geometry></collision>'

PEDESTAL = (joint("stand", "floor", "base", "fixed", "0 0 0.9", "0 0 1"), *SIX_AXES)
"""An arm whose URDF has what it stands on."""

COLUMN = '<collision><origin xyz="0 0 0.45"/><geometry><box size="0.3 0.3 0.8"/></geometry></collision>'


def side(name: str, y: float) -> Iterator[str]:
    """The small arm of one side of a robot with two."""
    links = [f"{name}_{k}" for k in range(7)]
    places = ("0 0 0.1", "0.05 0 0.05", "0 0 0.3", "0.1 0 0.05", "0.2 0 0", "0.08 0 0")
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
    yield joint(f"{name}_mount", "torso", links[0], "fixed", f"0 {y} 0.6", "0 0 1")
    for k, (place, axis) in enumerate(zip(places, axes, strict=True)):
        yield turning(f"{name}_joint_{k + 1}", links[k], links[k + 1], place, axis)
    yield joint(f"{name}_end", links[6], f"{name}_hand", "fixed", "0.06 0 0", "0 0 1")


VARIANTS = {
    **LINKAGES,
    **FEW_AXES,
    **{f"{name}, rounded": rounded(joints, 0.0016) for name, joints in FEW_AXES.items()},
    "a pedestal": PEDESTAL,
}


def arms_of_packages() -> Iterator[MatrixArm]:
    """Those of example-robot-data, rtb-data and airo-models."""
    folder = next(Path(one) for one in site.getsitepackages() if (Path(one) / "rtbdata").is_dir())
    for name, path in EXAMPLES.items():
        yield MatrixArm(name, f"{EXAMPLE}/{path}")
    for name, (path, tip) in TWO_ARMS.items():
        yield MatrixArm(name, f"{EXAMPLE}/{path}", tip)
    for name, path in TOOLBOX.items():
        yield MatrixArm(name, str(folder / RTB / path))
    for name, path in LABORATORY.items():
        yield MatrixArm(name, str(folder / path))


def written_arms(folder: Path) -> Iterator[MatrixArm]:
    """The variants, written to a folder."""
    for name, joints in VARIANTS.items():
        yield MatrixArm(name, str(solid(folder, name, joints)))
    urdf = solid(folder, "two arms", (*side("left", 0.25), *side("right", -0.25)))
    yield MatrixArm("two arms", str(urdf))
    yield MatrixArm("two arms, right", str(urdf), "right_hand")


def solid(folder: Path, name: str, joints: Sequence[str]) -> Path:
    """A URDF with a box on each link, and what it stands on."""
    path = written_urdf(folder / f"{name.replace(' ', '_').replace(',', '')}.urdf", *joints)
    boxed = re.sub(r'(<link name="\w+")/>', rf"\1>{BOX}</link>", path.read_text())
    path.write_text(boxed.replace(f'<link name="floor">{BOX}', f'<link name="floor">{COLUMN}'))
    return path


def linked_packages(folder: Path) -> None:
    """A folder in which the packages of rtb-data have the names by which their files refer to each other."""
    data = next(Path(one) / RTB for one in site.getsitepackages() if (Path(one) / RTB).is_dir())
    names = {"abb_irb140": "abb_irb140_description", "abb_irb140_support": "abb_irb140_description"}
    for one in (data / "kuka_description").iterdir():
        names[one.name if one.name.endswith("resources") else f"{one.name}_support"] = f"kuka_description/{one.name}"
    for one in data.glob("*_description*"):
        names.setdefault(one.name, one.name)
    for name, path in names.items():
        if not (folder / name).exists():
            (folder / name).symlink_to(data / path)


LEAST_RANKED, LEAST_SEEN = 40, 0.98
"""Asked: arms of packages that rank, and the share of the promised images that show what they should."""


def prepare(shared: Path) -> None:
    """Write the arms that no package ships, and name packages as their files name each other."""
    for name in ("urdf", "packages"):
        (shared / name).mkdir()
    linked_packages(shared / "packages")
    list(written_arms(shared / "urdf"))


def arms(number: int, folder: Path) -> dict[str, Any] | None:
    """How far an arm gets; those of packages come first."""
    shipped = [*arms_of_packages()]
    every = [*shipped, *written_arms(folder.parent / "urdf")]
    if number >= len(every):
        return None
    arm = every[number]
    os.environ["ROS_PACKAGE_PATH"] = str((folder.parent / "packages").absolute())
    made = new_cell(folder / "cell", urdf=arm.urdf, tip=arm.tip, run=True)
    task, run = made.task, made.run
    can = 0 if task is None else sum(one.feasible for one in open_cell(folder / "cell").rank(task).candidates)
    nothing = next((str(problem) for problem in made.problems if problem.code == "nothing-in-reach"), "")
    stopped = "" if run is None or run.reason is None else f"stopped at {run.time:.2f} s: {run.reason}"
    seen = f"{run.seen}/{run.promised} seen" if run is not None else "not run"
    good = run is not None and run.outcome == "done" and run.promised > 0 and run.seen >= LEAST_SEEN * run.promised
    said = f"{arm.name}: {can} of {len(made.objects)} cubes, {seen} {nothing or stopped}"
    return {"said": said, "name": arm.name, "shipped": number < len(shipped), "ranks": can > 0, "good": good}


def arms_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    shipped = [one["ranks"] for one in found if one["shipped"]]
    yield f"{sum(shipped)} of {len(shipped)} arms of packages rank", sum(shipped) >= min(LEAST_RANKED, len(shipped))
    lost = [one["name"] for one in found if not one["shipped"] and not one["ranks"]]
    yield f"written arms that do not rank: {', '.join(lost) or 'none'}", not lost
    failed = [one["name"] for one in found if one["ranks"] and not one["good"]]
    yield f"arms that rank and do not run as promised: {', '.join(failed) or 'none'}", not failed

"""What `init` makes of arms as packages ship them, and of variants that are written here.

Each arm of the matrix gets a new workspace from nothing but its URDF or xacro; its task is ranked, and the best
candidate run once in the simulated cell.
"""

from __future__ import annotations

import os
import re
import sysconfig
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sqrp_cli import new_cell, open_cell
from tests.cells import read_cases
from tests.task.robots import FEW_AXES, LINKAGES, SIX_AXES, joint, rounded, turning, written_urdf


class Arm(NamedTuple):
    """An arm to try; urdf: a path or `package://...`; tip: the link that `--tip` names."""

    name: str
    urdf: str
    tip: str | None = None


SITE = Path(sysconfig.get_path("purelib"))
"""Where Python has its packages."""

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


def arms_of_packages() -> Iterator[Arm]:
    """Those of example-robot-data, rtb-data and airo-models."""
    for prefix, arms in read_cases("shipped_arms.yaml").items():
        for name, said in arms.items():
            path, *tip = said if isinstance(said, list) else [said]
            yield Arm(name, prefix + path if ":" in prefix else str(SITE / prefix / path), *tip)


def written_arms(folder: Path) -> Iterator[Arm]:
    """The variants, written to a folder."""
    for name, joints in VARIANTS.items():
        yield Arm(name, str(solid(folder, name, joints)))
    urdf = solid(folder, "two arms", (*side("left", 0.25), *side("right", -0.25)))
    yield Arm("two arms", str(urdf))
    yield Arm("two arms, right", str(urdf), "right_hand")


def solid(folder: Path, name: str, joints: Sequence[str]) -> Path:
    """A URDF with a box on each link, and what it stands on."""
    path = written_urdf(folder / f"{name.replace(' ', '_').replace(',', '')}.urdf", *joints)
    boxed = re.sub(r'(<link name="\w+")/>', rf"\1>{BOX}</link>", path.read_text())
    path.write_text(boxed.replace(f'<link name="floor">{BOX}', f'<link name="floor">{COLUMN}'))
    return path


LEAST_RANKED, LEAST_SEEN = 40, 0.98
"""Asked: arms of packages that rank, and the share of the promised images that show what they should."""


def prepare(shared: Path) -> None:
    """Write the arms that no package ships, and name packages as their files name each other."""
    for name in ("urdf", "packages"):
        (shared / name).mkdir()
    list(written_arms(shared / "urdf"))
    data = SITE / "rtbdata" / "xacro"
    names = {"abb_irb140": "abb_irb140_description", "abb_irb140_support": "abb_irb140_description"}
    for one in (data / "kuka_description").iterdir():
        names[one.name if one.name.endswith("resources") else f"{one.name}_support"] = f"kuka_description/{one.name}"
    for name, path in ({one.name: one.name for one in data.glob("*_description*")} | names).items():
        (shared / "packages" / name).symlink_to(data / path)


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

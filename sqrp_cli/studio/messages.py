"""What browsers get: the page, and texts in JSON with `do` first, such as what can be moved."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from importlib import resources
from typing import Any

from sqrp_cli.errors import Problem
from sqrp_cli.geometry import matrix_to_rpy
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.task import in_words
from sqrp_cli.report.documents.checks import ReportedProblem
from sqrp_cli.report.pages.assembly import assembled, tidy
from sqrp_cli.studio.moves import Move, aim, way_up


def message(do: str, **fields: object) -> str:
    """A message: figures with all their digits, nothing invisible in names."""
    return json.dumps(tidy({"do": do, **fields}, digits=None), allow_nan=False)


def kind_of(text: str) -> str:
    """The `do` of a message."""
    return text.split('"', 4)[3]


def findings(problems: Sequence[Problem]) -> list[ReportedProblem]:
    """Problems as documents have them."""
    return [ReportedProblem.of(problem) for problem in problems]


def parameters(workspace: Workspace, task: str) -> list[dict[str, object]]:
    """The motion parameters of a task's skill, with their values and the words that they may have instead."""
    skill = workspace.skills.get(task.split()[0].lower()) if task.split() else None
    if skill is None:
        return []
    return [
        {
            "name": one.name,
            "values": [in_words(skill, {one.name: value})[one.name].replace(" ", "") for value in one.values],
            "words": [word for kind in one.kinds for word in kind.words],
        }
        for one in skill.motion_parameters
    ]


def handles(workspace: Workspace) -> dict[str, Any]:
    """What can be moved, and where it is as people would type it."""
    cameras = {
        name: Move(
            kind="camera",
            name=name,
            position=camera.X_FC[:3, 3].tolist(),
            look_at=aim(workspace, camera).tolist(),
            fov=2.0 * math.atan(0.5 * camera.width / float(camera.matrix[0, 0])),
        )
        for name, camera in workspace.cameras.items()
    }
    objects = {
        name: Move(kind="object", name=name, position=X[:3, 3].tolist(), yaw=matrix_to_rpy(X[:3, :3])[2])
        for name, one in workspace.objects.items()
        if (X := one.X_WO) is not None and f"objects.{name}.pose" in workspace.places
    }
    X_WB = workspace.robot.X_WB
    base = Move(kind="base", name="", position=X_WB[:3, 3].tolist(), yaw=matrix_to_rpy(X_WB[:3, :3])[2])
    frames = {name: camera.frame for name, camera in workspace.cameras.items()}
    ups = {name: way_up(workspace, camera).tolist() for name, camera in workspace.cameras.items()}
    return {"camera": cameras, "object": objects, "base": {"": base}, "frames": frames, "ups": ups}


SCRIPTS = ("gizmo", "fields", "runs", "studio")
"""Its own scripts, each after those that it needs."""


def studio_page(title: str, socket: str) -> str:
    """The text of the page. socket: where its scripts may connect to."""
    return assembled(
        title,
        "\n".join(_asset(f"{name}.js") for name in SCRIPTS),
        data={},
        style=_asset("studio.css"),
        further=_asset("studio.html"),
        policy=f"; connect-src {socket}; img-src data:; base-uri 'none'; form-action 'none'",
    )


def _asset(name: str) -> str:
    return resources.files("sqrp_cli.studio").joinpath("browser", name).read_text(encoding="utf-8")

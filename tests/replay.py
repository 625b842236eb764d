"""Plays an exported joint trajectory in Pinocchio, from the CSV file and `sqrp show` alone, and judges it."""

from __future__ import annotations

import csv
from itertools import combinations
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

TOUCH = 5e-4
"""What a box may sink in at each side before that is a contact [m]: standing on something is none."""
CUP = ((0.01, 0.03, 0.02), (0.05, 0.01, 0.06), (0.09, 0.016, 0.02))
"""The suction cup: distance from the flange, radius and length of its cylinders [m]."""
TIP = 0.1
"""Distance of the suction tip from the flange [m]."""


class Replay:
    """An exported trajectory, and the cell that it is played in.

    t: [s], shape (m,). q, v, a: joint states, shape (m, n), columns in the order of the model.
    """

    def __init__(self, show: dict[str, Any], export: Path) -> None:
        robot = show["robot"]
        with export.open(newline="", encoding="utf-8") as file:
            self.rows = list(csv.DictReader(file))
        self.model = pin.buildModelFromUrdf(robot["urdf"])
        self.joints = list(self.model.names)[1:]
        self.t = np.array([float(row["time"]) for row in self.rows])
        self.q, self.v, self.a = (
            np.array([[float(row[f"{kind}_{joint}"]) for joint in self.joints] for row in self.rows])
            for kind in ("position", "velocity", "acceleration")
        )
        self.jerk = np.array([robot["joints"][joint]["jerk"] for joint in self.joints])
        self.X_WB = pin.SE3(np.array(robot["base"]))
        self.objects = show["objects"]
        self.flange = self.model.getFrameId("tool0")
        self.data = self.model.createData()
        self._geometry(robot)

    def _geometry(self, robot: dict[str, Any]) -> None:
        roots = [str(root) for root in robot["package_roots"]]
        self.geometry = pin.buildGeomFromUrdf(self.model, robot["urdf"], pin.GeometryType.COLLISION, package_dirs=roots)
        frame = self.model.frames[self.flange]
        links = list(range(self.geometry.ngeoms))
        for index, (z, radius, length) in enumerate(CUP):
            X = frame.placement * pin.SE3(np.eye(3), np.array([0, 0, z]))
            part = pin.GeometryObject(f"cup{index}", frame.parentJoint, X, coal.Cylinder(radius, length))
            links.append(self.geometry.addGeometryObject(part))
        self.boxes = {}
        for name, obj in self.objects.items():
            box = coal.Box(*(np.array(obj["size"]) - 2 * TOUCH))
            self.boxes[name] = self.geometry.addGeometryObject(pin.GeometryObject(name, 0, pin.SE3.Identity(), box))
        parents = [obj.parentJoint for obj in self.geometry.geometryObjects]
        fixed = {box for name, box in self.boxes.items() if self.objects[name]["fixed"]}
        for i, j in combinations([*links, *self.boxes.values()], 2):
            own, one_link = i in links and j in links, min(i, j) in links
            neighbours = own and abs(parents[i] - parents[j]) <= 1  # or both on the base
            on_base = one_link and not own and parents[min(i, j)] == 0
            if not (neighbours or {i, j} <= fixed or on_base):
                self.geometry.addCollisionPair(pin.CollisionPair(i, j))

    def tool_pose(self, q: np.ndarray) -> pin.SE3:
        """Pose of the suction tip in the world."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.X_WB * self.data.oMf[self.flange] * pin.SE3(np.eye(3), np.array([0, 0, TIP]))

    def contacts(self) -> set[tuple[str, str]]:
        """Pairs of solids that touch at any row; a held object moves with the tool and stays where it is let go."""
        X_WO = {name: pin.SE3(np.array(obj["pose"])) for name, obj in self.objects.items()}
        data = self.geometry.createData()
        held, X_TO = "", pin.SE3.Identity()
        found = set()
        for row, q in zip(self.rows, self.q, strict=True):
            X_WT = self.tool_pose(q)
            if held:
                X_WO[held] = X_WT * X_TO
            if row["held"] != held:
                held = row["held"]
                X_TO = X_WT.inverse() * X_WO[held] if held else X_TO
            for name, box in self.boxes.items():
                self.geometry.geometryObjects[box].placement = self.X_WB.inverse() * X_WO[name]
            pin.computeCollisions(self.model, self.data, self.geometry, data, q, False)
            for pair, result in zip(self.geometry.collisionPairs, data.collisionResults, strict=True):
                if result.isCollision():
                    names = (self.geometry.geometryObjects[k].name for k in (pair.first, pair.second))
                    found.add(tuple(sorted(names)))
        self.X_WO = X_WO
        return found


def assert_continuous(replay: Replay) -> None:
    """Each row follows from the one before by its velocity and acceleration, but for what the jerk limit allows."""
    dt, jerk, slack = np.diff(replay.t)[:, None], replay.jerk, 5e-9
    assert (dt > 0).all()
    v = replay.v[:-1] + replay.a[:-1] * dt
    q = replay.q[:-1] + replay.v[:-1] * dt + replay.a[:-1] * dt**2 / 2
    assert (np.abs(replay.v[1:] - v) <= jerk * dt**2 / 2 + slack).all()
    assert (np.abs(replay.q[1:] - q) <= jerk * dt**3 / 6 + slack).all()
    assert (np.abs(replay.v[[0, -1]]) <= slack).all()

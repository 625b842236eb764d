"""Where boxes are and what a camera's limits say about them, by kinematics and optics of our own.

Only the JSON documents and the URDFs that they name are read.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

Document = dict[str, Any]

CELLS = ("tabletop", "harsh", "watch", "gripper")
SIGNS = np.array(list(product((-0.5, 0.5), repeat=3)))
EXACT = 1e-9
LIMITS = ("behind", "too_near", "too_far", "out_of_image", "detector_near", "detector_far", "oblique", "too_small")


@pytest.fixture(params=CELLS)
def scene(request, scenes):
    return scenes[request.param]


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' rotation formula."""
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def numbers(element: ElementTree.Element | None, key: str, default: str) -> np.ndarray:
    return np.array((default if element is None else element.get(key, default)).split(), dtype=float)


class Arm:
    """Forward kinematics of the URDFs of a robot and, for its fingers, of its tool."""

    def __init__(self, robot: Document) -> None:
        arm, *tools = [
            ElementTree.parse(part["urdf"]).getroot()  # noqa: S314 - our own files
            for part in (robot, robot["tool"])
            if part is not None
        ]
        self._joints = [joint for root in (arm, *tools) for joint in root.findall("joint")]
        self.links = {link.get("name") for link in arm.findall("link")}
        self._tool_links = {link.get("name") for tool in tools for link in tool.findall("link")}
        children = {joint.find("child").get("link") for joint in self._joints}
        self._roots = {name: ("", np.array(robot["base"])) for name in self.links - children}
        for name in self._tool_links - children:
            self._roots[name] = (robot["tool"]["link"], np.array(robot["tool"]["pose"]))
        self.movable = {j.get("name") for j in self._joints if j.get("type") in ("revolute", "continuous", "prismatic")}
        self.mimics = {
            j.get("name"): (m.get("joint"), float(m.get("multiplier", 1)), float(m.get("offset", 0)))
            for j in self._joints
            if (m := j.find("mimic")) is not None
        }

    def poses(self, q: dict[str, float]) -> dict[str, np.ndarray]:
        """World pose of every link at joint positions."""
        children = {joint.find("child").get("link"): joint for joint in self._joints}
        poses: dict[str, np.ndarray] = {}

        def place(link: str) -> np.ndarray:
            if link not in poses:
                joint = children.get(link)
                if joint is not None:
                    poses[link] = place(joint.find("parent").get("link")) @ self._step(joint, q)
                else:
                    carrier, X = self._roots[link]
                    poses[link] = place(carrier) @ X if carrier else X
            return poses[link]

        for link in self.links | self._tool_links:
            place(link)
        return poses

    @staticmethod
    def _step(joint: ElementTree.Element, q: dict[str, float]) -> np.ndarray:
        roll, pitch, yaw = numbers(joint.find("origin"), "rpy", "0 0 0")
        x, y, z = np.eye(3)
        X = np.eye(4)
        X[:3, :3] = rotation(z, yaw) @ rotation(y, pitch) @ rotation(x, roll)
        X[:3, 3] = numbers(joint.find("origin"), "xyz", "0 0 0")
        axis = numbers(joint.find("axis"), "xyz", "1 0 0")
        moved = np.eye(4)
        match joint.get("type"):
            case "revolute" | "continuous":
                moved[:3, :3] = rotation(axis, q[joint.get("name")])
            case "prismatic":
                moved[:3, 3] = axis / np.linalg.norm(axis) * q[joint.get("name")]
        return X @ moved


class Lens:
    """The camera models of ROS (plumb_bob, rational_polynomial, equidistant), as OpenCV documents them."""

    def __init__(self, camera: Document) -> None:
        self._K = np.array(camera["K"])
        self._model, self._D = camera["distortion_model"], np.array(camera["D"])
        r = np.linspace(0.0, 20.0, 200_001)
        shrinks = np.diff(self._radial(r)) <= 0
        self._fold = r[int(shrinks.argmax())] if shrinks.any() else math.inf

    def _radial(self, r: np.ndarray) -> np.ndarray:
        """Distance from the axis in the image plane that a point at distance r gets from the radial terms."""
        if self._model == "equidistant":
            angle = np.arctan(r)
            powers = [angle ** (2 * n + 3) for n in range(4)]
            return angle + sum(k * power for k, power in zip(self._D, powers, strict=True))
        k1, k2, _, _, k3, k4, k5, k6 = [*self._D, *[0.0] * (8 - len(self._D))]
        return r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)

    def folds_before(self, r: float) -> bool:
        """Whether the radial distortion stops growing somewhere up to r, which is at most 20."""
        return r >= self._fold

    def pixel(self, point: np.ndarray) -> np.ndarray:
        x, y = point[:2] / point[2]
        r = math.hypot(x, y)
        scale = float(self._radial(np.array(r))) / r if r > 1e-12 else 1.0
        bent = np.array([x * scale, y * scale, 1.0])
        if self._model != "equidistant":
            p1, p2 = self._D[2], self._D[3]
            bent[0] += 2 * p1 * x * y + p2 * (r * r + 2 * x * x)
            bent[1] += p1 * (r * r + 2 * y * y) + 2 * p2 * x * y
        return (self._K @ bent)[:2]

    def pinhole(self, point: np.ndarray) -> np.ndarray:
        return (self._K @ (point / point[2]))[:2]


def hull_area(points: np.ndarray) -> float:
    """Area of a convex hull: for every direction of an edge the hull lies on one side (gift wrapping)."""
    start = at = int(np.lexsort((points[:, 1], points[:, 0]))[0])
    area = 0.0
    while True:
        following = (at + 1) % len(points)
        for k in range(len(points)):
            a, b = points[following] - points[at], points[k] - points[at]
            turn = a[0] * b[1] - a[1] * b[0]
            if turn < 0 or (turn == 0 and b @ b > a @ a):
                following = k
        first, then = points[at] - points[start], points[following] - points[start]
        area += 0.5 * (first[0] * then[1] - first[1] * then[0])
        at = following
        if at == start:
            return abs(area)


def beyond_sides(pixels: np.ndarray, camera: Document) -> dict[str, float]:
    """How far the outermost corner lies beyond each side of the image [pixels]."""
    u, v = pixels[:, 0], pixels[:, 1]
    return {
        "left": float((-0.5 - u).max()), "right": float((u - (camera["width"] - 0.5)).max()),
        "top": float((-0.5 - v).max()), "bottom": float((v - (camera["height"] - 0.5)).max()),
    }  # fmt: skip


def limit_margins(
    corners: np.ndarray, normal: np.ndarray | None, camera: Document, lens: Lens, detector: Document
) -> tuple[dict[str, float], dict[str, float]]:
    """By how much each limit is missed (positive) or kept, in the order of the checks, and how far beyond each side.

    corners (8, 3) and normal (3,) in the optical frame.
    """
    depth = corners[:, 2]
    margins = {"behind": math.inf if depth.min() <= 0 else -depth.min()}
    margins["too_near"] = (camera["near"] or 0.0) - depth.min()
    margins["too_far"] = depth.max() - (math.inf if camera["far"] is None else camera["far"])
    sides: dict[str, float] = {}
    pixels = None
    if depth.min() > 0:
        folded = [lens.folds_before(math.hypot(*(point[:2] / point[2]))) for point in corners]
        pixels = np.array([(lens.pinhole if f else lens.pixel)(p) for f, p in zip(folded, corners, strict=True)])
        sides = beyond_sides(pixels, camera)
        margins["out_of_image"] = math.inf if any(folded) else max(sides.values())
    center = corners.mean(axis=0)
    distance = float(np.linalg.norm(center))
    margins["detector_near"] = detector["distance"][0] - distance
    margins["detector_far"] = distance - detector["distance"][1]
    if normal is not None:
        angle = math.atan2(np.linalg.norm(np.cross(normal, -center)), float(normal @ -center))
        margins["oblique"] = angle - detector["max_incidence"]
    if pixels is not None:
        margins["too_small"] = detector["min_pixels"] - math.sqrt(hull_area(pixels))
    return margins, sides


def frames_of(arm: Arm, document: Document, sample: Document) -> dict[str, np.ndarray]:
    """World pose of every link, object and `OBJECT@start`, and of the world, whatever a URDF calls its root."""
    start = {f"{name}@start": np.array(X) for name, X in document["samples"][0]["objects"].items()}
    objects = {name: np.array(X) for name, X in sample["objects"].items()}
    return {**arm.poses(sample["q"]), **objects, **start, "world": np.eye(4)}


def boxes_of(document: Document, sample: Document) -> Iterator[tuple[Document, Document]]:
    """Each box of each literal of a sample: what the target says about it, and what was found."""
    for name, literal in sample["literals"].items():
        yield from zip(document["targets"][name]["boxes"], literal["boxes"], strict=True)


def some_samples(document: Document) -> list[Document]:
    """Every sixth sample, with the first and the last."""
    samples = document["samples"]
    return [*samples[::6], samples[-1]]


def test_joints_corners_and_occluders_follow_from_the_robot_and_the_cell(show, documents):
    arm = Arm(show["robot"])
    # Q has every movable joint of the urdf and mimics follow.
    for document in documents:
        for sample in document["samples"]:
            assert arm.movable <= set(sample["q"])
            for joint, (leader, multiplier, offset) in arm.mimics.items():
                assert sample["q"][joint] == pytest.approx(multiplier * sample["q"][leader] + offset, abs=EXACT)
    # Corners follow from frame size and pose, geometric causes from camera and corners.
    lenses = {name: Lens(camera) for name, camera in show["cameras"].items()}
    for document in documents:
        for sample in some_samples(document):
            frames = frames_of(arm, document, sample)
            for box, found in boxes_of(document, sample):
                X_WB = frames[box["frame"]] @ np.array(box["pose"])
                corners_W = SIGNS * np.array(box["size"]) @ X_WB[:3, :3].T + X_WB[:3, 3]
                assert np.abs(np.array(found["corners"]) - corners_W).max() < EXACT
                normal = None if box["normal"] is None else X_WB[:3, :3] @ np.array(box["normal"])
                for name, verdict in found["cameras"].items():
                    camera = show["cameras"][name]
                    X_WC = frames[camera["frame"]] @ np.array(camera["pose"])
                    corners = (np.array(found["corners"]) - X_WC[:3, 3]) @ X_WC[:3, :3]
                    margins, sides = limit_margins(
                        corners,
                        None if normal is None else X_WC[:3, :3].T @ normal,
                        camera,
                        lenses[name],
                        show["detectors"][box["detector"]],
                    )
                    _check_cause(verdict, margins, sides)


def _check_cause(verdict: Document, margins: dict[str, float], sides: dict[str, float]) -> None:
    if any(abs(margin) < 1e-6 for margin in margins.values()):
        return  # on the very edge of a limit rounding decides
    expected = next((cause for cause in LIMITS if margins.get(cause, -1.0) > 0), None)
    assert (verdict["cause"] if verdict["cause"] in LIMITS else None) == expected, (verdict, margins)
    if expected == "out_of_image":
        assert sides[verdict["by"]] > 0, (verdict, sides)


def test_the_cells_stage_every_cause(scenes):
    causes: Counter[str | None] = Counter()
    for _, documents in scenes.values():
        for document in documents:
            for sample in document["samples"]:
                causes.update(v["cause"] for _, box in boxes_of(document, sample) for v in box["cameras"].values())
    assert set(causes) == {None, "hidden", "same_colour", *LIMITS}


def test_boxes_and_what_hides_them_are_those_of_the_cell(show, documents):
    # Occluders are links objects or opaque parts and so is what a box encloses.
    known = Arm(show["robot"]).links | set(show["objects"]) | {part["name"] for part in show["opaque"]}
    for document in documents:
        for target in document["targets"].values():
            for box in target["boxes"]:
                assert set(box["encloses"]) <= known
        for sample in document["samples"]:
            for _, box in boxes_of(document, sample):
                hidden = [v for v in box["cameras"].values() if v["cause"] == "hidden"]
                assert {v["by"] for v in hidden} <= known
    # Normals are unit vectors and thin boxes have one.
    for document in documents:
        for target in document["targets"].values():
            for box in target["boxes"]:
                assert min(box["size"]) >= 0.002 or box["normal"] is not None
                assert box["normal"] is None or np.linalg.norm(box["normal"]) == pytest.approx(1.0, abs=EXACT)
    # An object that is not handled never moves.
    for document in documents:
        handled = set(document["parameters"].values())
        for sample in document["samples"]:
            for name, pose in sample["objects"].items():
                if name not in handled:
                    assert pose == show["objects"][name]["pose"]
    # Paths in the documents are absolute.
    paths = [
        show["robot"]["urdf"],
        *show["robot"]["package_roots"],
        *(p["mesh"] for p in show["opaque"] if "mesh" in p),
    ]
    assert all(Path(path).is_absolute() for path in paths)


def test_a_held_object_is_attached_at_the_end_of_the_grasp_and_moves_rigidly(scenes):
    # A held object moves rigidly with the tool and rests before.
    for name in ("tabletop", "harsh"):
        show, documents = scenes[name]
        arm = Arm(show["robot"])
        carrier = show["robot"]["tool"]["link"]
        for document in documents:
            grasped = document["parameters"]["object"]
            in_tool = []
            for sample in document["samples"]:
                assert sample["held"] in (None, grasped)
                pose = np.array(sample["objects"][grasped])
                if sample["held"]:
                    in_tool.append(np.linalg.inv(arm.poses(sample["q"])[carrier]) @ pose)
                else:
                    assert np.abs(pose - np.array(document["samples"][0]["objects"][grasped])).max() < EXACT
                    assert not in_tool
            assert in_tool
            assert np.abs(np.array(in_tool) - in_tool[0]).max() < EXACT
    # The grasp attaches at the end of its primitive.
    _, documents = scenes["tabletop"]
    for document in documents:
        grasp_end = next(p["end"] for p in document["primitives"] if p["name"] == "a3")
        held = [sample["t"] for sample in document["samples"] if sample["held"]]
        free = [sample["t"] for sample in document["samples"] if not sample["held"]]
        assert min(held) == pytest.approx(grasp_end, abs=EXACT)
        assert max(free) == pytest.approx(grasp_end, abs=EXACT)

"""Where boxes are and what a camera's limits say about them, by kinematics of our own and the plain reference of sight.

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

from sqrp_cli.camera.camera import Camera
from tests.sight import reference
from tests.sight.reference import Verdict
from tests.sight.views import make_box, make_camera, make_detector

Document = dict[str, Any]

CELLS = ("tabletop", "harsh", "watch", "gripper")
SIGNS = np.array(list(product((-0.5, 0.5), repeat=3)))
EXACT, FAR = 1e-9, 1e6
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


def camera_at(X_WC: np.ndarray, said: Document) -> Camera:
    """A camera of a document, at a pose in the world."""
    (fx, _, cx), (_, fy, cy), _ = said["K"]
    near, far = said["near"] or 0.0, FAR if said["far"] is None else said["far"]
    lens = {"model": said["distortion_model"], "distortion": said["D"], "focal": (fx, fy), "center": (cx, cy)}
    return make_camera(X_WC, size=(said["width"], said["height"]), near=near, far=far, **lens)


def limit(camera: Camera, box: Document, X_WB: np.ndarray, detector: Document) -> Verdict:
    """The first limit of camera and detector that a box fails, by the plain reference."""
    limits = make_detector(**{name: detector[name] for name in ("distance", "max_incidence", "min_pixels")})
    sought = make_box(tuple(box["size"]), X_WB, detector=limits, normal=box["normal"])
    return reference.limit(reference.Scene(camera, sought, (), {"world": np.eye(4)}))


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
    for document in documents:
        for sample in some_samples(document):
            frames = frames_of(arm, document, sample)
            for box, found in boxes_of(document, sample):
                X_WB = frames[box["frame"]] @ np.array(box["pose"])
                corners_W = SIGNS * np.array(box["size"]) @ X_WB[:3, :3].T + X_WB[:3, 3]
                assert np.abs(np.array(found["corners"]) - corners_W).max() < EXACT
                for name, verdict in found["cameras"].items():
                    said = show["cameras"][name]
                    camera = camera_at(frames[said["frame"]] @ np.array(said["pose"]), said)
                    expected = limit(camera, box, X_WB, show["detectors"][box["detector"]])
                    if expected.sure:
                        cause = expected.cause.name.lower()
                        assert (verdict["cause"] if verdict["cause"] in LIMITS else "none") == cause, verdict
                        assert cause != "out_of_image" or verdict["by"] == expected.by


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

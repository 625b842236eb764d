"""`show --json`: what was understood of a workspace, against what its files say."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

Document = dict[str, Any]

CELLS = ("tabletop", "harsh", "watch")
COEFFICIENTS = {"plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}
SIZES = {"box": 3, "cylinder": 2, "capsule": 2}


@pytest.fixture(params=CELLS)
def show(request, scenes):
    document, _ = scenes[request.param]
    return document


def root(show: Document) -> ElementTree.Element:
    return ElementTree.parse(show["robot"]["urdf"]).getroot()  # noqa: S314 - our own files


def test_robot_parts_and_cameras_are_given_in_full(show):
    # The urdf exists and has the joints that are listed.
    assert Path(show["robot"]["urdf"]).is_file()
    joints = {joint.get("name"): joint for joint in root(show).findall("joint")}
    assert show["robot"]["joints"]
    for name, limits in show["robot"]["joints"].items():
        stated = joints[name].find("limit")
        assert joints[name].get("type") in ("revolute", "prismatic", "continuous")
        if joints[name].get("type") != "continuous":
            assert limits["lower"] == pytest.approx(float(stated.get("lower")))
            assert limits["upper"] == pytest.approx(float(stated.get("upper")))
        assert 0.0 < limits["velocity"] <= float(stated.get("velocity")) + 1e-9
        assert limits["acceleration"] > 0.0
        assert limits["jerk"] > 0.0
    # Opaque parts hang on links of the urdf or on objects or in the world.
    links = {link.get("name") for link in root(show).findall("link")}
    names = [part["name"] for part in show["opaque"]]
    assert len(names) == len(set(names))
    for part in show["opaque"]:
        assert part["parent"] in {*links, *show["objects"], "world"}
        assert ("shape" in part) != ("mesh" in part)
        if "mesh" in part:
            assert Path(part["mesh"]).is_file()
            assert np.size(part["scale"]) in (1, 3)
        else:
            assert part["shape"] in (*SIZES, "sphere")
            assert np.size(part["size"]) == SIZES.get(part["shape"], 1)
            assert np.min(part["size"]) > 0.0
    # Links of the robot are not repeated among the opaque parts.
    assert not links & {part["name"] for part in show["opaque"]}
    # Cameras are given in full.
    for camera in show["cameras"].values():
        K = np.array(camera["K"])
        assert K.shape == (3, 3)
        assert K[2].tolist() == [0.0, 0.0, 1.0]
        assert min(K[0, 0], K[1, 1]) > 0.0
        assert len(camera["D"]) == COEFFICIENTS[camera["distortion_model"]]
        assert camera["frame"] in {"world", *links}
        assert 0.0 <= camera["near"] < (math.inf if camera["far"] is None else camera["far"])
        assert camera["rate"] > 0.0
        assert camera["latency"] >= 0.0
        assert type(camera["width"]) is int
        assert type(camera["height"]) is int


def test_home_is_within_the_joint_limits_and_begins_every_motion(show, scenes):
    for name, value in show["robot"]["home"].items():
        limits = show["robot"]["joints"].get(name)
        if limits is not None:
            assert limits["lower"] <= value <= limits["upper"]
    documents = next(documents for found, documents in scenes.values() if found is show)
    for document in documents:
        assert document["samples"][0]["q"] == pytest.approx(show["robot"]["home"], abs=1e-9)


def test_the_solid_parts_of_the_tool_are_listed_on_the_link_that_carries_it(scenes):
    show, _ = scenes["tabletop"]
    tool = ElementTree.parse(show["robot"]["tool"]["urdf"]).getroot()  # noqa: S314 - our own files
    solid = [link for link in tool.findall("link") if link.find("collision") is not None]
    carried = [part for part in show["opaque"] if part["parent"] == show["robot"]["tool"]["link"]]
    assert {part["name"] for part in carried} == {link.get("name") for link in solid}
    # The tool's own axis is z: its parts are cylinders whose centres lie on it, one after the other.
    heights = [np.array(part["pose"])[:3, 3] for part in carried]
    assert np.abs(np.array(heights)[:, :2]).max() < 1e-9
    assert sorted(heights[i][2] for i in range(len(heights))) == pytest.approx([0.01, 0.05, 0.09], abs=1e-9)


def test_shapes_of_objects_are_listed_part_by_part(sqrp, watch):
    cell = watch.parent / "cell"
    outcome = sqrp("show", cell, "--json")
    assert outcome.code == 0, outcome.err
    show = outcome.document
    tray = {part["name"]: part for part in show["opaque"] if part["parent"] == "tray"}
    assert len(tray) == 3
    box, cylinder, mesh = tray.values()
    assert (box["shape"], box["size"]) == ("box", [0.2, 0.2, 0.01])
    assert (cylinder["shape"], cylinder["size"]) == ("cylinder", [0.01, 0.05])
    assert Path(mesh["mesh"]).is_file()
    assert np.unique(mesh["scale"]).tolist() == [0.01]
    assert [np.array(part["pose"])[:3, 3].tolist() for part in tray.values()] == [
        [0.0, 0.0, -0.02], [0.09, 0.09, 0.0], [0.0, 0.0, 0.0],
    ]  # fmt: skip
    (cup,) = [part for part in show["opaque"] if part["parent"] == "wrist"]
    assert (cup["shape"], cup["size"]) == ("cylinder", [0.01, 0.04])
    assert np.array(cup["pose"])[:3, 3] == pytest.approx([0.0, 0.0, 0.005], abs=1e-12)
    side = np.array(show["cameras"]["side"]["pose"])
    # `convention: body`: x forward. At yaw -90 deg the camera looks along -y, with z of the world up in the image.
    assert side[:3, 2] == pytest.approx([0.0, -1.0, 0.0], abs=1e-9)
    assert side[:3, 1] == pytest.approx([0.0, 0.0, -1.0], abs=1e-9)
    assert show["cameras"]["side"]["D"] == [0.1203, -0.2417, 0.0004, -0.0011, 0.0]

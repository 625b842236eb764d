"""Recordings of runs, read by other libraries than the one that writes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import inverse, pose, quaternion_to_matrix
from sqrp_cli.ros.bag import Bag, BagWriter
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.record.bag_recorder import BagRecorder
from sqrp_cli.run.record.events import AskedBox, ShownAtom, event
from sqrp_cli.run.robot_body import RobotBody

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def workspace() -> Workspace:
    return load_workspace(ROOT / "workspaces" / "tabletop")


@pytest.fixture(scope="module", params=[".mcap", ".bag"])
def recording(request: Any, tmp_path_factory: pytest.TempPathFactory, workspace: Workspace) -> Path:
    """A short run: one state, one image, one step with its evidence, one fault."""
    path: Path = tmp_path_factory.mktemp("bags") / f"run{request.param}"
    body = RobotBody.load(workspace.robot)
    recorder = BagRecorder(BagWriter(path), workspace, body)
    joints = dict(workspace.robot.home)
    box = AskedBox(frame="world", size=[0.04, 0.04, 0.04], pose=np.eye(4).tolist())
    shown = ShownAtom(value="blind", asked=True, cameras={"cam1": "false"})
    image = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)
    g1 = [0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0]
    recorder(event("step", 0.0, skill="pickup", boxes={"hold(g1)": [box]}))
    recorder(event("state", 0.5, joints=list(joints), q=list(joints.values()), held=None, objects={"g1": g1}))
    recorder.add(CameraImage("cam1", 0.6, image), planned=True)
    recorder(event("evidence", 0.7, exposed=0.6, literals={"hold(g1)": shown}))
    recorder(event("fault", 0.8, name="slip", text="g1 fell"))
    recorder.close()
    return path


def test_every_message_is_what_rosbags_packs_by_the_definitions_in_the_recording(recording: Path) -> None:
    from rosbags.highlevel import AnyReader

    with AnyReader([recording]) as reader:
        store, ros1, read = reader.typestore, recording.suffix == ".bag", set()
        for connection, _, data in reader.messages():
            kind = connection.msgtype
            message = store.deserialize_ros1(data, kind) if ros1 else store.deserialize_cdr(data, kind)
            packed = store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind)
            assert bytes(packed) == bytes(data), kind
            read.add(connection.topic)
        assert read == set(reader.topics)
        assert reader.message_count == 18


def test_an_mcap_is_read_by_the_library_of_its_format(recording: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    if recording.suffix != ".mcap":
        pytest.skip("a bag of ROS 1 is no MCAP")
    with recording.open("rb") as file, Bag(recording) as bag:
        theirs = [(c.topic, s.name, m.log_time, m.data) for s, c, m in reader.make_reader(file).iter_messages()]
        ours = [(one.topic, one.type, one.t, bytes(one.data)) for one in bag.messages({t.name for t in bag.topics})]
    assert sorted(theirs) == sorted(ours)


def test_frames_lead_from_the_world_to_links_and_cameras(recording: Path, workspace: Workspace) -> None:
    frames = {}
    with Bag(recording) as bag:
        for one in bag.messages({"/tf", "/tf_static"}):
            for found in bag.read(one).transforms:
                t, r = found.transform.translation, found.transform.rotation
                X = pose(quaternion_to_matrix([r.x, r.y, r.z, r.w]), [t.x, t.y, t.z])
                frames[found.child_frame_id] = (found.header.frame_id, X)

    def in_world(name: str) -> Any:
        X = np.eye(4)
        while name != "world":
            name, X_PN = frames[name]
            X = X_PN @ X
        return X

    X_WL = RobotBody.load(workspace.robot).link_poses(workspace.robot.home)
    for link, X in X_WL.items():
        np.testing.assert_allclose(in_world(link), X, atol=1e-9)
    for camera in workspace.cameras.values():
        np.testing.assert_allclose(in_world(f"{camera.name}_optical_frame"), camera.X_FC, atol=1e-9)
    assert np.allclose(inverse(in_world("tool0")) @ in_world("tool0"), np.eye(4))


def test_the_description_has_robot_and_tool_in_one_tree(recording: Path, workspace: Workspace) -> None:
    with Bag(recording) as bag:
        (one,) = bag.messages({"/robot_description"})
        root = Xml.fromstring(bag.read(one).data)  # noqa: S314 - our own
    links = {link.get("name") for link in root.iter("link")}
    children = {child.get("link") for child in root.iter("child")}
    assert links >= {*workspace.robot.urdf.links, workspace.robot.tool_frame}
    assert len(links - children) == 1  # the root


def test_verdicts_and_boxes_say_what_is_blind(recording: Path) -> None:
    with Bag(recording) as bag:
        verdicts, boxes, said = (
            [bag.read(one) for one in bag.messages({topic})] for topic in ("/verdicts", "/boxes", "/rosout")
        )
    (status,) = verdicts[0].status
    assert (status.name, status.message, status.level) == ("hold(g1)", "blind", 1)
    assert ("cam1", "false") in [(pair.key, pair.value) for pair in status.values]
    assert boxes[-1].markers[-1].color.r > 0.9
    assert [one.msg for one in said] == ["step 1: pickup", "fault: slip (g1 fell)"]


def test_a_run_that_ends_before_its_first_image_leaves_an_older_recording(tmp_path: Path, workspace: Workspace) -> None:
    (tmp_path / "run.mcap").write_bytes(b"an older one")
    recorder = BagRecorder(BagWriter(tmp_path / "run.mcap"), workspace, RobotBody.load(workspace.robot))
    recorder(event("step", 0.0, skill="pickup", boxes={}))
    recorder.close()
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"an older one"]


def test_a_recording_appears_when_it_is_whole_and_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    found, path = [], tmp_path / "run.mcap"
    for end in (BagWriter.discard, BagWriter.close, BagWriter.close):
        writer = BagWriter(path)
        writer.add("/x", 1, writer.types.make("std_msgs/msg/String", data="x"))
        assert path.exists() is bool(found)
        end(writer)
        found += [one.read_bytes() for one in tmp_path.iterdir()]
    assert len(found) == 2
    assert len({*found}) == 1

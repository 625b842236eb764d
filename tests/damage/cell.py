"""A whole cell in a folder, with a file of every kind that a user may get wrong."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
from rosbags import rosbag2

from sqrp_cli.recording.recording import open_recording
from sqrp_cli.ros.bag import Bag, written
from sqrp_cli.starter.make import make_starter
from tests.cell.mesh.mesh_bombs import binary_stl
from tests.damage.child import call
from tests.recording.datasets import write_dataset

CASES = Path(__file__).parents[1] / "cases"
TASK = "pickup red"
IMAGE = "sensor_msgs/msg/CompressedImage"
MESHES = ("cube.stl", "binary.stl", "cube.obj", "cube.dae")
WATCHED, LOG, FRAMES, FRAME = "watched", "run.jsonl", "frames", "frame.png"
"""A cell with small cameras in which a program ran, the log of the run, its frames, and the first of them."""
BASELINE, RESULTS, SCORE = "baseline.json", "results", ["--samples", "2", "--jobs", "1", "--json"]
FRAMES_KEPT = 4
MCAP, ROS1, ROSBAG2 = "run.mcap", "run.bag", "rosbag2"
"""The same run as recordings, with some of its images."""
IMAGES_KEPT = 6
"""Of each camera."""


def whole_cell(folder: Path) -> Path:
    """The starter workspace with all that people write, and a program, a baseline, results and a run."""
    made = make_starter(folder, None).folder
    _record(made)
    _describe(made)
    _do("rank", made, TASK, "--samples", "2", "--program", made / "program.yaml")
    _demonstrate(made)
    results = ["--out", made / RESULTS, "--save-baseline", made / BASELINE]
    (made / "score.json").write_text(_do("score", made, *SCORE, *results), encoding="utf-8")
    (made / RESULTS / ".lock").unlink()  # copies of the cell share their files
    scheduler = {"type": "Scheduler", "id": "Scheduler-1", "address": "tcp://127.0.0.1:1", "workers": {}}
    (made / "scheduler.json").write_text(json.dumps(scheduler, indent=2), encoding="utf-8")
    return made


def _demonstrate(made: Path) -> None:
    """Let the motion of the program be a recording in each form, and each of these a task of a workspace."""
    (made / "recorded").mkdir()
    table, trajectory, dataset = (made / "recorded" / name for name in ("demo.csv", "demo.yaml", "set"))
    for file in (table, trajectory):
        _do("program", made / "program.yaml", "--export", file, "--rate", "10 Hz")
    motion = open_recording(trajectory)
    write_dataset(dataset, [motion.read(0).values.astype(np.float32)], motion.names, "v2.1")
    lines = [(made / "workspace.yaml").read_text(encoding="utf-8"), "recordings:"]
    for task, file in {"dataset": dataset, "table": table, "trajectory": trajectory}.items():
        lines.append(f"  {task}: {{file: recorded/{file.name}, detector: color, objects: {{r1: {{}}}}}}")
    (made / "demos.yaml").write_text("\n".join(lines), encoding="utf-8")


def _describe(made: Path) -> None:
    _calibrate(made / "workspace.yaml")
    for file in ("damage/arm.srdf", "damage/hand_eye.yaml", "damage/cube.obj", "damage/cube.dae", "cell/cube.stl"):
        shutil.copy(CASES / file, made)
    shutil.copyfile(CASES / "cameras" / "camera_calibration.yaml", made / "camera.yaml")
    shutil.copyfile(CASES / "cameras" / "opencv_filestorage.yaml", made / "opencv.yaml")
    (made / "binary.stl").write_bytes(binary_stl())


def _calibrate(workspace: Path) -> None:
    """Let the cameras and an object of the starter workspace be described by files of their own."""
    text = workspace.read_text(encoding="utf-8")
    cameras, rest = text.split("skills: [", 1)
    first, image = cameras.index("    image:"), "    image: {width: 1280, height: 960, horizontal_fov: 60 deg}\n"
    cameras = cameras[:first] + "    calibration: camera.yaml\n" + cameras[first + len(image) :]
    pose = cameras.index("    pose:", cameras.index("cam2:"))
    cameras = cameras[:pose] + "    hand_eye: hand_eye.yaml\n" + cameras[cameras.index("\n", pose) + 1 :]
    cameras = cameras.replace(image, "    calibration: opencv.yaml\n")
    cameras = cameras.replace("  base:", "  srdf: arm.srdf\n  base:")
    parts = ", ".join(f"{{mesh: {mesh}, scale: 0.04}}" for mesh in MESHES)
    rest = rest.replace(", on: table}\n\nstate", f", on: table, parts: [{parts}]}}\n\nstate")
    workspace.write_text(cameras + "skills: [" + rest, encoding="utf-8")


def _record(made: Path) -> None:
    """Run a program in a copy of the cell whose cameras are small, and keep its log and some of its frames."""
    watched = shutil.copytree(made, made / WATCHED)
    text = (watched / "workspace.yaml").read_text(encoding="utf-8")
    text = re.sub(r"image: .*", "image: {width: 96, height: 72, horizontal_fov: 60 deg}", text)
    (watched / "workspace.yaml").write_text(text.replace("rate: 10 Hz", "rate: 5 Hz"), encoding="utf-8")
    program, frames = watched / "program.yaml", watched / FRAMES
    _do("rank", watched, TASK, "--samples", "2", "--program", program)
    _do("run", program, "--sim", "--log", watched / LOG, "--frames", frames, "--record", watched / MCAP, "--json")
    _do("run", program, "--sim", "--record", watched / ROS1, "--json")
    for recording in (watched / MCAP, watched / ROS1):
        _thin(recording)
    as_rosbag2(watched / MCAP, watched / ROSBAG2)
    columns, *rows = (frames / "frames.csv").read_text(encoding="utf-8").splitlines()
    planned = [row for row in rows if not row.endswith(",")]
    kept, first = planned[:FRAMES_KEPT], planned[0].split(",")[1]
    for file in {row.split(",")[1] for row in rows} - {row.split(",")[1] for row in kept}:
        (frames / file).unlink()
    (frames / first).rename(frames / FRAME)
    text = "\n".join([columns, *kept]).replace(first, FRAME)
    (frames / "frames.csv").write_text(text + "\n", encoding="utf-8")


def _thin(recording: Path) -> None:
    """Leave of a recording the joint states, some images, and whether all went as planned."""
    left, thinned = dict[str, int](), recording.with_name(f"thinned{recording.suffix}")
    with Bag(recording) as bag, written(thinned) as writer:
        kept = [topic for topic in bag.topics if topic.name in {"/joint_states", "/as_planned"} or topic.type == IMAGE]
        every = {topic.name: max(topic.messages // IMAGES_KEPT, 1) for topic in kept if topic.type == IMAGE}
        for one in bag.messages([topic.name for topic in kept]):
            left[one.topic] = left.get(one.topic, -1) + 1
            if left[one.topic] % every.get(one.topic, 1) == 0:
                writer.add(one.topic, one.t, bag.read(one))
    thinned.replace(recording)


def as_rosbag2(recording: Path, folder: Path) -> Path:
    """The messages of an MCAP in a folder with SQLite, as ROS 2 wrote them until Humble."""
    with Bag(recording) as bag, rosbag2.Writer(folder, version=8) as writer:
        kinds = {topic.name: topic.type for topic in bag.topics}
        ways = {name: writer.add_connection(name, kind, typestore=bag.types.store) for name, kind in kinds.items()}
        for one in bag.messages(kinds):
            writer.write(ways[one.topic], one.t, one.data)
    return folder


def _do(*words: object) -> str:
    """What a command prints. Raises AssertionError unless the undamaged cell is good for it."""
    done = call([str(word) for word in words])
    if done.code not in (0, 3):
        raise AssertionError(f"the undamaged cell must be good for {words[0]}: {done.said}")
    return done.out

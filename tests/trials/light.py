"""What simulated cameras show against what is promised, in cells whose colours collide, and whose lights are random.

Light: the best candidate is photographed, image by image, without physics, and looked at as in a run: with colours as
they count, and as if they did not. Lamps: the arm takes a random pose; of every part that is visible enough, the share
of its pixels that have its colour for a detector of colours says whether it can be told.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "egl")
os.environ["LP_NUM_THREADS"] = "0"

import numpy as np

from sqrp_cli.camera.light import hue_of
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import pose
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import Truth
from sqrp_cli.motion.cell import Cell
from sqrp_cli.program.record import Step
from sqrp_cli.run.cell.mujoco_model import build_model, mujoco, quaternion
from sqrp_cli.run.cell.renderer import Renderer
from sqrp_cli.run.cell.simulated_cell import SimulatedCell, placed_objects
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.monitor.nominal_step import NominalStep
from sqrp_cli.run.monitor.step_monitor import Attempt
from sqrp_cli.run.perception.detections import BelievedState, CellModel, Detection, DetectionTargets, fuse
from sqrp_cli.run.perception.image_detector import ImageDetector
from sqrp_cli.run.perception.vision import color_mask
from sqrp_cli.run.record.report import Confusion
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import SoughtBox, Target
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.program_update import make_step, with_usual_images
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.verdict import with_verdict
from sqrp_cli.task.task import read_task
from tests.cells import read_cell, write_cell
from tests.random_cell import Crowd, random_cell

PROMISED_AND_SEEN, USUAL_AND_SEEN, STOPS_LEFT, SURPRISES_LEFT = 0.995, 0.98, 0.1, 0.5
"""Asked: of the images that were promised to show something, of usual images, of the stops without colours, and of the
images that show what was not promised without colours, by promises alone."""
PAINTS = ("green", "red", "blue", "yellow", "orange", "purple", "cyan")
"""Colours that detectors find."""

PLAIN = {"cube": 0.0, "block": 0.2, "table": 0.6}
"""How often each type of object is grey."""

PANELS, AWAY, WIDE = 3, 1.2, 0.8
"""How many panels stand around the table at most, how far from the robot, and how wide they are [m]."""


def coloured_cell(folder: Path, seed: int) -> str:
    """Make a workspace whose contents, colours and cameras depend on the seed alone; returns a task for it."""
    rng = np.random.default_rng((seed, 27))
    random_cell(folder, Crowd(seed, int(rng.integers(6, 13)), int(rng.integers(2, 5))))
    paints, cell = rng.permutation(PAINTS)[:2].tolist(), read_cell(folder)
    objects = cell["objects"]
    for one in objects.values():
        one["color"] = "grey" if rng.random() < PLAIN[one["type"]] else str(rng.choice(paints))
    for camera in cell["cameras"].values():
        camera["image"] = {"width": 640, "height": 480, "horizontal_fov": "45 deg"}
    for number in range(int(rng.integers(0, PANELS + 1))):  # upright, and facing the robot
        turn = (number + rng.uniform(0.2, 0.8)) * 2 * np.pi / PANELS
        color, height = str(rng.choice(paints)), round(rng.uniform(0.3, 0.9), 3)
        place = np.round([AWAY * np.cos(turn), AWAY * np.sin(turn), height / 2], 3).tolist()
        there = {"position": place, "rpy": [0, 0, round(float(turn), 3)]}
        panel = {"type": "panel", "color": color, "size": [0.03, WIDE, height], "pose": there, "fixed": True}
        objects[f"panel{number}"] = panel
    color = str(rng.choice([one["color"] for one in objects.values() if one["type"] == "cube"]))
    cell["tasks"] = [{"task": f"pickup {color}"}]
    write_cell(cell, folder)
    return f"pickup {color}"


PERIOD = 0.1
"""Between two images [s]."""


def _best_of(cell: Cell, task: str) -> Analysis | None:
    """The first-ranked candidate; None if there is none."""
    found = {}
    for candidate in read_task(task, cell.workspace).candidates:
        result = analyse(cell, candidate, cell.initial_world, Adaptive(), full=True)
        if not isinstance(result, Infeasible):
            found[candidate.name] = result
    ranked = rank([with_verdict(cell, one.timeline, one.result) for one in found.values()], "q_eoi")
    return found[ranked[0].candidate.name] if ranked else None


def photos(
    workspace: Workspace, joints: Sequence[str], step: Step
) -> Iterator[tuple[float, Mapping[str, bool], list[Detection]]]:
    """Every instant [s] of a step, what is true then, and what the images show that are drawn of it."""
    body = RobotBody.load(workspace.robot)
    nominal, model = NominalStep(step, joints, body), build_model(workspace, placed_objects(step.before))
    renderer = Renderer(model, tuple(workspace.cameras.values()), 0)
    known = CellModel.of(workspace, body)
    detectors = {name: ImageDetector(camera, known) for name, camera in workspace.cameras.items()}
    for detector in detectors.values():
        detector.watch(DetectionTargets(dict(step.targets), step.before.X_WO, nominal.when_open))
    for t in np.arange(0.0, step.time, PERIOD).tolist():
        primitive = next((p for p in step.primitives if t <= p.end), step.primitives[-1])
        q = primitive.trajectory.positions(np.array([t - primitive.start]))[0].tolist()
        at_rest = {**step.before.joints, **dict(zip(joints, q, strict=True))}
        X_WO, positions = nominal.object_poses(t), model.qpos0.copy()
        for name, value in at_rest.items():
            positions[model.joint(name).qposadr[0]] = value
        for index in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT):  # joints that mimic others
            follower, leader = (model.jnt_qposadr[ids[index]] for ids in (model.eq_obj1id, model.eq_obj2id))
            positions[follower] = model.eq_data[index, 0] + model.eq_data[index, 1] * positions[leader]
        for name, X in X_WO.items():
            if not workspace.objects[name].fixed:
                at = int(model.joint(name).qposadr[0])
                positions[at : at + 7] = *X[:3, 3], *quaternion(X)
        renderer.move(positions)
        believed = BelievedState(at_rest, primitive.held is not None or primitive.action == "Grasp", X_WO)
        images = [CameraImage(name, t, renderer.image(name, t)) for name in detectors]
        truths = {atom: nominal.holds(atom, t) for atom in step.targets}
        yield t, truths, [detectors[image.camera].look(image, believed) for image in images]
    renderer.close()


def compared(
    workspace: Workspace, joints: Sequence[str], step: Step
) -> tuple[Confusion, Confusion, Counter[str], str | None]:
    """What was promised for a motion against what the images show, each counted for every literal required then.

    Returns counts of promised and seen, and of those not promised of usual and seen; of the images that differ from the
    promise literal, camera and reason; and why a run would stop because nothing is seen where it was promised.
    """
    nominal = NominalStep(step, joints, RobotBody.load(workspace.robot))
    monitor, misses, stop = Attempt(nominal, PERIOD), Counter[str](), None
    counts, rest = Confusion(), Confusion()
    for t, truths, shown in photos(workspace, joints, step):
        for detection in shown:
            for atom in monitor.monitored(t):
                seen = detection.truth(atom) == (Truth.TRUE if truths[atom] else Truth.FALSE)
                promised = detection.camera in nominal.covering(atom, t)
                target = step.targets[atom]
                spans = target.usual if truths[atom] or not target.refuted else target.refuted
                usual = any(start <= t <= end for start, end in spans.get(detection.camera, ()))
                counts.add(promised, seen)
                if not promised:
                    rest.add(usual, seen)
                if seen != promised:
                    blind = [box for box in detection.boxes.get(atom, ()) if box.evidence is Truth.UNKNOWN]
                    least = min(blind, key=lambda box: box.share).because if blind else "detector"
                    reason = least if promised else "more"
                    misses[f"{atom} {detection.camera} {reason} {truths[atom]}"] += 1
        values = {atom: fuse(atom, target, shown).truth for atom, target in step.targets.items()}
        alarm = monitor.observe(t, values)
        if alarm is not None and alarm.kind == "blindness" and stop is None:
            stop = f"{t:.1f} s: {alarm.text}"
    return counts, rest, misses, stop


def light(number: int, folder: Path) -> dict[str, Any]:
    """Counts of images, promised and usual, of the best candidate with colours and without, and why a run stops."""
    task, said, found = coloured_cell(folder / "cell", number), "", dict[str, Any]()
    cell = Cell.load(load_workspace(folder / "cell"))
    observer = cell.observer
    plain = replace(observer, solids=tuple(replace(solid, color=None) for solid in observer.solids))
    for name, judged in (("with", cell), ("without", replace(cell, observer=plain))):
        best = _best_of(judged, task)
        if best is not None:
            result = with_verdict(judged, best.timeline, best.result)
            step = make_step(task, best, result, tuple(judged.workspace.cameras))
            step = with_usual_images(step, best, judged.observer)
            counts, rest, misses, stop = compared(judged.workspace, best.planned.motion.joint_names, step)
            found[name] = [asdict(counts), asdict(rest), stop is not None]
            if stop or (name == "with" and counts.fp):
                said += f"{name} colours: {dict(misses)} {stop or ''} "
    return {"said": said, **found}


def light_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    sums = {}
    for name in ("with", "without"):
        those = [one[name] for one in found if name in one]
        counts, rest = (sum((Confusion(**one[k]) for one in those), Confusion()) for k in (0, 1))
        sums[name] = counts, rest, sum(one[2] for one in those)
        words = (
            f"{counts.tp} of {counts.tp + counts.fp} promised images showed it, {rest.tp} of {rest.tp + rest.fp} usual"
        )
        said = f"{name} colours: {words} ones, {rest.fn} of {rest.fn + rest.tn} others; {sums[name][2]} stops"
        good = (counts.precision or 1) >= PROMISED_AND_SEEN and (rest.precision or 1) >= USUAL_AND_SEEN
        yield said, good or name == "without"
    (_, rest, stops), (all_counts, _, all_stops) = sums["with"], sums["without"]
    left = rest.fn <= SURPRISES_LEFT * all_counts.fn and stops <= STOPS_LEFT * all_stops
    yield "colours leave few surprises and few stops for blindness", left


AGREE = 0.98
"""Asked: of the verdicts."""

MOST_LAMPS, TELLS, FEW = 2, 0.5, 60
"""How many lights a cell has at most besides that of the room; share of a part that must be told; pixels that are too
few to say."""


def _light_up(folder: Path, seed: int) -> None:
    """Add lights and gains to a workspace, depending on the seed alone."""
    rng, cell = np.random.default_rng((seed, 28)), read_cell(folder)
    lights = cell["lights"] = {"room": {"intensity": round(rng.uniform(0.0, 0.3), 3)}}
    for number in range(int(rng.integers(1, MOST_LAMPS + 1))):
        height, turn = np.radians(rng.uniform(25, 85)), rng.uniform(-np.pi, np.pi)
        way = np.array([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)])
        strength = float(np.exp(rng.uniform(np.log(0.15), np.log(4.0))))
        if rng.random() < 0.6:
            lights[f"sun{number}"] = {"intensity": round(strength, 3), "direction": (-way).round(4).tolist()}
            continue
        aim, away = np.array([rng.uniform(-0.3, 0.6), rng.uniform(-0.4, 0.4), 0.0]), rng.uniform(1.0, 2.0)
        place = {"position": (aim + away * way).round(4).tolist(), "look_at": aim.round(4).tolist()}
        beam = f"{rng.uniform(50, 120):.0f} deg"
        lights[f"lamp{number}"] = {"intensity": round(strength * away**2, 3), "beam": beam, **place}
    for camera in cell["cameras"].values():
        camera["gain"] = round(float(np.exp(rng.uniform(-0.5, 0.5))), 3)
    write_cell(cell, folder)


def lamps(seed: int, folder: Path) -> dict[str, Any]:
    """Of the parts before the cameras whether each is said to be told, and is, while the arm stands somewhere."""
    coloured_cell(folder / "cell", seed)
    _light_up(folder / "cell", seed)
    cell = Cell.load(load_workspace(folder / "cell"))
    workspace, home = cell.workspace, cell.workspace.robot.home
    joints = dict(zip(home, np.random.default_rng(seed).normal(list(home.values()), 0.5).tolist(), strict=True))
    q = np.array([[joints[name] for name in cell.model.arm]])
    X_WO = {name: obj.X_WO[None] for name, obj in workspace.objects.items() if obj.X_WO is not None}
    states = SceneStates(1, {**cell.model.link_poses(q), "world": pose()[None], **X_WO})
    parts = [obj for obj in workspace.objects.values() if not obj.fixed and hue_of(obj.color) is not None]
    boxes = [
        SoughtBox(
            name=obj.name, detector="color", frame=obj.name, size=obj.size, X_FB=pose(), normal=None,
            encloses=(obj.name,), limits=workspace.detectors["color"], seeks=obj.name, color=obj.color,
        ) for obj in parts
    ]  # fmt: skip
    found = cell.observer.verdicts([Target(Atom.of(f"seen({box.name})"), 1, (box,)) for box in boxes], states)
    simulated = SimulatedCell(workspace, cell.initial_world)
    model, positions = simulated.model, simulated.positions
    for name, value in joints.items():
        positions[model.joint(name).qposadr[0]] = value
    renderer = Renderer(model, tuple(workspace.cameras.values()), 0)
    renderer.move(positions)
    said, pairs = [], []
    for index, camera in enumerate(workspace.cameras.values()):
        image, bodies = renderer.image(camera.name, 0.0), renderer.solids(camera.name, camera.X_FC).body
        for obj, (judged,) in zip(parts, found, strict=True):
            cause, visible = Cause(int(judged.cause[0, index])), float(judged.visible[0, index])
            shown = bodies == model.body(obj.name).id
            if cause in (Cause.NONE, Cause.TOO_DARK, Cause.TOO_BRIGHT) and shown.sum() >= FEW:
                told = visible * float(color_mask(image, obj.color or "")[shown].mean())
                pairs.append([cause is Cause.NONE, told >= TELLS])
                if pairs[-1][0] != pairs[-1][1]:
                    said.append(f"{camera.name} {obj.color} {obj.name}: {cause.words}, but {told:.0%} has its colour")
    renderer.close()
    return {"said": "; ".join(said), "pairs": pairs}


def lamps_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    pairs = [pair for one in found for pair in one["pairs"]]
    agree, told = sum(said == told for said, told in pairs), sum(told for _, told in pairs)
    yield f"{agree} of {len(pairs)} verdicts agree; without regard to light {told}", agree >= AGREE * len(pairs)

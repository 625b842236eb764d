"""How small, oblique or hidden a thing may be until perception no longer sees it, measured from simulated images."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.markers import ObjectMarker
from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import Array, look_at, pose, read_only
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.run.cell.mujoco_model import quaternion
from sqrp_cli.run.cell.renderer import Renderer
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.perception.detections import BelievedState, BoxDetection, CellModel, DetectionTargets
from sqrp_cli.run.perception.image_detector import ImageDetector
from sqrp_cli.run.perception.projected import PosedCamera
from sqrp_cli.run.perception.vision import filled, find_markers
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.skill.target_box import TargetBox
from tests.run.cell.scenes import camera, cell, empty, thing, world

FOCAL = 600.0
PLACE = (4.0, 0.0, 0.02)
"""Of the cube, far from the robot."""
CUBE, SCREEN = thing("cube", PLACE, color="green"), thing("screen", (4.0, 2.0, 0.5), (0.4, 0.4, 0.004), color="black")
OTHER_SCREEN = thing("other", (4.0, 2.5, 0.5), SCREEN.size, color="black")
GROUND = thing("ground", (4.0, 0.0, -0.02), (20.0, 20.0, 0.04), color="grey", fixed=True)
PLATE = thing("plate", PLACE, (0.054, 0.054, 0.002), color="white", marker=37)
MARKER = ObjectMarker(id=37).on(PLATE.size)


class Stage:
    """A renderer of things that are put where a test wants them."""

    def __init__(self, base: Workspace) -> None:
        self.knowledge = CellModel.of(base, RobotBody.load(base.robot))
        self._physics = SimulatedCell(base, world(base))
        self._renderer = Renderer(self._physics.model, tuple(base.cameras.values()), 0)
        self._positions = self._physics.positions

    def put(self, name: str, X_WO: Array) -> None:
        start = self._physics.model.joint(name).qposadr[0]
        self._positions[start : start + 7] = [*X_WO[:3, 3], *quaternion(X_WO)]

    def frame(self, eye: str, t: float) -> CameraImage:
        self._renderer.move(self._positions)
        return CameraImage(eye, t, self._renderer.image(eye, t))

    def look(
        self, eye: Camera, name: str, believed: Array, *frames: Mapping[str, Array], detector: str = "color"
    ) -> list[BoxDetection]:
        """What images show of the box in which a thing is believed to be, with things at the poses of each frame."""
        looker = ImageDetector(eye, self.knowledge)
        looker.watch(sought(name, self.knowledge.objects[name].size, believed, detector))
        found = []
        for number, poses in enumerate(frames):
            for thing_name, X_WO in poses.items():
                self.put(thing_name, X_WO)
            state = BelievedState({}, False, {**poses, name: believed})
            found.append(looker.look(self.frame(eye.name, 0.1 * number), state).boxes[f"placed({name})"][0])
        return found

    def close(self) -> None:
        self._renderer.close()


def sought(name: str, size: tuple[float, float, float], X_WO: Array, detector: str = "color") -> DetectionTargets:
    """That a thing is where it was at the start."""
    box = TargetBox(
        name="place", detector=detector, frame=f"{name}@start", size=size, X_FB=pose(), normal=None,
        encloses=(name,),
    )  # fmt: skip
    return DetectionTargets({f"placed({name})": ProgramTarget(cameras=1, boxes=(box,), seen={})}, {name: X_WO}, {})


def staged(things: Sequence[SceneObject], cameras: Sequence[Camera]) -> closing[Stage]:
    return closing(Stage(cell(empty(), things, cameras)))


def marker_rate(pixels: float, incidence: float, trials: int, seed: int = 0) -> float:
    """Share of random views in which a marker is found whose image has an area of pixels^2, tilted by `incidence`."""
    random = np.random.default_rng([seed, round(pixels * 10), round(incidence * 1000)])
    eye = camera(X_FC=look_at((3.0, 0.0, 2.0), (5.0, 0.0, 1.5)), focal=(FOCAL, FOCAL))
    depth = FOCAL * MARKER.side * np.sqrt(np.cos(incidence)) / pixels
    found = 0
    with staged([PLATE], [eye]) as stage:
        for trial in range(trials):
            center = depth * np.array([*random.uniform((-0.3, -0.25), (0.3, 0.25)), 1.0])
            stage.put("plate", eye.X_FC @ pose(tilted(center, incidence, random), center))
            found += any(number == MARKER.id for number, _ in find_markers(stage.frame("cam", trial).image))
    return found / trials


def color_rates(
    pixels: float, visible: float, trials: int, *, min_visible: float = 0.5, seed: int = 0, slit: bool = False
) -> tuple[float, float]:
    """Shares of random views in which perception is right about a cube: that it is there, and that it is gone.

    pixels: square root of the area of its image. visible: share of that area that a screen leaves free; slit: that lies
    between two screens. min_visible: share that the detector asks for.
    """
    random = np.random.default_rng([seed, round(pixels * 10), round(visible * 1000)])
    eyes = [_view_of_cube(f"eye{trial}", pixels, random) for trial in range(trials)]
    screens = (SCREEN, OTHER_SCREEN) if slit else (SCREEN,)
    with staged([GROUND, CUBE, *screens], eyes) as stage:
        detectors = stage.knowledge.detectors
        asking = {**detectors, "color": replace(detectors["color"], min_visible=min_visible)}
        stage.knowledge = replace(stage.knowledge, detectors=asking)
        here, away, rates = pose(position=PLACE), pose(position=(4.0, -6.0, 0.02)), np.zeros(2)
        aside = {one.name: pose(position=(4.0, 3.0 + number, 0.5)) for number, one in enumerate(screens)}
        for eye in eyes:  # the cube without a screen, then behind one or between two, and gone
            hiding = dict(zip(aside, _screens(eye, here, visible, random, slit=slit), strict=True))
            frames = [{"cube": X, **where} for X, where in ((here, aside), (here, hiding), (away, hiding))]
            _, there, gone = stage.look(eye, "cube", here, *frames)
            rates += (there.evidence is Truth.TRUE, gone.evidence is Truth.FALSE)
    return tuple((rates / trials).tolist())


def beside(share: float, trials: int, seed: int = 0) -> list[Truth]:
    """What perception says of the place of a cube, in random views, that lies beside it by a share of its side."""
    random = np.random.default_rng([seed, round(share * 1000)])
    eyes = [_view_of_cube(f"eye{trial}", 30.0, random) for trial in range(trials)]
    frames = [{"cube": pose(position=np.add(PLACE, (right * CUBE.size[0], 0.0, 0.0)))} for right in (0.0, share)]
    with staged([GROUND, CUBE], eyes) as stage:
        return [stage.look(eye, "cube", pose(position=PLACE), *frames)[1].evidence for eye in eyes]


def _view_of_cube(name: str, pixels: float, random: np.random.Generator) -> Camera:
    """A camera somewhere above the ground in whose image the cube has an area of pixels^2."""
    height, heading = random.uniform(0.35, 1.2), random.uniform(-np.pi, np.pi)
    way = np.array([np.cos(heading) * np.cos(height), np.sin(heading) * np.cos(height), np.sin(height)])
    target = np.array(PLACE) + random.uniform(-0.1, 0.1, 3)
    distance = FOCAL * 0.05 / pixels
    for _ in range(5):
        eye = camera(name, eye=(target + distance * way).tolist(), target=target.tolist(), focal=(FOCAL, FOCAL))
        shown = PosedCamera(Projection(eye), eye.X_FC).outline(pose(position=PLACE), CUBE.size)
        distance *= np.sqrt(shown.area) / pixels
    return eye


def _screens(eye: Camera, X_WO: Array, visible: float, random: np.random.Generator, *, slit: bool) -> Iterator[Array]:
    """Poses of the screens, across the view, whose edges leave that share of the cube's image free."""
    view = PosedCamera(Projection(eye), eye.X_FC)
    shown, turn = view.outline(X_WO, CUBE.size), random.uniform(-np.pi, np.pi)
    across = np.array([np.cos(turn), np.sin(turn)])
    places = np.argwhere(filled(view.whole, [shown.corners]))[:, ::-1] @ across
    hidden = (1.0 - visible) / (2.0 if slit else 1.0)
    middle, depth = shown.polygon.mean(axis=0), 0.8 * shown.depth
    edge = float(np.quantile(places, 1.0 - hidden)) + (5.0 if visible >= 1.0 else 0.0)
    yield _screen_from(eye, across, edge, middle, depth)
    if slit:
        yield _screen_from(eye, -across, -float(np.quantile(places, hidden)), middle, depth)


def _screen_from(eye: Camera, across: Array, edge: float, middle: Array, depth: float) -> Array:
    """The pose of a screen at a depth [m] that reaches from an edge in a direction `across` of the image (2,)."""
    along = np.array([-across[1], across[0]])
    pixel = across * edge + along * float(middle @ along)
    on_edge = np.append((pixel - eye.matrix[:2, 2]) / FOCAL, 1.0) * depth
    R = np.column_stack([np.append(across, 0.0), np.append(along, 0.0), (0.0, 0.0, 1.0)])
    return eye.X_FC @ pose(R, on_edge + SCREEN.size[0] / 2 * R[:, 0])


def tilted(center: Array, incidence: float, random: np.random.Generator) -> Array:
    """A random rotation whose z axis is tilted by an angle against the direction from `center` to the camera."""
    towards = -center / np.linalg.norm(center)
    side = _perpendicular(towards, random)
    normal = np.cos(incidence) * towards + np.sin(incidence) * side
    x = _perpendicular(normal, random)
    return read_only(np.column_stack([x, np.cross(normal, x), normal]))


def _perpendicular(axis: Array, random: np.random.Generator) -> Array:
    vector = random.normal(size=3)
    vector -= vector @ axis * axis
    result: Array = vector / np.linalg.norm(vector)
    return result

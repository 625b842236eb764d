"""What a hand moves in a cell: in memory, while it moves, and as text of the workspace file, where it rests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, FiniteFloat

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.edits import stated_look_at, with_camera, with_pose
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.errors import InputError, bad_input, bad_option, expected_names
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.yaml_edit import with_values
from sqrp_cli.geometry import Array, axis_rotation, inverse, look_at, matrix_to_rpy, pose
from sqrp_cli.records import dataclass

Point = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]
MOST_CHANGES, MOST_KEPT = 500, 50_000_000
"""How many changes can be taken back, and how long their texts may be together [bytes]; the oldest go first."""
FARTHEST = 100.0  # how far from the origin of its frame anything can be put [m]
SAME = 5e-5  # what differs by less is as it was, as the page rounds to 0.1 mm [m, rad]
DEGREE = np.pi / 180  # [rad]
NARROWEST, WIDEST = np.radians([1.0, 177.0]).tolist()
"""The least and the greatest horizontal field of view of a lens [rad]."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """Where something is put."""

    kind: Literal["camera", "object", "base"]
    name: str  # of the camera or object; empty for the base
    position: Point  # of the lens in the frame that carries the camera, of the middle of the object, or of the base [m]
    look_at: Point | None = None  # of a camera: the point in the middle of its image, in the same frame [m]
    fov: FiniteFloat | None = None  # of a camera: its horizontal field of view [rad]; None as it is
    yaw: FiniteFloat | None = None  # of an object or the base: its angle about the world's z axis [rad]; None as it is

    def in_words(self, before: Move | None = None) -> str:
        """What is moved where, and how else it differs from `before`, if that is known."""
        done = []
        for name, words, scale in (
            ("position", "at {0:.3f}, {1:.3f}, {2:.3f} m", 1.0),
            ("look_at", "looks at {0:.3f}, {1:.3f}, {2:.3f} m", 1.0),
            ("fov", "with a view angle of {0:.4g} deg", DEGREE),
            ("yaw", "turned to {0:.4g} deg", DEGREE),
        ):
            value, old = getattr(self, name), getattr(before, name, None)
            told = before is not None or name == "position"
            if told and value is not None and (old is None or not np.allclose(value, old, atol=SAME)):
                done.append(words.format(*np.atleast_1d(value) / scale))
        what = self.name or "the robot's base"
        return f"{what} {', '.join(done) or 'as it was'}"


def moved(workspace: Workspace, move: Move) -> Workspace:
    """The workspace with something elsewhere. Raises InputError where it cannot be, as for a look at the own lens."""
    if max(map(abs, move.position)) > FARTHEST:
        raise bad_option(f"{move.in_words()}, expected at most {FARTHEST:g} m from the origin")
    known = {"camera": workspace.cameras, "object": workspace.objects, "base": {"": None}}[move.kind]
    if move.name not in known:
        message = f"there is no {move.kind} `{move.name}`; {expected_names(move.name, known)}"
        raise bad_input(f"unknown-{move.kind}", message)
    if move.kind == "camera":
        camera = workspace.cameras[move.name]
        point, up = aim(workspace, camera)
        try:
            X_FC = look_at(move.position, point if move.look_at is None else np.array(move.look_at), up)
        except ValueError as error:
            raise bad_option(f"`{move.name}` cannot look at its own lens") from error
        matrix = camera.matrix.copy()
        if move.fov is not None:
            if not NARROWEST <= move.fov <= WIDEST:
                least, most = np.degrees([NARROWEST, WIDEST])
                message = f"a view angle of {np.degrees(move.fov):g} deg, expected {least:g} to {most:g} deg"
                raise bad_option(message)
            matrix[[0, 1], [0, 1]] *= 0.5 * camera.width / np.tan(0.5 * move.fov) / matrix[0, 0]
        camera = replace(camera, X_FC=X_FC, matrix=matrix)
        return replace(workspace, cameras={**workspace.cameras, camera.name: camera})
    # An object or the base is moved, and turned about the world's z axis.
    X = workspace.robot.X_WB if move.kind == "base" else workspace.objects[move.name].X_WO
    if X is None:
        raise bad_option(f"it is not known where `{move.name}` is")
    R = X[:3, :3]
    turned = R if move.yaw is None else axis_rotation(2, move.yaw - matrix_to_rpy(R)[2]) @ R
    there = pose(turned, move.position)
    if move.kind == "base":
        return replace(workspace, robot=replace(workspace.robot, X_WB=there))
    place = replace(workspace.objects[move.name], pose=there)
    return replace(workspace, objects={**workspace.objects, move.name: place})


def aim(workspace: Workspace, camera: Camera) -> Array:
    """The point that a camera looks at, or 1 m ahead [m], over what is up for it, in the frame of its pose, (2, 3)."""
    stated, X_FC = stated_look_at(workspace, camera.name), camera.X_FC
    return np.array([X_FC[:3, 3] + X_FC[:3, 2], -X_FC[:3, 1]]) if stated is None else stated


def written(document: SourceDocument, workspace: Workspace, move: Move) -> bytes:
    """The workspace file with something elsewhere. Raises InputError for what the file does not say itself."""
    after = moved(workspace, move)
    if move.kind == "camera":
        camera = after.cameras[move.name]
        point = np.array(move.look_at) if move.look_at is not None else aim(workspace, camera)[0]
        return with_camera(document, workspace.cameras[move.name], camera, point)
    if move.kind == "base":
        return with_pose(document, ("robot", "base"), after.robot.X_WB)
    if ("objects", move.name, "pose") not in document.values:
        message = f"the workspace states no pose of `{move.name}` itself"
        raise bad_option(message, mend="change the file that does")
    placed = after.objects[move.name]
    assert placed.X_WO is not None  # noqa: S101 - it was moved
    return with_pose(document, ("objects", move.name, "pose"), placed.X_WO @ inverse(placed.X_FO))


@dataclass(frozen=True, kw_only=True)
class DraftChange:
    """One step of editing."""

    label: str  # what it does, in words
    values: Mapping[str, str] | None  # what it sets, by dotted path, as YAML text; None where it does more than that
    content: bytes  # the file with it


@dataclass(frozen=True, kw_only=True)
class Draft:
    """The text of a workspace file, with what led to it."""

    path: Path  # of the file
    saved: bytes  # the file on the disk
    first: bytes  # the text before the changes that can be taken back
    past: tuple[DraftChange, ...] = ()  # the changes that hold, in order
    future: tuple[DraftChange, ...] = ()  # those that were undone, the next to redo first

    @property
    def content(self) -> bytes:
        """The text now."""
        return self.past[-1].content if self.past else self.first

    @property
    def dirty(self) -> bool:
        """Whether the text is not as it is saved."""
        return self.content != self.saved

    def changed(self, change: DraftChange) -> Draft:
        """With one more change."""
        past, first = (*self.past, change), self.first
        while len(past) > MOST_CHANGES or (len(past) > 1 and sum(len(one.content) for one in past) > MOST_KEPT):
            first, past = past[0].content, past[1:]
        return replace(self, first=first, past=past, future=())

    def stepped(self, *, back: bool) -> Draft:
        """Without the last change, or with the one that was undone last, if there is one."""
        changes, here = (*self.past, *self.future), len(self.past) + (-1 if back else 1)
        here = min(max(here, 0), len(changes))
        return replace(self, past=changes[:here], future=changes[here:])

    def on(self, saved: bytes) -> tuple[Draft, tuple[DraftChange, ...]]:
        """The draft on a file that was changed elsewhere, and the changes that do not fit it any more."""
        unsaved = self.past if self.dirty else ()
        draft, lost = Draft(path=self.path, saved=saved, first=saved), list[DraftChange]()
        for change in unsaved:
            try:
                document = read_workspace_document(self.path, draft.content)
                if change.values is None:
                    raise InputError
                draft = draft.changed(replace(change, content=with_values(document, change.values)))
            except InputError:
                lost.append(change)
        return draft, tuple(lost)

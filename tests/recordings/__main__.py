"""Recordings with one camera that has moved, and as many with none: `python -m tests.recordings [COUNT [FIRST]]`.

By default 40 of each, of the `tabletop`; half of the cameras were turned by 0.5 degrees about any axis, half moved by
5 mm in any direction. Two clocks of each recording are off by 20 to 500 ms. Asked: the camera that has moved is named
in 38 of 40, its pose mended to 0.1 degrees and 1 mm (median), none is named in the others, and clocks are found to
5 ms. What is done is kept in build/recordings, so that an interrupted trial goes on, and several may run at once:
`20` and `40 20`, then `40` for the sum.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sqrp_cli.ask.api.program import OpenProgram, open_program
from sqrp_cli.ask.values import silent
from sqrp_cli.camera.camera import Camera
from sqrp_cli.cli.main import run
from sqrp_cli.field.audit.bag_footage import BagFootage
from sqrp_cli.field.audit.report import AuditedCamera
from sqrp_cli.field.audit.survey import survey
from sqrp_cli.geometry import inverse
from tests.recordings.make import CellPictures, Truth, cases, record

FOLDER = Path("build/recordings")

NAMED, TURN, SHIFT, CLOCK = 38 / 40, 0.1, 1e-3, 5e-3
"""Asked: share of moved cameras that are named; median errors of their poses [deg, m]; largest error of clocks [s]."""


def main(count: int, first: int) -> int:
    FOLDER.mkdir(parents=True, exist_ok=True)
    found = []
    with tempfile.TemporaryDirectory() as folder:
        opened = _program(Path(folder))
        pairs = list(cases(count, list(opened.workspace.cameras), seed=0))[first:]
        for pair in pairs:
            missing = {name: truth for name, truth in pair.items() if not _kept(name).exists()}
            for name, one in _tried(opened, missing, Path(folder)):
                _kept(name).write_text(json.dumps(one), encoding="utf-8")
            for name in pair:
                found.append(json.loads(_kept(name).read_text(encoding="utf-8")))
                print(name, found[-1]["named"], flush=True)
    return _summed_up(found)


def _kept(name: str) -> Path:
    return FOLDER / f"{name.replace(' ', '-')}.json"


def _program(folder: Path) -> OpenProgram:
    path = folder / "pick.yaml"
    run(["rank", "workspaces/tabletop", "pickup g2", "--program", str(path)])
    return open_program(path)


def _tried(opened: OpenProgram, truths: dict[str, Truth], folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """What is found of recordings that are alike but for cameras that have moved, by name.

    The images of the others are the same bytes in each: they are drawn once, and surveyed once.
    """
    known: dict[str, AuditedCamera] = {}
    if truths:
        look = next(iter(truths.values())).seed
        with closing(CellPictures(opened.program, opened.workspace, look)) as pictures:
            drawn = dict[object, np.ndarray]()
            for name, truth in truths.items():
                path = folder / "run.mcap"
                record(path, pictures, truth, drawn)
                footage = BagFootage(opened.program, opened.workspace, path, {})
                footage.frames = [frame for frame in footage.frames if frame.camera not in known]
                cameras = {**known, **survey(opened.program, opened.workspace, footage, silent)}
                yield name, _found(truth, cameras, opened.workspace.cameras)
                known = {camera: one for camera, one in cameras.items() if camera not in truth.moved}
                path.unlink()


def _found(truth: Truth, cameras: dict[str, AuditedCamera], stated: Mapping[str, Camera]) -> dict[str, Any]:
    """What is found of a recording, beside how it really is."""
    poses, clocks = {}, {}
    for name, one in cameras.items():
        X_FC, found = stated[name].X_FC, stated[name].X_FC if one.pose is None else np.array(one.pose.pose)
        X = inverse(truth.moved.get(name, np.eye(4))) @ inverse(X_FC) @ found
        turn, _ = cv2.Rodrigues(X[:3, :3])
        poses[name] = (float(np.degrees(np.linalg.norm(turn))), float(np.linalg.norm(X[:3, 3])))
        if one.clock.offset is not None:
            clocks[name] = one.clock.offset - truth.offsets.get(name, 0.0)
    wrong = [name for name, one in cameras.items() if one.clock.wrong]
    return {
        "moved": list(truth.moved),
        "named": [name for name, one in cameras.items() if one.moved],
        "poses": poses,
        "clocks": clocks,
        "off": [name for name in truth.offsets if name in clocks],
        "wrong": wrong,
    }


def _summed_up(found: list[dict[str, Any]]) -> int:
    moved, still = ([one for one in found if bool(one["moved"]) is whether] for whether in (True, False))
    named = sum(one["named"] == one["moved"] for one in moved)
    false = sum(bool(one["named"]) for one in still)
    errors = np.array([one["poses"][name] for one in moved for name in one["moved"]])
    clocks = np.abs([error for one in found for error in one["clocks"].values()])
    right = sum(sorted(one["off"]) == sorted(one["wrong"]) for one in found)
    turn, shift = np.median(errors, axis=0)
    print(f"the camera that has moved, and no other, is named in {named} of {len(moved)}")
    print(f"a camera is named in {false} of {len(still)} recordings in which none has moved")
    print(f"poses are mended to {turn:.3f} deg and {1e3 * shift:.2f} mm (median)")
    print(
        f"clocks are found to {1e3 * clocks.max():.1f} ms at worst; the wrong ones are named in {right} of {len(found)}"
    )
    good = named >= NAMED * len(moved) and not false and turn <= TURN and shift <= SHIFT and clocks.max() <= CLOCK
    return 0 if good else 1


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:]]
    sys.exit(main(*[*numbers, *(40, 0)[len(numbers) :]]))

"""Which box of a target a camera does not see."""

from __future__ import annotations

from pathlib import Path

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.show.documents.explanation import Explanation

SCREWS = Path(__file__).parents[2] / "workspaces" / "screws"


def test_the_first_box_that_fails_is_named_if_a_target_has_several() -> None:
    found = open_cell(SCREWS).explain("pickup red1", ways="fastest")
    assert isinstance(found, Explanation)
    (candidate,) = found.candidates
    named = 0
    for sample in candidate.samples:
        for literal, coverage in sample.literals.items():
            boxes = candidate.targets[literal].boxes
            for camera, verdict in coverage.cameras.items():
                failing = [
                    box.name
                    for box, seen in zip(boxes, coverage.boxes, strict=True)
                    if not seen.cameras[camera].covered
                ]
                assert verdict.box == (failing[0] if failing and len(boxes) > 1 else None)
                named += verdict.box is not None
    assert named > 100
    assert "box left is oblique" in str(found)
    assert {box.name for box in candidate.targets["hold(red1)"].boxes} == {"left", "right", "between"}

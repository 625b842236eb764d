"""The document of `calibrate`: what labelled frames say about detectors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from sqrp_cli.camera.detector import Curve
from sqrp_cli.document import Record, WorkspaceDocument, how_many, live
from sqrp_cli.field.calibrating.fit import Judged
from sqrp_cli.records import dataclass


@dataclass(frozen=True, kw_only=True)
class CalibratedDetector(Record):
    """What frames say about one detector."""

    looks: int
    """How often it looked at a box that was in range, in the image and not all hidden."""
    seen: float
    """Share of them in which it said what was true, in 0..1."""
    curve: Curve | None
    """Learned from all frames; null where these are too few."""
    held_out: Judged | None
    """The probabilities of each fifth of the poses by the curve that the others teach, compared with what was seen."""
    limits: Judged | None
    """The limits of the workspace, as probabilities of 1 and 0, compared with what was seen; null without looks."""
    reason: str | None
    """Why there is no curve."""


@dataclass(frozen=True, kw_only=True, repr=False)
class CalibrateDocument(WorkspaceDocument):
    """What `sqrp calibrate` finds."""

    VIEW = "sqrp_cli.show.terminal.audit_view:print_calibration"

    document: Literal["calibrate"] = "calibrate"
    images: int
    """How many were looked at."""
    detectors: Mapping[str, CalibratedDetector]
    """By name, those that looked for anything."""
    patch: str
    """A unified diff that gives the workspace these curves; empty where there are none."""
    cell: Any = live()
    """The cell of the frames, as `open_cell` gives it."""
    looked: Any = live()
    """What each detector saw, by its name, as `calibrating.fit` has it."""

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        curves = [one for one in self.detectors.values() if one.curve is not None]
        return f"{self.workspace}: {how_many(curves, 'curve')} from {self.images} images"

"""`calibrate`: what labelled frames say about detectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sqrp_cli.calibrating.fit import Judged
from sqrp_cli.knowledge.camera.curve import Curve
from sqrp_cli.report.documents.document import Record, WorkspaceDocument


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


@dataclass(frozen=True, kw_only=True)
class CalibrateDocument(WorkspaceDocument):
    """What `sqrp calibrate` finds."""

    images: int
    """How many were looked at."""
    detectors: Mapping[str, CalibratedDetector]
    """By name, those that looked for anything."""
    patch: str
    """A unified diff that gives the workspace these curves; empty where there are none."""

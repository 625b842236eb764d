"""Doubtful values in robot descriptions: warnings, and corrected limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.robot.urdf import Inertial, UrdfJoint, UrdfLink, UrdfModel

MOST_TURNS = 100
"""Largest position limit of a turning joint [turns]; larger ones mean "no limit" and are clipped to this."""

NAMED = 5
"""Most links or joints that a warning names."""

LEAST_MOMENT = 1e-9
"""Moments of inertia below this are rounding [kg m^2]."""

ROUNDING = 1e-4
"""Share of the largest principal moment by which another may be below 0: exported moments are rounded."""

TRIANGLE_ROUNDING = 0.05
"""Share by which a principal moment may be above the sum of the others, likewise."""

_Named = TypeVar("_Named", UrdfLink, UrdfJoint)


def as_meant(model: UrdfModel) -> UrdfModel:
    """The description with limits of at most `MOST_TURNS`, and warnings about all doubtful values.

    That many turns are as good as no limit, and joint positions keep their precision.
    """
    most = 2 * math.pi * MOST_TURNS
    joints = model.joints.values()
    endless = [j for j in joints if j.type == "revolute" and max(-j.lower, j.upper) > most]
    blocked = [joint for joint in joints if joint.movable and joint.lower == joint.upper and not joint.mimic]
    clipped = {j.name: replace(j, lower=max(j.lower, -most), upper=min(j.upper, most)) for j in endless}
    clips = f"position limits of {MOST_TURNS} turns ({most:.0f} rad) or more, which are taken as {MOST_TURNS} turns"
    warnings = [
        *_warning("no-limit", "joint", endless, clips, 'a joint without limits has the type "continuous"'),
        *_warning("no-motion", "joint", blocked, "a `lower` that is its `upper` limit, and cannot move",
                  'state both limits, or make it a joint of the type "fixed"'),
        *_doubtful_inertias(model),
    ]  # fmt: skip
    return replace(model, joints={**model.joints, **clipped}, warnings=tuple(warnings))


def _warning(code: str, kind: str, found: Sequence[_Named], doubt: str, mend: str) -> Iterator[Problem]:
    """One warning that names all links or joints found, at the place of the first; none without any."""
    if found:
        names = ", ".join(f"`{item.name}`" for item in found[:NAMED])
        more = f" and {len(found) - NAMED} more" if len(found) > NAMED else ""
        message = f"{kind}{'s' * (len(found) > 1)} {names}{more} {'have' if len(found) > 1 else 'has'} {doubt}"
        yield Problem(code, message, found[0].place, severity="warning", mend=mend)


def _doubtful_inertias(model: UrdfModel) -> Iterator[Problem]:
    """Warnings about moving solid bodies with a mass of 0, and about impossible moments of inertia.

    No principal moment of a body is below 0 or above the sum of the others (the triangle rule). Exported products of
    inertia sometimes break it, so it is not an error. Links fixed to each other make one body.
    """
    stated = [(link, link.inertial) for link in model.links.values() if link.inertial is not None]
    sound = {model.root, *(model.body_of[link.name] for link, inertial in stated if inertial.mass > 0.0)}
    weightless = [link for link, _ in stated if link.collision and model.body_of[link.name] not in sound]
    impossible = [link for link, inertial in stated if _breaks_triangle_rule(inertial)]
    doubt = "a mass of 0 kg although solid and moving, simulated as 500 kg/m^3"
    yield from _warning("no-mass", "link", weightless, doubt, "state the mass, usually 0.01 kg to 1000 kg")
    doubt = "a principal moment of inertia below 0 or above the sum of the other two, which no body has"
    yield from _warning("doubtful-inertia", "link", impossible, doubt, "check units and signs of <inertia>, in kg m^2")


def _breaks_triangle_rule(inertial: Inertial) -> bool:
    least, middle, most = np.linalg.eigvalsh(inertial.inertia).tolist()
    too_large = most > (1.0 + TRIANGLE_ROUNDING) * (least + middle) + LEAST_MOMENT
    return bool(too_large or least < -ROUNDING * max(most, 0.0) - LEAST_MOMENT)

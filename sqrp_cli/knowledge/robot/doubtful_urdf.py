"""What a robot description says that can be, but is hardly meant: warnings, and limits as they are taken instead."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.robot.urdf import Inertial, UrdfJoint, UrdfLink, UrdfModel

MOST_TURNS = 100
"""Position limits of a turning joint beyond so many turns are meant as none, and taken as so many."""

NAMED = 5
"""Links or joints that a warning names."""

LEAST_MOMENT = 1e-9
"""Moments of inertia below this are rounding [kg m^2]."""

ROUNDING = 1e-4
"""Share of the largest principal moment by which another may be below 0, as exported moments are rounded."""

TRIANGLE_ROUNDING = 0.05
"""Share by which a principal moment may be above the sum of the others, likewise."""

_Named = TypeVar("_Named", UrdfLink, UrdfJoint)


def as_meant(model: UrdfModel) -> UrdfModel:
    """The description with limits of no more than `MOST_TURNS`, and warnings about all that is doubtful.

    So many turns are as good as no limit, and numbers keep their precision.
    """
    most = 2 * math.pi * MOST_TURNS
    joints = model.joints.values()
    endless = [j for j in joints if j.type == "revolute" and max(-j.lower, j.upper) > most]
    blocked = [joint for joint in joints if joint.movable and joint.lower == joint.upper and not joint.mimic]
    clipped = {j.name: replace(j, lower=max(j.lower, -most), upper=min(j.upper, most)) for j in endless}
    told = f"position limits of {MOST_TURNS} turns ({most:.0f} rad) or more, which are taken as {MOST_TURNS} turns"
    warnings = [
        *_warning("no-limit", "joint", endless, told, 'a joint without limits has the type "continuous"'),
        *_warning("no-motion", "joint", blocked, "a `lower` that is its `upper` limit, and cannot move",
                  'state both limits, or make it a joint of the type "fixed"'),
        *_doubtful_inertias(model),
    ]  # fmt: skip
    return replace(model, joints={**model.joints, **clipped}, warnings=tuple(warnings))


def _warning(code: str, kind: str, found: Sequence[_Named], told: str, mend: str) -> Iterator[Problem]:
    """One warning that names all of the links or joints it is about, at the first of them; none if there are none."""
    if found:
        names = ", ".join(f"`{item.name}`" for item in found[:NAMED])
        more = f" and {len(found) - NAMED} more" if len(found) > NAMED else ""
        message = f"{kind}{'s' * (len(found) > 1)} {names}{more} {'have' if len(found) > 1 else 'has'} {told}"
        yield Problem(code, message, found[0].place, severity="warning", mend=mend)


def _doubtful_inertias(model: UrdfModel) -> Iterator[Problem]:
    """Warnings about solid bodies that move and have a mass of 0, and about moments that no mass could have.

    Of the principal moments of any body, none is below 0 or above the sum of the others (the triangle rule). Exported
    products of inertia break that now and then, so that it is no error. Links fixed to each other make one body.
    """
    stated = [(link, link.inertial) for link in model.links.values() if link.inertial is not None]
    sound = {model.root, *(model.body_of[link.name] for link, inertial in stated if inertial.mass > 0.0)}
    weightless = [link for link, _ in stated if link.collision and model.body_of[link.name] not in sound]
    impossible = [link for link, inertial in stated if _breaks_triangle_rule(inertial)]
    told = "a mass of 0 kg in spite of moving and being solid, simulated as 500 kg/m^3"
    yield from _warning("no-mass", "link", weightless, told, "state the mass, usually 0.01 kg to 1000 kg")
    told = "a principal moment of inertia below 0 or above the sum of the other two, as no body has"
    yield from _warning("doubtful-inertia", "link", impossible, told, "check units and signs of <inertia>, in kg m^2")


def _breaks_triangle_rule(inertial: Inertial) -> bool:
    least, middle, most = np.linalg.eigvalsh(inertial.inertia).tolist()
    too_large = most > (1.0 + TRIANGLE_ROUNDING) * (least + middle) + LEAST_MOMENT
    return bool(too_large or least < -ROUNDING * max(most, 0.0) - LEAST_MOMENT)

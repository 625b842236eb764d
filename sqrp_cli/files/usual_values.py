"""Usual ranges of numbers in files. A number outside gets a warning and is used unchanged.

The ranges are generous: a working cell should get no warning.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from math import radians
from typing import NamedTuple

from sqrp_cli.errors import Problem
from sqrp_cli.files import units
from sqrp_cli.files.source import KeyPath, SourceDocument
from sqrp_cli.files.units import Dimension, in_unit, meant_instead, read_quantity
from sqrp_cli.records import dataclass


@dataclass(frozen=True)
class Usual:
    """The usual range of a field."""

    at: str
    """Its dotted path, `*` for any key or index.

    `*{key}` only for entries in which that key has another value than `false` and `world`. The first match counts.
    """
    least: float
    most: float
    """In SI units."""
    dimension: Dimension | None
    why: str
    """Why a value beyond them is doubtful."""

    def __str__(self) -> str:
        return f"{in_unit(self.least, self.dimension)} to {in_unit(self.most, self.dimension)}"


_ANYWHERE = "cells are not larger"
_ANGLE_WHY = "more is as good as the rest of it after whole turns"
_TURN = radians(360.0) + 1e-9
_HOURS = "motions with less take hours, and no arm does more"
_SHAPES = ("box.*", "sphere", "cylinder.radius", "cylinder.length", "capsule.radius", "capsule.length")
_STATED_PLACES = ("objects.*.pose", "fixtures.*.pose", "cameras.*.pose", "robot.base")
_INNER_PLACES = ("robot.tool.pose", "robot.tool.frame", "robot.tool.boxes.*.pose", "objects.*.parts.*.pose")


def _each(paths: str, least: float, most: float, dimension: Dimension | None, why: str) -> tuple[Usual, ...]:
    """The same range for several paths, with blanks between them."""
    return tuple(Usual(path, least, most, dimension, why) for path in paths.split())


FIELD_OF_VIEW = Usual(
    "cameras.*.image.horizontal_fov",
    radians(1.0),
    radians(170),
    units.ANGLE,
    "a wider lens needs `fx` and `distortion: {model: equidistant}`",
)
"""Also applies to the angle that follows from `fx` or a calibration."""

FISHEYE_VIEW = Usual("", radians(1.0), radians(360), units.ANGLE, "an equidistant lens shows all around at most")
"""The angle that follows from `fx` of an equidistant lens, without its distortion; in no file."""

MOST_STRETCHED = 2.0  # largest usual ratio of a camera's two focal lengths

WORKSPACE = (
    *(
        Usual(f"robot.limits.{limit}{each}", least, most, dimension, _HOURS)
        for limit, least, most, dimension in (
            ("velocity", 0.005, 30.0, units.ANGULAR_SPEED),
            ("acceleration", 0.02, 500.0, units.ANGULAR_ACCELERATION),
            ("jerk", 0.1, 50_000.0, units.ANGULAR_JERK),
            ("stop_acceleration", 0.02, 1000.0, units.ANGULAR_ACCELERATION),
            ("stop_jerk", 0.1, 100_000.0, units.ANGULAR_JERK),
        )
        for each in ("", ".*")
    ),
    Usual("robot.markers.*.side", 2e-3, 0.5, units.LENGTH, "markers on links are not smaller or larger"),
    Usual("robot.tool.boxes.*.size.*", 1e-4, 3.0, units.LENGTH, "tools are not larger"),
    Usual("detectors.*.distance.*", 0.0, 100.0, units.LENGTH, "no detector works further away"),
    Usual("detectors.*.max_incidence", radians(5), radians(90), units.ANGLE, "less is seldom met, more is from behind"),
    Usual("detectors.*.min_pixels", 1.0, 5000.0, units.PIXELS, "less shows nothing, images are not larger"),
    Usual("detectors.*.min_visible", 0.02, 1.0, units.SHARE, "shares are only known to 2 points"),
    Usual("cameras.*{frame}.pose.position.*", -3.0, 3.0, units.LENGTH, "no link carries a camera further away"),
    Usual("cameras.*.pose.look_at.*", -200.0, 200.0, units.LENGTH, _ANYWHERE),
    *_each("cameras.*.image.width cameras.*.image.height", 64, 20_000, None, "images are not smaller or larger"),
    FIELD_OF_VIEW,
    Usual("cameras.*.near", 1e-3, 10.0, units.LENGTH, "cameras see from nearer on"),
    Usual("cameras.*.far", 0.05, 200.0, units.LENGTH, "cameras see neither that near only nor so far"),
    Usual("cameras.*.rate", 0.1, 2000.0, units.FREQUENCY, "cameras are neither slower nor faster"),
    Usual("cameras.*.latency", 0.0, 2.0, units.TIME, "images are at hand before that"),
    Usual("cameras.*.exposure", 0.0, 0.2, units.TIME, "shutters are open for milliseconds"),
    Usual("cameras.*.gain", 0.02, 50.0, None, "images are neither that dark nor that bright"),
    Usual("lights.*.intensity", 1e-3, 50.0, None, "1 makes a white surface as bright as an image can show"),
    *_each("lights.*.position.* lights.*.look_at.*", -50.0, 50.0, units.LENGTH, _ANYWHERE),
    Usual("objects.*{fixed}.size.*", 1e-4, 50.0, units.LENGTH, "fixtures are not larger"),
    Usual("objects.*.size.*", 1e-4, 5.0, units.LENGTH, "what an arm moves is not larger"),
    Usual("objects.*.pose.depth", 0.0, 1.0, units.LENGTH, "fingers are not longer"),
    *(
        Usual(f"objects.*{fixed}.parts.*.{shape}", 5e-5, largest, units.LENGTH, "parts are not larger")
        for fixed, largest in (("{fixed}", 50.0), ("", 5.0))
        for shape in _SHAPES
    ),
    *_each("objects.*.parts.*.scale objects.*.parts.*.scale.*", -1e3, 1e3, None, "meshes in kilometres are rare"),
    *(Usual(f"{place}.position.*", -50.0, 50.0, units.LENGTH, _ANYWHERE) for place in _STATED_PLACES),
    *(Usual(f"{place}.position.*", -25.0, 25.0, units.LENGTH, "nothing is so large") for place in _INNER_PLACES),
    *(
        Usual(f"{place}.rpy.*", -_TURN, _TURN, units.ANGLE, _ANGLE_WHY)
        for place in (*_STATED_PLACES, *_INNER_PLACES)
    ),
    Usual("objects.*.pose.yaw", -_TURN, _TURN, units.ANGLE, _ANGLE_WHY),
    *_each("tasks.*.min_q_avg tasks.*.min_q_eoi", 1e-3, 1.0, units.SHARE, "every candidate reaches that"),
    Usual("tasks.*.max_time", 0.1, 3600.0, units.TIME, "no motion is shorter, and none takes hours"),
    Usual("tasks.*.max_delay", 1e-3, 60.0, units.TIME, "no camera is faster, and a fault is sought sooner"),
    Usual("padding", 0.0, 0.5, units.LENGTH, "no motion keeps so far from everything"),
)  # fmt: skip
"""Usual values of a workspace file."""

SKILL = (
    Usual("waypoints.*.depth", 0.0, 1.0, units.LENGTH, "fingers are not longer"),
    *_each("waypoints.*.retreat waypoints.*.raise", 0.0, 3.0, units.LENGTH, "arms do not reach so far"),
    Usual("waypoints.*.offset.*", -3.0, 3.0, units.LENGTH, "arms do not reach so far"),
    Usual("waypoints.*.pose.position.*", -50.0, 50.0, units.LENGTH, _ANYWHERE),
    Usual("waypoints.*.pose.rpy.*", -_TURN, _TURN, units.ANGLE, _ANGLE_WHY),
    Usual("primitives.*{joint_move}.speed", 0.01, 1.0, units.SHARE, "a motion would take a hundred times as long"),
    *_each("primitives.*{straight_move}.speed primitives.*{arc}.speed primitives.*{helix}.speed", 1e-4, 5.0,
           units.SPEED, "arms move neither so slowly nor so fast"),
    Usual("primitives.*.turn_speed", 1e-2, 20.0, units.ANGULAR_SPEED, "tools turn neither so slowly nor so fast"),
    Usual("primitives.*.advance", -0.5, 0.5, units.LENGTH, "screws are shorter"),
    Usual("primitives.*.force", 0.5, 200.0, units.FORCE, "less is noise, more breaks things"),
    *_each("primitives.*.fingers primitives.*.width", 0.0, 0.5, units.LENGTH, "fingers do not open so far"),
    Usual("primitives.*.acceleration", 1e-3, 100.0, units.ACCELERATION, "arms do not"),
    Usual("primitives.*.jerk", 1e-2, 10_000.0, units.JERK, "arms do not"),
    *_each("primitives.*.duration primitives.*.release primitives.*.wait", 0.0, 300.0, units.TIME,
           "no robot waits so long in one motion"),
    *_each("formulas.*.settle faults.*.settle", 0.0, 30.0, units.TIME, "faults would be noticed only after that"),
    *_each("formulas.*.response.retry faults.*.response.retry", 1, 20, None,
           "a robot that failed so often needs a person"),
    Usual("targets.*.boxes.*.margin", -0.1, 0.5, units.LENGTH, "the box would hardly have to do with the object"),
    Usual("targets.*.boxes.*.size.*", 1e-4, 10.0, units.LENGTH, "nothing so large is seen at once"),
    Usual("targets.*.boxes.*.pose.position.*", -50.0, 50.0, units.LENGTH, _ANYWHERE),
    Usual("targets.*.boxes.*.pose.rpy.*", -_TURN, _TURN, units.ANGLE, _ANGLE_WHY),
)  # fmt: skip
"""Usual values of a skill file; a motion parameter counts where a field names it."""

CALIBRATION = _each("image_width image_height width height", 64, 20_000, None, "images are not smaller or larger")
"""Usual values of a camera calibration file."""

HAND_EYE = tuple(
    Usual(f"{owner}.{axis}", -10.0, 10.0, units.LENGTH, "cameras are nearer to the robot")
    for owner in ("transformation", "transform.translation")
    for axis in "xyz"
)
"""Usual values of a hand-eye calibration file."""


def unusual_values(document: SourceDocument, usual: Sequence[Usual]) -> Iterator[Problem]:
    """Warnings about numbers outside the usual ranges, one for each list."""
    warned: set[KeyPath] = set()
    for path, value, row in rows_that_apply(document, usual):
        owner = path[:-1] if isinstance(path[-1], int) else path
        read = read_quantity(value)
        if read is None or row.least <= read.value <= row.most or owner in warned:
            continue
        warned.add(owner)
        message = f"found `{value}`, usual is {row}: {row.why}"
        meant = meant_instead(value, row.dimension, row.least, row.most)
        if meant is None:
            yield warning(document, path, "unusual-value", message, "check the number and its unit")
        else:
            mend = f"write `{meant.stated}` or {meant.value:.4g}"
            yield warning(document, path, "doubtful-unit", f"{message}; {meant}", mend)


def warning(document: SourceDocument, path: KeyPath, code: str, message: str, mend: str) -> Problem:
    """A warning about the value at a path of a document."""
    return replace(document.problem(code, path, message, mend), severity="warning")


class RatedValue(NamedTuple):
    """A value of a document, with the first row that applies to it."""

    path: KeyPath
    value: object
    usual: Usual


def rows_that_apply(document: SourceDocument, usual: Sequence[Usual]) -> Iterator[RatedValue]:
    """The values that a row applies to."""
    found: dict[KeyPath, RatedValue] = {}
    for path, value, row in _walk(document.data, _tree(tuple(usual)), ()):
        used: list[tuple[KeyPath, object]] = [(path, value)]
        if isinstance(value, str) and value.startswith("$"):  # the values of the motion parameter that it names
            motion: KeyPath = ("motion", value[1:])
            entry = document.data["motion"][value[1:]]
            if not isinstance(entry, Mapping):
                used = [(motion, entry)]
            elif "values" in entry:
                used = [((*motion, "values", index), listed) for index, listed in enumerate(entry["values"])]
            else:
                used = [((*motion, key), entry[key]) for key in ("from", "to")]
        for one, stated in used:
            found.setdefault(one, RatedValue(one, stated, row))
    yield from found.values()


class _Rows(dict[str, "_Rows"]):
    """Rows by the steps of their paths, in order."""

    row: Usual | None = None


@cache
def _tree(usual: tuple[Usual, ...]) -> _Rows:
    root = _Rows()
    for row in usual:
        node = root
        for step in row.at.split("."):
            node = node.setdefault(step, _Rows())
        node.row = row
    return root


def _walk(value: object, rows: _Rows, path: KeyPath) -> Iterator[tuple[KeyPath, object, Usual]]:
    if not isinstance(value, Mapping | list):
        if rows.row is not None:
            yield path, value, rows.row
        return
    for key, child in value.items() if isinstance(value, Mapping) else enumerate(value):
        for step, inner in rows.items():
            wanted = step[2:-1] if step.startswith("*") else ""
            meant = not wanted or (isinstance(child, Mapping) and child.get(wanted) not in (None, False, "world"))
            if (step == key) if not step.startswith("*") else meant:
                yield from _walk(child, inner, (*path, key))

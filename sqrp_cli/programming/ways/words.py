"""A way in a few words, such as `left, flipped, 90 deg`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sqrp_cli.knowledge.skill.settings import MotionValue, Reference
from sqrp_cli.knowledge.skill.skill import JointMove, Skill
from sqrp_cli.programming.task import Candidate, in_words

_ORDER = ("left", "right", "no_flip", "flip", "up", "down")
"""The words of branches in the order in which they are said; other values follow."""

_UNSAID = ("no_flip", "up", "direct", "+z", "0")
"""Values that are so usual that only the others are said."""

_SAID = {"flip": "flipped", "down": "elbow down", "home": "via home", "seen": "seen path"}

NOTHING_SPECIAL = "as usual"


def way_in_words(skill: Skill, asked: Mapping[str, MotionValue], found: Mapping[str, MotionValue]) -> str:
    """What a way's parameters say beyond those of its candidate.

    asked, found: the parameters of the candidate, and of the way. Where it chooses for several joint moves, each choice
    for one of them names it.
    """
    values = in_words(skill, found)
    chosen = [(name, values[name]) for name, value in found.items() if asked.get(name) != value]
    chosen.sort(key=lambda pair: _ORDER.index(pair[1]) if pair[1] in _ORDER else len(_ORDER))
    joint_moves = [primitive for primitive in skill.primitives if isinstance(primitive, JointMove)]
    owners = {name: _owners(joint_moves, name) for name, _ in chosen}
    several = len(set().union(*owners.values()) & {move.name for move in joint_moves}) > 1
    said = [_said(name, value, owners[name], several=several) for name, value in chosen if value not in _UNSAID]
    if asked.get("path", "direct") != found.get("path", "direct") == "direct":
        said.append("direct path")
    return ", ".join(said) or NOTHING_SPECIAL


def choice_in_words(asked: Candidate, way: Candidate) -> str:
    """What a way says beyond its candidate, of each step if there are several."""
    if not asked.steps:
        return way_in_words(asked.skill, asked.parameters, way.parameters)
    pairs = enumerate(zip(asked.steps, way.steps, strict=True), 1)
    return ", ".join(f"step {number} {choice_in_words(one, done)}" for number, (one, done) in pairs)


def _said(name: str, value: str, owners: set[str], *, several: bool) -> str:
    """A choice in words. several: whether there are choices for several joint moves."""
    _, _, setting = name.rpartition(".")
    said = f"{setting} {value}" if setting == "solution" else _SAID.get(value, value)
    named = len(owners) == 1 and (several or setting not in (name, "solution"))
    return f"{min(owners)} {said}" if named else said


def _owners(joint_moves: Sequence[JointMove], parameter: str) -> set[str]:
    """Names of what a parameter is for: of the move or waypoint that it is called after, or all joint moves with it."""
    owner, _, _ = parameter.rpartition(".")
    stated = Reference(parameter)
    users = {move.name for move in joint_moves if stated in (move.elbow, move.shoulder, move.wrist, move.via)}
    return {owner} if owner else users

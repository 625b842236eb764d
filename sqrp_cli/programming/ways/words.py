"""A way in a few words, such as `left, flipped, 90 deg`."""

from __future__ import annotations

from collections.abc import Mapping

from sqrp_cli.knowledge.skill.settings import MotionValue
from sqrp_cli.knowledge.skill.skill import Skill
from sqrp_cli.programming.task import in_words

_ORDER = ("left", "right", "no_flip", "flip", "up", "down")
"""The words of branches in the order in which they are said; other values follow."""

_UNSAID = ("no_flip", "up", "direct", "+z", "0")
"""Values that are so usual that only the others are said."""

_SAID = {"flip": "flipped", "down": "elbow down", "home": "via home", "seen": "seen path"}

NOTHING_SPECIAL = "as usual"


def way_in_words(skill: Skill, asked: Mapping[str, MotionValue], found: Mapping[str, MotionValue]) -> str:
    """What a way's parameters say beyond those of its candidate.

    asked, found: the parameters of the candidate, and of the way.
    """
    values = in_words(skill, found)
    chosen = [(name, values[name]) for name, value in found.items() if asked.get(name) != value]
    chosen.sort(key=lambda pair: _ORDER.index(pair[1]) if pair[1] in _ORDER else len(_ORDER))
    said = [_said(name, value) for name, value in chosen if value not in _UNSAID]
    if asked.get("path", "direct") != found.get("path", "direct") == "direct":
        said.append("direct path")
    return ", ".join(said) or NOTHING_SPECIAL


def _said(name: str, value: str) -> str:
    move, _, setting = name.rpartition(".")
    said = f"{setting} {value}" if setting == "solution" else _SAID.get(value, value)
    return f"{move} {said}" if move and setting != "solution" else said

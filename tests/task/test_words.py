from __future__ import annotations

from dataclasses import replace
from math import pi

import pytest

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.skill.settings import Reference
from sqrp_cli.task.grips import way_in_words

FREE = {"object": "g1", "approach_yaw": "any", "elbow": "any", "shoulder": "any", "wrist": "any", "via": "any"}


@pytest.mark.parametrize(
    ("chosen", "words"),
    [
        ({"approach_yaw": pi / 2, "elbow": "up", "shoulder": "left", "wrist": "flip"}, "left, flipped, 90 deg"),
        ({"approach_yaw": 0.0, "elbow": "down", "shoulder": "right", "wrist": "no_flip"}, "right, elbow down"),
        ({"shoulder": "left", "via": "home"}, "left, via home"),
        ({"elbow": "up", "via": "direct"}, "as usual"),
        ({"path": "seen", "shoulder": "left"}, "left, seen path"),
        ({"a1.solution": 7.0}, "solution 7"),
        ({"a1.shoulder": "left"}, "a1 left"),
    ],
)
def test_a_way_is_said_by_what_is_unusual(chosen: dict[str, float | str], words: str, tabletop: Workspace) -> None:
    assert way_in_words(tabletop.skills["pickup"], FREE, {**FREE, **chosen}) == words


def test_where_two_moves_are_free_each_choice_says_for_which_it_is(tabletop: Workspace) -> None:
    pickup = tabletop.skills["pickup"]
    first, *others = pickup.primitives
    own = {setting: Reference(f"{setting}2") for setting in ("elbow", "shoulder", "wrist")}
    second = first.model_copy(update={"name": "a5", **own})
    skill = replace(pickup, primitives=(first, *others[:-1], second))
    asked = {**FREE, "elbow2": "any", "shoulder2": "any", "wrist2": "any", "path": "direct"}
    chosen = {"shoulder": "left", "wrist": "no_flip", "shoulder2": "right", "wrist2": "flip", "elbow2": "down"}
    said = "a1 left, a5 right, a5 flipped, a5 elbow down"
    assert way_in_words(skill, asked, {**asked, **chosen}) == said
    of_both = replace(skill, primitives=(first, *others[:-1], first.model_copy(update={"name": "a5"})))
    assert way_in_words(of_both, FREE, {**FREE, "shoulder": "left", "wrist": "flip"}) == "left, flipped"


def test_a_path_that_was_to_be_seen_and_is_direct_is_said(tabletop: Workspace) -> None:
    asked, found = {**FREE, "path": "seen"}, {**FREE, "shoulder": "left"}
    assert way_in_words(tabletop.skills["pickup"], asked, found) == "left, direct path"
    assert way_in_words(tabletop.skills["pickup"], asked, {**found, "path": "seen"}) == "left"

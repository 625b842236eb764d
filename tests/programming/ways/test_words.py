from __future__ import annotations

from math import pi

import pytest

from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.ways.words import way_in_words

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


def test_a_path_that_was_to_be_seen_and_is_direct_is_said(tabletop: Workspace) -> None:
    asked, found = {**FREE, "path": "seen"}, {**FREE, "shoulder": "left"}
    assert way_in_words(tabletop.skills["pickup"], asked, found) == "left, direct path"
    assert way_in_words(tabletop.skills["pickup"], asked, {**found, "path": "seen"}) == "left"

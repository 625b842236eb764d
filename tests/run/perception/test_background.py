"""The background and the robot's colours, learned from images that are painted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.geometry import Mask
from sqrp_cli.run.image import ImageArray
from sqrp_cli.run.perception.detectors import Background

GREY, WHITE, RED, BLUE = (60, 60, 66), (200, 200, 200), (200, 30, 30), (30, 30, 200)
EVERYWHERE = (slice(0, 60), slice(0, 80))


def area(rows: slice, columns: slice) -> Mask:
    mask = np.zeros((60, 80), dtype=bool)
    mask[rows, columns] = True
    return mask


ROBOT, WATCHED, OTHER = (
    area(slice(0, 60), slice(20, 60)),
    area(slice(10, 20), slice(30, 40)),
    area(slice(40, 50), slice(30, 40)),
)


def painted() -> ImageArray:
    """A grey robot before a white wall; before the robot a red thing, which is watched, and a blue one."""
    image = np.empty((60, 80, 3), dtype=np.uint8)
    for mask, color in ((~ROBOT, WHITE), (ROBOT, GREY), (WATCHED, RED), (OTHER, BLUE)):
        image[mask] = color
    return image


@pytest.mark.parametrize("moving", [False, True])
def test_what_stands_before_the_robot_does_not_colour_it(*, moving: bool) -> None:
    image = painted()
    background = Background(image, ROBOT, WATCHED, OTHER, moving=moving)
    _, _, robot_colored = background.compared(image, EVERYWHERE, "red")
    assert (robot_colored == ROBOT & ~WATCHED & ~OTHER).all()


def test_the_background_is_what_neither_robot_nor_watched_thing_covers() -> None:
    image = painted()
    background = Background(image, ROBOT, WATCHED, OTHER, moving=False)
    assert background.matches(image, EVERYWHERE)[~ROBOT].all()
    assert not background.matches(image, EVERYWHERE)[WATCHED].any()


def test_of_a_moving_camera_the_colours_around_robot_and_objects_are_the_background() -> None:
    image = painted()
    image[0:5, 0:5] = RED  # a movable object of the watched one's colour
    aside = area(slice(0, 5), slice(0, 5))
    background = Background(image, ROBOT, WATCHED, OTHER | aside, moving=True)
    assert (background.matches(image, EVERYWHERE) == ~ROBOT & ~aside).all()


@pytest.mark.parametrize("moving", [False, True])
def test_a_shade_on_a_background_of_its_colour_has_its_hue(*, moving: bool) -> None:
    image = painted()
    image[50:60, 0:10] = RED
    background = Background(image, ROBOT, WATCHED, OTHER, moving=moving)
    red = area(slice(50, 60), slice(0, 10))
    assert (background.compared(image, EVERYWHERE, "red")[1] >= red).all()
    shaded = image.copy()
    shaded[50:60, 0:5] = (120, 18, 18)
    told = background.compared(shaded, EVERYWHERE, "red")[1]
    assert told[50:60, 5:10].all()
    assert told[50:60, 0:5].all() != moving  # of a moving camera only the colours themselves are known
    assert not background.compared(shaded, EVERYWHERE, "blue")[1][~OTHER].any()


def test_what_a_watched_thing_covers_is_guessed_again_once_the_robot_has_left_its_surroundings() -> None:
    background = Background(painted(), ROBOT, WATCHED, OTHER, moving=False)
    wall, crop = np.full((60, 80, 3), WHITE, dtype=np.uint8), (slice(5, 25), slice(25, 45))
    wall[:, 20:60] = BLUE
    gone = wall.copy()
    gone[WATCHED] = RED
    background.learn(gone, WATCHED)
    assert not background.matches(wall, crop)[5:15, 5:15].any()
    assert background.compared(wall, crop, "red")[0].all()
    assert not background.matches(gone, crop)[5:15, 5:15].any()

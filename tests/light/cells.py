"""Random cells in which parts, obstacles, the table and panels around it share two colours."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tests.random_cell import Crowd, random_cell

PAINTS = ("green", "red", "blue", "yellow", "orange", "purple", "cyan")
"""Colours that detectors find."""

IMAGE = "{width: 640, height: 480, horizontal_fov: 45 deg}"
"""Smaller images than those of starters, so that hundreds of runs do not take a day."""

PLAIN = {"cube": 0.0, "block": 0.2, "table": 0.6}
"""How often each type of object is grey."""

PANELS, AWAY, WIDE = 3, 1.2, 0.8
"""How many panels stand around the table at most, how far from the robot, and how wide they are [m]."""


def coloured_cell(folder: Path, seed: int) -> str:
    """Make a workspace whose contents, colours and cameras depend on the seed alone; returns a task for it."""
    rng = np.random.default_rng((seed, 27))
    random_cell(folder, Crowd(seed, int(rng.integers(6, 13)), int(rng.integers(2, 5))))
    paints = rng.permutation(PAINTS)[:2].tolist()
    file = folder / "workspace.yaml"
    text = file.read_text(encoding="utf-8")

    def painted(match: re.Match[str]) -> str:
        color = "grey" if rng.random() < PLAIN[match[1]] else rng.choice(paints)
        return f"type: {match[1]}, color: {color}"

    text = re.sub(r"type: (\w+), color: \w+", painted, text)
    text = re.sub(r"\{width: .*\}", IMAGE, text)
    panels = "".join(_panel(rng, number, paints) for number in range(int(rng.integers(0, PANELS + 1))))
    text = re.sub(r"(?m)^(  table: .*\n)", lambda table: table[0] + panels, text)
    color = str(rng.choice(re.findall(r"type: cube, color: (\w+)", text)))
    text = text[: text.index("tasks:")] + f"tasks:\n  - {{task: pickup {color}}}\n"
    file.write_text(text, encoding="utf-8")
    return f"pickup {color}"


def _panel(rng: np.random.Generator, number: int, paints: list[str]) -> str:
    """An upright panel that faces the robot, as a line of a workspace file."""
    turn = (number + rng.uniform(0.2, 0.8)) * 2 * np.pi / PANELS
    color, height = rng.choice(paints), rng.uniform(0.3, 0.9)
    place = f"[{AWAY * np.cos(turn):.3f}, {AWAY * np.sin(turn):.3f}, {height / 2:.3f}], rpy: [0, 0, {turn:.3f}]"
    size = f"[0.03, {WIDE}, {height:.3f}]"
    return f"  panel{number}: {{type: panel, color: {color}, size: {size}, pose: {{position: {place}}}, fixed: true}}\n"

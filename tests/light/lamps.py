"""Lights drawn at random for a cell: sunlight and lamps of any strength, light from everywhere, and gains of cameras."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

MOST_LAMPS = 2


def light_up(folder: Path, seed: int) -> None:
    """Add lights and gains to a workspace, depending on the seed alone."""
    rng = np.random.default_rng((seed, 28))
    lines = [f"  room: {{intensity: {rng.uniform(0.0, 0.3):.3f}}}"]
    for number in range(int(rng.integers(1, MOST_LAMPS + 1))):
        height, turn = np.radians(rng.uniform(25, 85)), rng.uniform(-np.pi, np.pi)
        way = np.array([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)])
        strength = float(np.exp(rng.uniform(np.log(0.15), np.log(4.0))))
        if rng.random() < 0.6:
            lines.append(f"  sun{number}: {{intensity: {strength:.3f}, direction: {_list(-way)}}}")
            continue
        aim, away = np.array([rng.uniform(-0.3, 0.6), rng.uniform(-0.4, 0.4), 0.0]), rng.uniform(1.0, 2.0)
        place = f"position: {_list(aim + away * way)}, look_at: {_list(aim)}, beam: {rng.uniform(50, 120):.0f} deg"
        lines.append(f"  lamp{number}: {{intensity: {strength * away**2:.3f}, {place}}}")
    file = folder / "workspace.yaml"
    text = file.read_text(encoding="utf-8")
    text = re.sub(r"(\n +)(rate: )", lambda match: f"{match[1]}gain: {np.exp(rng.uniform(-0.5, 0.5)):.3f}{match[0]}", text)
    file.write_text(text.rstrip() + "\nlights:\n" + "\n".join(lines) + "\n", encoding="utf-8")


def _list(values: np.ndarray) -> str:
    return "[" + ", ".join(f"{value:.4f}" for value in values) + "]"

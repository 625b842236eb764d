"""What comes too close to what, and how close is too close."""

from __future__ import annotations

from dataclasses import dataclass

CLEARANCE = 1e-3
"""Distance that the arm keeps from everything [m]; from fixed objects the workspace's padding comes on top."""

Pairs = frozenset[tuple[str, str]]
"""Pairs of names of links or objects, each in alphabetical order."""


def pair(first: str, second: str) -> tuple[str, str]:
    """Two names in alphabetical order."""
    return (first, second) if first < second else (second, first)


@dataclass(frozen=True)
class Contact:
    """Two things that come closer than the clearance (or could, by less than a resolution of motion).

    first, second: names of links or objects, the outer one of the arm first. s: where on the path, in [0, 1].
    clearance: distance that they have to keep [m].
    """

    first: str
    second: str
    s: float = 0.0
    clearance: float = CLEARANCE

    def __str__(self) -> str:
        if self.clearance > CLEARANCE:
            return f"{self.first} comes closer to {self.second} than {self.clearance:.3g} m"
        return f"{self.first} hits {self.second}"

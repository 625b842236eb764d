"""Kinds of detectors that installed packages bring: entry points of the group `sqrp.detectors`.

Only names are read here; nothing of a package runs before it is to look at an image.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points

GROUP = "sqrp.detectors"
"""The group of entry points: the name of each is a kind of detector, its object makes one for a camera."""


@cache
def installed_detectors() -> Mapping[str, EntryPoint]:
    """The entry point of each kind, by its name; of several packages with one name, the first by the package's name."""
    found = sorted(entry_points(group=GROUP), key=lambda one: (one.name, package_of(one)), reverse=True)
    return {one.name: one for one in found}


def package_of(entry: EntryPoint) -> str:
    """The name of the package that brings an entry point."""
    return entry.dist.name if entry.dist is not None else entry.module

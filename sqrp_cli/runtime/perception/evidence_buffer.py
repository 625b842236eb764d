"""The images of an attempt by when they were taken, however late each of them arrives.

What an image shows counts from the moment at which it was taken until its camera takes the next one, at most for some
frame periods. An image that is under way says nothing yet: the one before it no longer counts, so that the cameras
whose images are there decide alone for as long. A moment is complete once no image that was taken by then is under way.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.logic.truth import Truth
from sqrp_cli.runtime.perception.detections import Sighting

FRESH_PERIODS = 1.5
"""What an image shows counts for this many frame periods of its camera."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """The moment at which images were taken.

    t: on the cell's clock [s]. tau: of the step's motion [s], None before it. truths: of all atoms, for checking only.
    """

    t: float
    tau: float | None
    truths: Mapping[str, bool]


@dataclass(frozen=True, eq=False)
class Moment:
    """What is there of a moment at which images were taken.

    sightings: what counts then, one of a camera at most. told: whether any image of the moment itself has arrived.
    complete: whether all that were taken by then have.
    """

    exposure: Exposure
    sightings: tuple[Sighting, ...]
    told: bool
    complete: bool


@dataclass(frozen=True, eq=False)
class Look:
    """What is known of a moment at which images were taken.

    t: on the cell's clock [s]. tau: of the step's motion [s], None before it. values: of atoms. complete: whether no
    image that was taken by then is under way any more, so that nothing that is known will change.
    """

    t: float
    tau: float | None
    values: Mapping[str, Truth]
    complete: bool


@dataclass(frozen=True, eq=False)
class _Page:
    """images: of one moment, by camera; None for those that are under way."""

    exposure: Exposure
    images: dict[str, Sighting | None] = field(default_factory=dict)

    @property
    def t(self) -> float:
        return self.exposure.t


class Album:
    """The images that cameras took since a time; empty at first."""

    def __init__(self, cameras: Mapping[str, Camera]) -> None:
        self._lifetimes = {name: FRESH_PERIODS / camera.rate for name, camera in cameras.items()}
        self._pages: list[_Page] = []
        self._completed = -float("inf")

    def forget(self, t: float) -> None:
        """Drop all images that have arrived, and those under way that were taken before time t [s]."""
        self._pages = [
            _Page(page.exposure, {name: None for name, image in page.images.items() if image is None})
            for page in self._pages
            if page.t >= t - 1e-9
        ]

    def take(self, exposure: Exposure, cameras: Collection[str]) -> None:
        """Cameras have taken an image each, later than all before."""
        self._pages.append(_Page(exposure, dict.fromkeys(cameras)))

    def add(self, sighting: Sighting) -> Exposure | None:
        """An image has arrived. Returns when it was taken, None if that was dropped."""
        for page in reversed(self._pages):
            if page.t == sighting.t and sighting.camera in page.images:
                page.images[sighting.camera] = sighting
                return page.exposure
        return None

    def moments(self) -> list[Moment]:
        """What is there of each moment that was not complete before, up to the last of which an image has arrived."""
        told = [any(image is not None for image in page.images.values()) for page in self._pages]
        count = max((index + 1 for index, is_told in enumerate(told) if is_told), default=0)
        found = []
        complete = True
        for index, page in enumerate(self._pages[:count]):
            complete = complete and None not in page.images.values()
            if page.t > self._completed:
                found.append(Moment(page.exposure, self._counting(index), told[index], complete))
        self._completed = max((moment.exposure.t for moment in found if moment.complete), default=self._completed)
        oldest = self._completed - max(self._lifetimes.values())
        self._pages = [page for page in self._pages if page.t > oldest]
        return found

    def _counting(self, index: int) -> tuple[Sighting, ...]:
        """The sightings that count at the moment of a page."""
        now = self._pages[index].t
        last: dict[str, Sighting | None] = {}
        for page in self._pages[: index + 1]:
            last.update(page.images)
        return tuple(s for name, s in last.items() if s is not None and now - s.t < self._lifetimes[name])

"""What all cameras together say about each atom."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from sqrp_cli.logic.truth import Truth
from sqrp_cli.program import ProgramTarget
from sqrp_cli.runtime.perception.sighting import Sighting


@dataclass(frozen=True)
class Finding:
    """What is known of an atom.

    truth: UNKNOWN where too few cameras can judge it, or as many contradict. votes: of each camera that can judge it.
    """

    truth: Truth
    votes: Mapping[str, Truth]

    @property
    def conflict(self) -> bool:
        """Whether cameras contradict each other."""
        return len(set(self.votes.values())) > 1


def fuse(atom: str, target: ProgramTarget, sightings: Iterable[Sighting]) -> Finding:
    """The finding on an atom: the value that most cameras give, if they are as many as the target asks for."""
    votes = {sighting.camera: sighting.truth(atom) for sighting in sightings}
    votes = {camera: vote for camera, vote in votes.items() if vote != Truth.UNKNOWN}
    yes, no = (sum(vote == value for vote in votes.values()) for value in (Truth.TRUE, Truth.FALSE))
    if max(yes, no) < target.cameras or yes == no:
        return Finding(Truth.UNKNOWN, votes)
    return Finding(Truth.TRUE if yes > no else Truth.FALSE, votes)

"""What all cameras together say about each atom."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.runtime.perception.detections import Sighting


@dataclass(frozen=True)
class Finding:
    """What is known of an atom.

    truth: UNKNOWN where too few cameras can judge it, or as many contradict. votes: of each camera that can judge it.
    conflict: whether images that were taken at the same time contradict each other.
    """

    truth: Truth
    votes: Mapping[str, Truth]
    conflict: bool


def fuse(atom: str, target: ProgramTarget, sightings: Iterable[Sighting]) -> Finding:
    """The finding on an atom: the value that most cameras give, if they are as many as the target asks for."""
    judged = [(sighting, vote) for sighting in sightings if (vote := sighting.truth(atom)) != Truth.UNKNOWN]
    votes = {sighting.camera: vote for sighting, vote in judged}
    conflict = len({(sighting.t, vote) for sighting, vote in judged}) > len({sighting.t for sighting, _ in judged})
    yes, no = (sum(vote == value for vote in votes.values()) for value in (Truth.TRUE, Truth.FALSE))
    if max(yes, no) < target.cameras or yes == no:
        return Finding(Truth.UNKNOWN, votes, conflict)
    return Finding(Truth.TRUE if yes > no else Truth.FALSE, votes, conflict)

"""Which links of a robot without an SRDF touch by design, found by trying many positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.programming.motion.collision.collision import CollisionScene
from sqrp_cli.programming.motion.collision.contact import Pairs, pair

SAMPLES = 200
"""Joint positions that are tried, spread over the limits of the joints."""

ALWAYS = 0.95
"""Share of the positions in which a pair must touch to count as always touching."""


@dataclass(frozen=True)
class SelfContacts:
    """Pairs of links, neither neighbours nor rigidly connected, by how they touch: closer than the clearance.

    at_home: at the home position. always: in `ALWAYS` of the positions tried, or more. Both belong to the robot and
    are not checked. never: in none of them; that proves little, so they are checked all the same.
    """

    at_home: Pairs
    always: Pairs
    never: Pairs

    @property
    def unchecked(self) -> Pairs:
        """The pairs whose contact is not checked."""
        return self.at_home | self.always


def find_self_contacts(model: RobotModel, seed: int) -> SelfContacts:
    """Try `SAMPLES` positions that depend on `seed` alone; joints without limits turn once, slide 1 m either way."""
    scene = CollisionScene(model, ())
    fingers = dict(zip(model.fingers.joints, model.fingers.open.tolist(), strict=True))
    placed = scene.placed(World(frozenset(), {}, None, None, fingers))
    half = np.where(model.turns, np.pi, 1.0)
    lower = np.where(np.isfinite(model.lower), model.lower, model.home - half)
    upper = np.where(np.isfinite(model.upper), model.upper, model.home + half)
    drawn = lower + (upper - lower) * np.random.default_rng(seed).random((SAMPLES, len(model.arm)))
    home, *touching = placed.touching_pairs(np.concatenate([model.home[None], drawn]))
    pairs = frozenset(pair(scene.bodies[i].name, scene.bodies[j].name) for i, j in scene.self_pairs)
    counts = {names: sum(names in found for found in touching) for names in pairs}
    return SelfContacts(
        at_home=home,
        always=frozenset(names for names, count in counts.items() if count >= ALWAYS * SAMPLES),
        never=frozenset(names for names, count in counts.items() if count == 0 and names not in home),
    )

"""Candidates: what a person chooses between, and the task that they are of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.skill.settings import ANY, DIRECT, SEEN, MotionValue, Reference
from sqrp_cli.knowledge.skill.skill import JointMove, Skill

THEN = " then "
"""Between the steps of a task of several."""


@dataclass(frozen=True)
class Candidate:
    """One binding of all parameters of a skill."""

    skill: Skill
    binding: Mapping[str, str]
    """The object of each skill parameter."""
    values: Mapping[str, MotionValue]
    """Of each motion parameter."""
    name: str
    """Its distinguishing name among the candidates of its task, such as `g1` or `g1 lift=200mm`."""
    vias: Mapping[str, Array] = field(default_factory=dict, compare=False)
    """Joint positions that joint moves bend around on their way, shape (k, n) [rad or m], by the primitive's name."""
    branch: Mapping[str, MotionValue] = field(default_factory=dict)
    """Of a way: the branch of inverse kinematics, by the parameters that leave it free; see `plan_motion.Branches`."""
    steps: tuple[Candidate, ...] = ()
    """Of a task of several steps: what is done in each; the candidate stands for all of them, see `whole_task`."""

    @property
    def parameters(self) -> dict[str, MotionValue]:
        """All parameters with their values, objects first; an implicit one only where it is not at its default."""
        unsaid = {p.name: p.values[0] for p in self.skill.motion_parameters if p.implicit}
        return {name: value for name, value in self.all_parameters.items() if unsaid.get(name) != value}

    @property
    def all_parameters(self) -> dict[str, MotionValue]:
        """The same with every implicit one."""
        return {**self.binding, **self.values, **self.branch}

    @property
    def task(self) -> str:
        """The task text for its skill and objects, such as `place g2 tray`."""
        if self.steps:
            return THEN.join(step.task for step in self.steps)
        return " ".join([self.skill.name, *self.binding.values()])

    @property
    def leaves_free(self) -> bool:
        """Whether there may be several ways of doing it: a motion parameter is free, or a path need not be direct."""
        return ANY in self.values.values() or bool(self.open_paths)

    @property
    def open_paths(self) -> frozenset[str]:
        """Names of the joint moves whose paths need not be direct."""
        return frozenset(move.name for move in self._joint_moves if self._path(move) != DIRECT)

    def with_paths(self, vias: Mapping[str, Array]) -> Candidate:
        """The way in which joint moves with open paths bend around vias, by the name of the move, if they have any.

        An open path becomes `seen` or `direct`; where moves share the parameter, the vias of any decide.
        """
        paths: dict[str, MotionValue] = {}
        for move in self._joint_moves:
            if isinstance(move.path, Reference) and self._path(move) != DIRECT:
                paths[move.path.parameter] = SEEN if move.name in vias else paths.get(move.path.parameter, DIRECT)
        return replace(self, values={**self.values, **paths}, vias=vias)

    @property
    def _joint_moves(self) -> list[JointMove]:
        return [primitive for primitive in self.skill.primitives if isinstance(primitive, JointMove)]

    def _path(self, move: JointMove) -> MotionValue:
        """What a move's path is to be; direct unless the candidate or the skill says otherwise."""
        return self.values.get(move.path.parameter, DIRECT) if isinstance(move.path, Reference) else move.path


@dataclass(frozen=True)
class Task:
    """A task with its candidates."""

    text: str
    """As it was given."""
    skill: Skill
    candidates: tuple[Candidate, ...]

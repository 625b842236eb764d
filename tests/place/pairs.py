"""All pairs of cameras, by the definitions of quality and the verdicts of one observer that has every camera."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from sqrp_cli.geometry import Array, Mask
from sqrp_cli.programming.placing.place import Placer
from sqrp_cli.programming.placing.problem import Placing
from sqrp_cli.programming.placing.scenes import JudgedWay, camera_of
from sqrp_cli.programming.sensing.observer import Observer, sees_all


def best_pair(placer: Placer, problem: Placing) -> float:
    """The greatest mean quality of at most two cameras that may stand together, with one way of each candidate."""
    pairs = np.array(list(_allowed(problem)))
    mean = np.zeros(len(pairs))
    for weight, way in zip(problem.weights / problem.weights.sum(), placer.survey.ways, strict=True):
        covered = _covered(placer, way, pairs)
        together = covered[:, 1:] & covered[:, :-1] & (np.diff(way.samples.piece) == 0)
        steps = np.diff(way.samples.t) * together
        interesting = np.array([way.scene.stage.pieces[piece].of_interest for piece in way.samples.piece[:-1]])
        both = ((steps[:, interesting], way.scene.T_eoi), (steps, way.scene.T))
        mean += weight * np.mean([lengths.sum(axis=1) / total for lengths, total in both if total > 0], axis=0)
    return float(mean.max(initial=0.0))


def _allowed(problem: Placing) -> Iterator[tuple[int, int]]:
    """The pairs that may stand together, each camera also with itself."""
    shut = {place for place, _ in problem.blocked}
    hiding = {(hidden.place, option) for hidden in problem.hiding for option in hidden.options}
    spot = problem.spot.tolist()
    free = [option for option in range(problem.count) if spot[option] not in shut]
    yield from ((option, option) for option in free)
    for a, b in combinations(free, 2):
        near = spot[a] == spot[b] or {(spot[a], spot[b]), (spot[b], spot[a])} & problem.apart
        if not near and (spot[a], b) not in hiding and (spot[b], a) not in hiding:
            yield a, b


def _covered(placer: Placer, way: JudgedWay, pairs: Array) -> Mask:
    """Whether each pair covers each sample of a way, shape (pairs, samples)."""
    views = [(placer.survey.views[option.view], placer.survey.lenses[option.lens]) for option in placer.survey.options]
    cameras = [camera_of(f"c{n}", placer.survey.spots[view.spot], view, lens) for n, (view, lens) in enumerate(views)]
    observer = Observer(tuple(cameras), placer.question.cell.observer.solids)
    found: Mask = np.tile(way.required.any(axis=1), (len(pairs), 1))
    for column, boxes in enumerate(observer.verdicts(way.scene.targets, way.states, shares=False)):
        sees = sees_all(boxes).T.astype(int)  # cameras, samples
        count = np.where((pairs[:, 0] == pairs[:, 1])[:, None], sees[pairs[:, 0]], sees[pairs].sum(axis=1))
        found &= (count >= way.scene.targets[column].cameras) | ~way.required[:, column]
    return found

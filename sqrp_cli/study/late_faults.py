"""Why a fault is noticed so late, or never, if it happens when that takes longest: which camera takes it for what."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.figures import LateCause, LateReason
from sqrp_cli.logic.image_time import Onset, Window
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import first_failing, sees_all
from sqrp_cli.skill.target_box import fact_words
from sqrp_cli.study.drop_detection import LONGEST, DropOnset
from sqrp_cli.study.fault_sights import is_lost_by_fingers, watched_faults
from sqrp_cli.study.timeline import PlannedMotion

_PROMPT = 1e-3  # Times up to this explain no delay [s]
_LOOKS = 8  # Other times of each interval at which it is asked which camera sees what would show a fault
_HELD = "camera `{camera}` may take {part} for held {until} because "

_WORDS: dict[LateCause, str] = {
    "line_of_sight": _HELD + "it falls along its line of sight",
    "hardly_apart": _HELD + "tool and part are hardly apart",
    "no_place": _HELD + "it sees no place in which it would lie",
    "not_in_place": _HELD + "it does not see it in its place",
    "fingers_close": "the fingers take {after:.2f} s to close behind {part}",
}
"""What texts say of the causes."""


def why_late(
    cell: Cell, planned: PlannedMotion, fault: str, windows: Sequence[Window], onsets: Sequence[Onset]
) -> LateReason:
    """What takes longest until a fault is noticed, if it happens when that takes longest, or may never be.

    windows: in which images show it. onsets: of each of its intervals, see `analysis.fault_metrics`.
    """
    start, end = np.array([(one.start, one.end) for one in windows]).reshape(-1, 2).T[..., None]
    slowest = []
    for onset in onsets:  # right after a window, too, nothing is shown until the next
        edges = end[(end > onset.shown[0]) & (end < onset.shown[-1])] + 1e-6
        shown = np.concatenate([onset.shown, edges])
        x = np.concatenate([onset.x, np.interp(edges, onset.shown, onset.x)])
        seen = np.where(end > shown, np.maximum(start, shown), np.inf).min(axis=0, initial=np.inf)
        longest = (seen - x).max()
        late = np.flatnonzero(seen - x >= longest - _PROMPT)
        index = late[len(late) // 2]
        slowest.append((float(longest), float(x[index]), float(shown[index]), onset))
    delay, at, shown_at, onset = max(slowest, key=lambda one: one[0])
    parting, total, never = shown_at - at, planned.motion.time, delay == np.inf
    wait, after = delay - parting, None if never else delay
    told = min((one.start for one in planned.formulas if one.fault == fault), default=0.0)
    if at < told - _PROMPT and not never:
        words = f"until {told:.2f} s the part is still where it stood, slipped or not"
        return LateReason(kind="still_there", camera=None, at=at, after=after, words=words)
    if isinstance(onset, DropOnset) and parting > _PROMPT and (shown_at > total if never else parting >= wait):
        part, x, each, _, causes = onset.drops
        index = np.abs(x - at).argmin()
        number = min(range(len(each)), key=lambda n: (-each[n, index], cell.observer.cameras[n].name))
        kind: LateCause = causes[number, index].item()
        after = None if parting > LONGEST else parting
        until = "to the end" if after is None else f"until {after:.2f} s after"
        until += ", when its motion is over," if never and after is not None else ","
        camera = None if kind == "fingers_close" else cell.observer.cameras[number].name
        words = _WORDS[kind].format(camera=camera, part=part, until=until, after=parting)
        return LateReason(kind=kind, camera=camera, at=at, after=after, words=words)
    if wait <= _PROMPT:
        words = "so long take a frame and the latency of the camera that sees it"
        return LateReason(kind="frame", camera=None, at=at, after=after, words=words)
    span = f" for {wait:.2f} s" if not never else f" from {shown_at:.2f} s on" if windows else ""
    kind, camera, words = _unseen(cell, planned, fault, 0.5 * (shown_at + min(at + delay, total)), span)
    return LateReason(kind=kind, camera=camera, at=at, after=after, words=words)


def _unseen(cell: Cell, planned: PlannedMotion, name: str, t: float, span: str) -> tuple[LateCause, str | None, str]:
    """Why no image shows a fault at a time: the cause, the camera that comes nearest, and words; span: how long.

    Nearest is one that sees what would show the fault at most other times, then one that misses the last of its limits.
    """
    targets, faults = watched_faults(planned)
    fault, observer = next(one for one in faults if one.name == name), cell.observer
    by_fingers = is_lost_by_fingers(planned.stage, fault)
    stage = planned.stage.once_lost() if by_fingers else planned.stage
    times = np.sort([t, *(x for one in fault.intervals for x in np.linspace(one.start, one.end, _LOOKS))])
    states, now = stage.states(stage.samples_at(times)), int(times.searchsorted(t))
    for columns in fault.columns:  # of one literal, which any of them shows
        some = [targets[column] for column in columns]
        verdicts = observer.verdicts(some, states, shares=False)
        sees = [sees_all(boxes) for boxes in verdicts]
        if any(one[now].sum() >= target.cameras for one, target in zip(sees, some, strict=True)):
            continue
        who = "no camera sees" if some[0].cameras == 1 else f"fewer than {some[0].cameras} cameras see"
        words = f"{who} whether {fact_words(str(some[0].atom), some[0].boxes, cell.workspace.objects)}{span}"
        if not observer.cameras:
            return "not_seen", None, words
        first, _ = first_failing(verdicts[0], [now])
        causes, culprits, cameras = first.cause[0], first.by[0], observer.cameras
        hiding = {n: observer.solids[culprits[n]].part.parent for n in np.flatnonzero(causes == Cause.HIDDEN).tolist()}
        free = [hiding.get(n) in (None, *stage.model.links) for n in range(len(cameras))]  # but for the robot
        number = max(range(len(cameras)), key=lambda n: (sees[0][:, n].sum(), free[n], causes[n], cameras[n].name))
        name, limit = cameras[number].name, Cause(causes[number])
        if by_fingers and hiding.get(number) in stage.model.fingers.links:
            return "fingers_hide", name, f"closed fingers hide from camera `{name}`{span} that nothing is between them"
        return "not_seen", name, f"{words} (camera `{name}`: {limit.by(observer.by_name(limit, culprits[number]))})"
    return "not_asked", None, f"nothing that would show it is looked for{span}"

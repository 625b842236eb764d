"""Asks detectors of installed packages what an image shows; see `plugin`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from sqrp_cli.geometry import inverse
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.logic.truth import Truth
from sqrp_cli.runtime.perception.detections import NO_OUTLINE, BoxDetection
from sqrp_cli.runtime.perception.expected_view import ExpectedView
from sqrp_cli.runtime.perception.plugin import BoxQuestion, PluginError, complaint, load_detector, named
from sqrp_cli.runtime.perception.vision import filled

Done = TypeVar("Done")


class PluginDetector:
    """A detector of an installed package for one camera."""

    def __init__(self, kind: str, camera: Camera) -> None:
        """Raises PluginError if it cannot be made."""
        self._kind = kind
        make = load_detector(kind)
        self._plugin = self._tried(lambda: make(camera))

    def detect(self, view: ExpectedView, asked: Sequence[tuple[str, TargetBox]]) -> list[BoxDetection]:
        """What is seen of some boxes, each with its atom. Raises PluginError where the package's code fails."""
        questions = [question_about(view, atom, box) for atom, box in asked]
        put = [question for question in questions if question is not None]
        answers = iter(self._checked(self._tried(lambda: self._plugin.look(view.image.copy(), put)), len(put)))
        found = []
        for (_, box), question in zip(asked, questions, strict=True):
            evidence = _EVIDENCE[next(answers)] if question is not None else Truth.UNKNOWN
            outline = NO_OUTLINE if question is None else question.outline
            found.append(BoxDetection(box.name, evidence, float(evidence is not Truth.UNKNOWN), outline))
        return found

    def _tried(self, work: Callable[[], Done]) -> Done:
        try:
            return work()
        except Exception as error:  # it is somebody else's code
            raise PluginError(complaint(self._kind, f"failed: {named(error)}")) from error

    def _checked(self, answers: object, count: int) -> list[bool | None]:
        listed = list(answers) if isinstance(answers, Sequence | np.ndarray) else None
        known = [None if one is None else bool(one) for one in listed or () if isinstance(one, bool | np.bool_ | None)]
        if listed is None or len(listed) != count or len(known) != count:
            message = f"answered {count} questions with {answers!r:.80}; expected one True, False or None for each"
            raise PluginError(complaint(self._kind, message))
        return known


_EVIDENCE: Mapping[bool | None, Truth] = {True: Truth.TRUE, False: Truth.FALSE, None: Truth.UNKNOWN}


def question_about(view: ExpectedView, atom: str, box: TargetBox) -> BoxQuestion | None:
    """The question about a box; None where it is not in the image."""
    outline = view.posed_camera.outline(view.pose(box), box.size)
    if outline is None or view.crop(outline.polygon, 0) is None:
        return None
    obj = view.object_of(atom, box)
    shape = view.posed_camera.shape
    robot = view.robot.mask(shape, (0, 0), outline, without=box.encloses)
    return BoxQuestion(
        atom=atom,
        box=box.name,
        object=None if obj is None else obj.name,
        color=None if obj is None else obj.color,
        marker=view.marker(atom, box),
        size=box.size,
        X_CB=inverse(view.posed_camera.X_WC) @ view.pose(box),
        outline=outline.polygon,
        clear=filled(shape, (0, 0), [outline.corners]) & ~robot,
    )

"""Finished searches of an advice, one file per kind of change, in a folder from which the same advice can resume."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.errors import InputError
from sqrp_cli.geometry import read_only
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.skill.skill import Skill
from sqrp_cli.knowledge.text.json_file import parse_json
from sqrp_cli.program.record import FaultMetrics
from sqrp_cli.programming.advice.advise import Answer
from sqrp_cli.programming.advice.aiming import Aim
from sqrp_cli.programming.advice.change import Advice, CandidateEffect, EffectOnTask, Kind, Margin, Miss, ProposedChange
from sqrp_cli.programming.candidate import THEN
from sqrp_cli.programming.coverage.assessment import Assessment, BlindEnd, WayFigures, WaysFound
from sqrp_cli.programming.coverage.quality import Qualities
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.whole_task import whole_skill
from sqrp_cli.scoring.work.identity import digest_of, program_digest
from sqrp_cli.scoring.work.results import Results
from sqrp_cli.shown import json_line

_RECORDS = {
    record.__name__: record
    for record in (
        Advice,
        Aim,
        Assessment,
        BlindEnd,
        Camera,
        Candidate,
        CandidateEffect,
        ProposedChange,
        EffectOnTask,
        FaultMetrics,
        Margin,
        Miss,
        Qualities,
        WayFigures,
        WaysFound,
    )
}
"""What answers are made of; a file that names anything else is none of ours."""

_TAG = "@"
"""Key of what a JSON object stands for, where it is no mapping."""


@dataclass(frozen=True, eq=False)
class KeptSearches:
    """Answers by kind; see `advise.Kept`."""

    results: Results
    about: tuple[object, ...]
    """All that an answer depends on beside the kind and the program, in numbers and texts."""
    skills: Mapping[str, Skill]
    """Of the workspace, by name: they are not written."""

    def get(self, kind: Kind) -> Answer | None:
        """The answer that was kept; None if there is none, or its file is damaged or another's."""
        text = self.results.get(self._key(kind))
        if text is None:
            return None
        with suppress(InputError, LookupError, TypeError, ValueError, AttributeError):
            document = parse_json(Path("search"), text)
            if document["checksum"] == _checksum(document["answer"]):
                answer: Answer = self._read(document["answer"])
                return answer
        return None

    def keep(self, kind: Kind, answer: Answer) -> None:
        """Keep an answer. Raises InputError where it cannot be written."""
        plain = _plain(answer)
        self.results.keep(self._key(kind), json_line({"answer": plain, "checksum": _checksum(plain)}) + "\n")

    def _key(self, kind: Kind) -> str:
        return digest_of([program_digest(), "advise", kind, _plain(self.about)])

    def _read(self, value: Any) -> Any:  # noqa: ANN401 # a value of any kind
        """What `_plain` made plain."""
        if not isinstance(value, dict):
            return [self._read(entry) for entry in value] if isinstance(value, list) else value
        entries = {name: self._read(entry) for name, entry in value.items() if name != _TAG}
        match value.get(_TAG):
            case None:
                return entries
            case "tuple":
                return tuple(entries["of"])
            case "array":
                return read_only(entries["of"])
            case "float":
                return float(entries["of"])
            case "Skill":
                names = entries["of"].split(THEN)
                return self.skills[names[0]] if len(names) == 1 else whole_skill([self.skills[one] for one in names])
            case name:
                return _RECORDS[name](**entries)


def _plain(value: Any) -> Any:  # noqa: ANN401 # a value of any kind
    """A value in plain lists and numbers; records and arrays say what they are."""
    match value:
        case float() if not isfinite(value):
            return {_TAG: "float", "of": str(value)}
        case None | bool() | int() | float() | str():
            return value
        case np.ndarray():
            return {_TAG: "array", "of": value.tolist()}
        case Skill():
            return {_TAG: "Skill", "of": value.name}
        case tuple():
            return {_TAG: "tuple", "of": [_plain(entry) for entry in value]}
        case list():
            return [_plain(entry) for entry in value]
        case Mapping():
            return {name: _plain(entry) for name, entry in value.items()}
    assert is_dataclass(value)  # noqa: S101 - answers are made of nothing else
    return {_TAG: type(value).__name__, **{f.name: _plain(getattr(value, f.name)) for f in fields(value) if f.init}}


def _checksum(plain: object) -> str:
    return hashlib.sha256(json_line(plain).encode()).hexdigest()

"""Computed records as lines of JSON, the same for the same figures, and back; damage and edits are noticed."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.errors import InputError
from sqrp_cli.geometry import Mask, read_only
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.skill.skill import Skill
from sqrp_cli.knowledge.text.json_file import parse_json
from sqrp_cli.program.record import FaultMetrics
from sqrp_cli.programming.advice.aiming import Aim
from sqrp_cli.programming.advice.change import Advice, CandidateEffect, EffectOnTask, Margin, Miss, ProposedChange
from sqrp_cli.programming.candidate import THEN
from sqrp_cli.programming.coverage.assessment import Assessment, BlindEnd, WayFigures, WaysFound
from sqrp_cli.programming.coverage.quality import Qualities
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.whole_task import whole_skill
from sqrp_cli.shown import json_line

_RECORDS = {
    record.__name__: record
    for record in (
        *(Advice, Aim, Assessment, BlindEnd, Camera, Candidate, CandidateEffect, EffectOnTask, FaultMetrics),
        *(Margin, Miss, ProposedChange, Qualities, WayFigures, WaysFound),
    )
}
"""What lines are made of; one that names anything else is none of ours."""

_TAG = "@"
"""Key of what a JSON object stands for, where it is no mapping."""


def as_line(value: object) -> str:
    """Records, arrays, and plain values of these as a line of JSON, with a checksum."""
    plain = plain_of(value)
    return json_line({"value": plain, "checksum": _checksum(plain)}) + "\n"


def from_line(text: str, skills: Sequence[Skill] = ()) -> Any:  # noqa: ANN401 # a value of any kind
    """The value that `as_line` wrote. skills: those that it may name. Raises ValueError for any other text."""
    try:
        document = parse_json(Path("record"), text)
        if document != {"value": document["value"], "checksum": _checksum(document["value"])}:
            raise ValueError("it is not as it was written")
        return _read(document["value"], {skill.name: skill for skill in skills})
    except (InputError, LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"no kept record: {error!r}") from error


def _checksum(plain: object) -> str:
    return hashlib.sha256(json_line(plain).encode()).hexdigest()


def plain_of(value: Any) -> Any:  # noqa: ANN401 # a value of any kind
    """A value in plain lists and numbers; records and arrays say what they are."""
    match value:
        case float() if not isfinite(value):
            return {_TAG: "float", "of": str(value)}
        case None | bool() | int() | float() | str():
            return value
        case np.ndarray(dtype=np.bool):
            bits = base64.b64encode(np.packbits(value).tobytes()).decode()
            return {_TAG: "mask", "of": bits, "shape": list(value.shape)}
        case np.ndarray():
            return {_TAG: "array", "of": value.tolist()}
        case Skill():
            return {_TAG: "Skill", "of": value.name}
        case tuple():
            return {_TAG: "tuple", "of": [plain_of(entry) for entry in value]}
        case list():
            return [plain_of(entry) for entry in value]
        case Mapping():
            return {name: plain_of(entry) for name, entry in value.items()}
    assert is_dataclass(value)  # noqa: S101 - they are made of nothing else
    return {_TAG: type(value).__name__, **{f.name: plain_of(getattr(value, f.name)) for f in fields(value) if f.init}}


def _read(value: Any, skills: Mapping[str, Skill]) -> Any:  # noqa: ANN401 # a value of any kind
    """What `plain_of` made plain."""
    if not isinstance(value, dict):
        return [_read(entry, skills) for entry in value] if isinstance(value, list) else value
    entries = {name: _read(entry, skills) for name, entry in value.items() if name != _TAG}
    match value.get(_TAG):
        case None:
            return entries
        case "tuple":
            return tuple(entries["of"])
        case "array":
            return read_only(entries["of"])
        case "mask":
            return _mask(entries["of"], tuple(entries["shape"]))
        case "float":
            return float(entries["of"])
        case "Skill":
            names = entries["of"].split(THEN)
            return skills[names[0]] if len(names) == 1 else whole_skill([skills[one] for one in names])
        case name:
            return _RECORDS[name](**entries)


def _mask(text: str, shape: tuple[int, ...]) -> Mask:
    bits = np.frombuffer(base64.b64decode(text), dtype=np.uint8)
    return np.unpackbits(bits, count=int(np.prod(shape))).astype(bool).reshape(shape)

"""What is kept of a computed candidate: its figures, and its coverage where that was asked for, as text."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.text.entries import Entry
from sqrp_cli.knowledge.text.json_file import parse_json
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.platform.paths_as_text import json_line
from sqrp_cli.program.record import FaultMetrics
from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.coverage.blind_spans import BlindSpan, Coverage, TargetCoverage
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.task import Candidate

_PLAIN = tuple(f.name for f in fields(Assessment) if f.name not in ("candidate", "faults", "recalibrated"))
"""What an assessment says in numbers and texts."""

Numbers = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Outcome:
    """A computed candidate; coverage: None where it was not asked for, or the candidate is infeasible."""

    assessment: Assessment
    coverage: Coverage | None

    def to_text(self) -> str:
        """One line of JSON, the same for the same figures."""
        assessment = self.assessment
        document = {
            **{name: getattr(assessment, name) for name in _PLAIN},
            "faults": {name: asdict(fault) for name, fault in assessment.faults.items()},
            "coverage": None if self.coverage is None else CoverageRecord.of(self.coverage).model_dump(mode="json"),
        }
        return _as_line({**document, "checksum": _checksum(document)}) + "\n"

    @staticmethod
    def from_text(text: str, candidate: Candidate) -> Outcome:
        """What `to_text` wrote of a candidate. Raises ValueError for text that it did not write."""
        try:
            document = parse_json(Path("outcome"), text)
            if document.pop("checksum") != _checksum(document):
                raise ValueError("this outcome of a candidate is not as it was written")
            assessment = Assessment(
                candidate=candidate,
                faults={name: FaultMetrics(**numbers) for name, numbers in document["faults"].items()},
                **{name: _plain(document[name]) for name in _PLAIN},
            )
            numbers = document["coverage"]
            return Outcome(assessment, None if numbers is None else CoverageRecord.model_validate(numbers).coverage())
        except (InputError, LookupError, TypeError, AttributeError) as error:
            raise ValueError(f"no outcome of a candidate: {error!r}") from error


def _as_line(document: Numbers) -> str:
    return json_line(document)


def _checksum(document: Numbers) -> str:
    """Tells what was computed from what was damaged or edited later, even where it still reads as an outcome."""
    return hashlib.sha256(_as_line(document).encode()).hexdigest()


Seconds = Annotated[float, Field(ge=0)]
CauseLabel = Literal[
    "too_near", "too_far", "out_of_image", "detector_near", "detector_far", "oblique", "too_small", "hidden"
]


class _TargetRecord(Entry):
    """A `TargetCoverage`: stretches as start and end, those that are not seen with cause and what is in the way."""

    needed: Annotated[int, Field(ge=1)]
    required: tuple[tuple[Seconds, Seconds], ...]
    blind: dict[str, tuple[tuple[Seconds, Seconds, CauseLabel, str | None], ...]]


class CoverageRecord(Entry):
    """A coverage in plain lists and numbers, times to 1 ms."""

    primitives: dict[str, Seconds]
    targets: dict[str, _TargetRecord]

    @staticmethod
    def of(coverage: Coverage) -> CoverageRecord:
        """The record of a coverage."""
        return CoverageRecord(
            primitives={name: _rounded(end) for name, end in coverage.primitives.items()},
            targets={atom: _target_record(target) for atom, target in coverage.targets.items()},
        )

    def coverage(self) -> Coverage:
        """The coverage that this is the record of."""
        return Coverage(
            dict(self.primitives),
            {
                atom: TargetCoverage(
                    target.needed,
                    tuple(Stretch(start, end) for start, end in target.required),
                    {
                        camera: tuple(
                            BlindSpan(Stretch(start, end), Cause[label.upper()], by) for start, end, label, by in spans
                        )
                        for camera, spans in target.blind.items()
                    },
                )
                for atom, target in self.targets.items()
            },
        )


def _target_record(target: TargetCoverage) -> _TargetRecord:
    return _TargetRecord.model_validate(
        {
            "needed": target.needed,
            "required": [_ends(stretch) for stretch in target.required],
            "blind": {
                camera: [(*_ends(span.stretch), span.cause.label, span.by) for span in spans]
                for camera, spans in target.blind.items()
            },
        }
    )


def _plain(value: Any) -> Any:  # noqa: ANN401 # JSON has no tuples
    return tuple(map(_plain, value)) if isinstance(value, list) else value


def _ends(stretch: Stretch) -> tuple[float, float]:
    return _rounded(stretch.start), _rounded(stretch.end)


def _rounded(t: float) -> float:
    return round(t, 3)

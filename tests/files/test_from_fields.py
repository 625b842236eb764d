"""A record is completed from others: what the last of them says or tells, unless it is given."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from sqrp_cli.files.entries import from_fields


@dataclass(frozen=True)
class Size:
    width: float
    height: float
    area: float = 0.0


@dataclass(frozen=True)
class Stated:
    width: float
    height: float

    @property
    def area(self) -> float:
        return self.width * self.height


class Methods:
    def area(self) -> float:
        raise AssertionError


@pytest.mark.parametrize(("known", "given", "made"), [
    ((Stated(2.0, 3.0),), {}, Size(2.0, 3.0, 6.0)),  # properties are told as fields are
    ((Stated(2.0, 3.0), Size(4.0, 5.0, 1.0)), {}, Size(4.0, 5.0, 1.0)),  # the last record wins,
    ((Stated(2.0, 3.0),), {"width": 7.0}, Size(7.0, 3.0, 6.0)),  # and what is given wins over all
    ((Stated(2.0, 3.0), Methods()), {}, Size(2.0, 3.0, 6.0)),  # a method tells nothing
    ((Methods(),), {"width": 1.0, "height": 1.0}, Size(1.0, 1.0, 0.0)),
])  # fmt: skip
def test_a_record_is_completed_from_others(known: tuple[object, ...], given: dict[str, float], made: Size) -> None:
    assert from_fields(Size, *known, **given) == made

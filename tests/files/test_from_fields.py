"""A record is completed from others: what the last of them says or tells, unless it is given."""

from __future__ import annotations

from dataclasses import dataclass

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


def test_properties_are_told_as_fields_are() -> None:
    assert from_fields(Size, Stated(2.0, 3.0)) == Size(2.0, 3.0, 6.0)


def test_the_last_record_wins_and_what_is_given_wins_over_all() -> None:
    assert from_fields(Size, Stated(2.0, 3.0), Size(4.0, 5.0, 1.0)) == Size(4.0, 5.0, 1.0)
    assert from_fields(Size, Stated(2.0, 3.0), width=7.0) == Size(7.0, 3.0, 6.0)


def test_a_method_tells_nothing() -> None:
    assert from_fields(Size, Stated(2.0, 3.0), Methods()).area == 6.0
    assert from_fields(Size, Methods(), width=1.0, height=1.0).area == 0.0

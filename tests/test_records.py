"""Records behave as data classes of the standard library do, whatever is written in them."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from dataclasses import field
from functools import partial
from typing import Any, ClassVar

import pytest

from sqrp_cli import records

WAYS: list[dict[str, bool]] = [
    {}, {"frozen": True}, {"eq": False}, {"frozen": True, "eq": False}, {"kw_only": True},
    {"frozen": True, "order": True}, {"repr": False},
]  # fmt: skip


def declared(dataclass: Callable[..., Any], how: dict[str, bool]) -> list[type]:
    """A record, one that extends it, and one that writes its own methods."""

    @dataclass(**how)
    class Plain:
        x: int
        y: float = 2.0
        names: list[str] = field(default_factory=list, compare=False)
        hidden: int = field(default=7, repr=False)
        kind: ClassVar[str] = "plain"

        @property
        def double(self) -> int:
            return 2 * self.x

    @dataclass(**how)
    class More(Plain):
        y: float = 3.0
        word: str = field(default="w", kw_only=True)
        made: list[int] = field(default_factory=list, init=False)

        def __post_init__(self) -> None:
            self.made.append(self.x)

    @dataclass(**how)
    class Own:
        x: float

        def __init__(self, x: float) -> None:
            object.__setattr__(self, "x", x + 1)

        def __repr__(self) -> str:
            return "own"

        def __eq__(self, other: object) -> bool:
            return True

        def __hash__(self) -> int:
            return 5

    @dataclass(**how)
    class Empty:
        pass

    return [Plain, More, Own, Empty]


def outcome(ask: Callable[[], object]) -> object:
    try:
        return ask()
    except (TypeError, AttributeError) as error:
        return type(error), "cannot" if isinstance(error, AttributeError) else str(error)


CALLS: list[tuple[tuple[Any, ...], dict[str, Any]]] = [
    ((), {}), ((1,), {}), ((1, 2.5, ["a"], 4), {}), ((1, 2, [], 4, 5), {}), ((), {"x": 1, "y": float("nan")}),
    ((1,), {"word": "v"}), ((), {"x": 3, "word": "v"}), ((1,), {"made": []}), ((1,), {"x": 1}),
    ((), {"x": [], "y": {}}),
]  # fmt: skip


@pytest.mark.parametrize("how", WAYS, ids=str)
def test_records_are_made_shown_compared_and_changed_as_data_classes(how: dict[str, bool]) -> None:
    pairs = list(zip(declared(records.dataclass, how), declared(dataclasses.dataclass, how), strict=True))
    for ours, theirs in pairs:
        assert [f.name for f in dataclasses.fields(ours)] == [f.name for f in dataclasses.fields(theirs)]
        assert ours.__match_args__ == theirs.__match_args__
        found: list[list[Any]] = [[], []]
        for positional, named in CALLS:
            one, other = (outcome(partial(kind, *positional, **named)) for kind in (ours, theirs))
            assert dataclasses.is_dataclass(one) == dataclasses.is_dataclass(other), (one, other)
            if not dataclasses.is_dataclass(one):
                assert one == other
                continue
            assert vars(one) == vars(other) or "nan" in str(vars(one))
            found[0].append(one)
            found[1].append(other)
            if how.get("repr", True):
                assert repr(one) == repr(other)
            for change in (hash, lambda made: setattr(made, "x", 9), lambda made: delattr(made, "x")):
                results = [outcome(partial(change, made)) for made in (one, other)]
                if how.get("eq", True):
                    assert results[0] == results[1]
                else:  # of its place in memory
                    assert type(results[0]) is type(results[1])
        for compare in ("__eq__", "__lt__", "__ge__"):
            ways = [[outcome(partial(getattr(a, compare), b)) for a in made for b in made] for made in found]
            assert ways[0] == ways[1]


@records.dataclass(frozen=True)
class Kept:
    x: int
    y: tuple[int, ...] = ()


def test_records_are_replaced_and_copied_and_match() -> None:
    one = Kept(1, (2,))
    assert dataclasses.replace(one, x=3) == Kept(3, (2,))
    assert copy.deepcopy(one) == one
    match one:
        case Kept(x, y):
            assert (x, y) == (1, (2,))

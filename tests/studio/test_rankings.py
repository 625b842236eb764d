"""The ranking that was asked for last comes, whatever was on its way before."""

from __future__ import annotations

import json
from multiprocessing import Pipe

import pytest

from sqrp_cli.studio.moves import Move
from sqrp_cli.studio.questions import Hold, Rank
from sqrp_cli.studio.rankings import Asked, Rankings
from sqrp_cli.studio.server import Live

SAVED, EDITED = (Asked(content, "pickup", "q_eoi") for content in (b"saved", b"edited"))
OF_SAVED = Rank(**vars(SAVED), number=1, of_saved=True)


class Bench:
    """A process that answers when it is told to; what it was asked."""

    def __init__(self) -> None:
        self.pipe, self.theirs = Pipe()
        self.asked: list[object] = []

    def ask(self, question: object) -> None:
        self.asked.append(question)


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def answered(bench):
    """Rankings of an edited file, and how the process answers."""

    async def heard(*_: object) -> None:
        raise AssertionError

    rankings = Rankings(bench, Live(heard), lambda: SAVED, lambda _: None)
    rankings.rank(EDITED)

    def answer(**fields: object) -> Rankings:
        bench.theirs.send(json.dumps(fields))
        rankings._answered()
        return rankings

    return answer


def test_a_timeline_of_before_does_not_end_the_ranking_that_is_under_way(bench, answered):
    answered(do="detail", name="g1", detail=None)
    assert bench.asked == [Rank(**vars(EDITED), number=1)]


def test_the_saved_file_is_ranked_once_all_is_shown(bench, answered):
    answered(do="ranking", number=1, entries=[{"name": "g1"}])
    answered(do="detail", name="g1", detail=None)
    answered(do="detail", name="g1", detail=None)
    assert bench.asked[1:] == [OF_SAVED]


def test_nothing_is_compared_while_a_hand_holds_something(bench, answered):
    rankings = answered(do="ranking", number=1, entries=[{"name": "g1"}])
    move = Move(kind="camera", name="cam1", position=[0.0, 0.0, 1.0])
    rankings.hold(move, 1)
    answered(do="detail", name="g1", detail=None)
    assert bench.asked[1:] == [Hold(move=move, number=1)]

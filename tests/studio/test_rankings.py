"""The ranking that was asked for last comes, whatever was on its way before."""

from __future__ import annotations

import json
from multiprocessing import Pipe

import pytest

from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.errors import InputError
from sqrp_cli.studio.messages import Asked
from sqrp_cli.studio.moves import Move, written
from sqrp_cli.studio.rankings import Rankings
from sqrp_cli.studio.server import Connections
from sqrp_cli.studio.session import Studio
from tests.studio.conftest import TASK

pytestmark = pytest.mark.slow

SAVED, EDITED = (Asked(content, "pickup", "q_eoi") for content in (b"saved", b"edited"))
MOVE = Move(kind="camera", name="cam1", position=[0.1, 0.7, 1.2])


class WorkerProcess:
    """A process that answers when it is told to; what it was asked, and what the saved file is ranked for."""

    def __init__(self) -> None:
        self.pipe, self.theirs = Pipe()
        self.asked: list[object] = []
        self.saved = SAVED

    def ask(self, question: object) -> None:
        self.asked.append(question)


@pytest.fixture
def worker():
    return WorkerProcess()


@pytest.fixture
def answered(worker):
    """Rankings of an edited file, and how the process answers."""

    async def heard(*_: object) -> None:
        raise AssertionError

    rankings = Rankings(worker, Connections(heard), lambda: worker.saved, lambda _: None)
    rankings.rank(EDITED)

    def answer(**fields: object) -> Rankings:
        worker.theirs.send(json.dumps(fields))
        rankings._answered()
        return rankings

    return answer


def test_the_saved_file_is_ranked_once_all_is_shown_and_a_timeline_of_before_ends_nothing(worker, answered):
    answered(do="detail", name="g1", detail=None)
    assert worker.asked == [("rank", EDITED, 1)]
    answered(do="ranking", number=1, entries=[{"name": "g1"}])
    answered(do="detail", name="g1", detail=None)
    answered(do="detail", name="g1", detail=None)
    assert worker.asked[1:] == [("compare", SAVED, 1)]


def test_nothing_is_compared_while_a_hand_holds_something(worker, answered):
    rankings = answered(do="ranking", number=1, entries=[{"name": "g1"}])
    rankings.hold(MOVE, 1)
    answered(do="detail", name="g1", detail=None)
    assert worker.asked[1:] == [("hold", MOVE, 1)]


def test_figures_of_the_file_before_it_was_saved_are_not_those_of_the_saved_file(worker, answered):
    rankings = answered(do="ranking", number=1, entries=[{"name": "g1"}])
    answered(do="detail", name="g1", detail=None)
    worker.saved = EDITED
    rankings.take_as_saved()
    answered(do="saved-ranking", number=1, entries=[{"name": "before"}])
    assert json.loads(rankings.connections.kept["saved-ranking"])["entries"] == [{"name": "g1"}]


def test_a_change_that_was_found_for_another_text_is_not_made(worker, cell, monkeypatch):
    file = cell / "workspace.yaml"
    studio = Studio(OpenCell.read(cell, 0), TASK, 1, worker)
    monkeypatch.setattr(studio.under_way, "begin", lambda _: None)  # what it would find is below
    studio.obey('{"do": "advise"}')
    offered = written(read_workspace_document(file, file.read_bytes()), OpenCell.read(cell, 0).workspace, MOVE)
    studio.under_way.offers = [("cam1 elsewhere", ("advise", TASK), offered)]

    def asked(text: str) -> bytes:
        studio.obey(text)
        return worker.asked[-1][1].content

    edited = asked('{"do": "set", "path": "cameras.cam1.rate", "value": "7 Hz"}')
    with pytest.raises(InputError, match="the cell has changed since this was found"):
        asked('{"do": "apply", "number": 1}')
    assert worker.asked[-1][1].content == edited
    asked('{"do": "undo"}')
    assert asked('{"do": "apply", "number": 1}') == offered

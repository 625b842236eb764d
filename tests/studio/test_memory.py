"""What is not shown any more is let go."""

from __future__ import annotations

import gc
import json
import threading
from collections import deque
from multiprocessing import Pipe

import pytest

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.studio import worker
from sqrp_cli.studio.messages import Asked
from sqrp_cli.studio.moves import MOST_CHANGES, MOST_KEPT, Draft, DraftChange, Move, written
from sqrp_cli.studio.worker import _Worker
from tests.studio.conftest import TASK

FEW = 200
"""Objects that only garbage collection finds; a ranking leaves thousands."""


class Asking:
    """Asks a process that computes, here in this one; a thread reads what it answers."""

    def __init__(self, cell) -> None:
        self._pipe, theirs = Pipe()
        self.worker = _Worker(theirs, cell, 0, 1)
        self._told: deque[str] = deque()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        while True:
            self._told.append(json.loads(self._pipe.recv())["do"])

    def rank(self, content: bytes) -> None:
        """Rank, and wait for all that follows."""
        self._told.clear()
        self._pipe.send(("rank", Asked(content, TASK, "q_eoi"), 0))
        while "detail" not in self._told:
            self.worker.work()
            while self.worker.run is None and self.worker.explaining is None and "detail" not in self._told:
                pass  # it is on its way


@pytest.fixture
def no_collection(monkeypatch):
    """Python collects no garbage by itself."""
    monkeypatch.setattr(worker, "keep_all_so_far", lambda: None)
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("no_collection")
@pytest.mark.trial
def test_rankings_of_before_are_let_go_at_rest(cell):
    opened = open_cell(cell)
    file = cell / "workspace.yaml"
    asking = Asking(cell)
    for x in (0.0, 0.05):
        gc.collect()
        move = Move(kind="camera", name="cam1", position=[x, 0.7, 1.2])
        asking.rank(written(read_workspace_document(file, file.read_bytes()), opened.workspace, move))
    assert gc.collect() < FEW


def test_changes_are_kept_up_to_a_number_and_a_size(tmp_path):
    def after(count: int, size: int) -> Draft:
        draft = Draft(path=tmp_path, saved=b"", first=b"")
        for number in range(count):
            content = b"%d" % number + b" " * size
            draft = draft.changed(DraftChange(label="", values=None, content=content))
        return draft

    assert len(after(MOST_CHANGES + 3, 10).past) == MOST_CHANGES
    few = after(70, 1_000_000)
    assert (
        sum(len(one.content) for one in few.past) <= MOST_KEPT < sum(len(one.content) for one in few.past) + 1_000_010
    )
    assert few.first == b"%d" % (69 - len(few.past)) + b" " * 1_000_000
    assert len(after(2, MOST_KEPT + 1).past) == 1

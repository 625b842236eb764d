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
from sqrp_cli.studio.messages import Asked
from sqrp_cli.studio.moves import MOST_CHANGES, MOST_KEPT, Draft, DraftChange, Move, written
from sqrp_cli.studio.worker import _Worker
from tests.studio.conftest import TASK

FEW = 200
"""Objects that only garbage collection finds; a ranking leaves thousands."""


@pytest.mark.trial
def test_rankings_of_before_are_let_go_at_rest(cell):
    """In this process, of which Python collects no garbage by itself; a thread reads what is answered."""
    pipe, theirs = Pipe()
    computing, told = _Worker(theirs, cell, 0, 1), deque[str]()

    def listen() -> None:
        while True:
            told.append(json.loads(pipe.recv())["do"])

    threading.Thread(target=listen, daemon=True).start()
    file, opened = cell / "workspace.yaml", open_cell(cell)
    gc.disable()
    try:
        for x in (0.0, 0.05):
            gc.collect()
            move = Move(kind="camera", name="cam1", position=[x, 0.7, 1.2])
            content = written(read_workspace_document(file, file.read_bytes()), opened.workspace, move)
            told.clear()
            pipe.send(("rank", Asked(content, TASK, "q_eoi"), 0))
            while "detail" not in told:
                computing.work()
                while computing.run is None and computing.explaining is None and "detail" not in told:
                    pass  # it is on its way
        assert gc.collect() < FEW
    finally:
        gc.enable()


def test_changes_are_kept_up_to_a_number_and_a_size(tmp_path):
    def after(count: int, size: int) -> Draft:
        draft = Draft(path=tmp_path, saved=b"", first=b"")
        for number in range(count):
            content = b"%d" % number + b" " * size
            draft = draft.changed(DraftChange(label="", values=None, content=content))
        return draft

    assert len(after(MOST_CHANGES + 3, 10).past) == MOST_CHANGES
    few = after(70, 1_000_000)
    kept = sum(len(one.content) for one in few.past)
    assert kept <= MOST_KEPT < kept + 1_000_010
    assert few.first == b"%d" % (69 - len(few.past)) + b" " * 1_000_000
    assert len(after(2, MOST_KEPT + 1).past) == 1

"""Who sends without end or never reads costs the others little, be it a browser or a process that computes."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from websockets.asyncio.client import connect

from sqrp_cli.errors import InputError
from sqrp_cli.studio import jobs, rankings, server
from sqrp_cli.studio.jobs import Jobs
from sqrp_cli.studio.messages import Asked
from sqrp_cli.studio.rankings import WorkerProcess
from sqrp_cli.studio.server import MOST_AT_ONCE, MOST_PER_SECOND, MOST_UNREAD, MOST_WAITING, Connections, _Browser

pytestmark = pytest.mark.slow


class Connection:
    """One that never gets rid of anything."""

    def __init__(self) -> None:
        self.transport, self.aborted = self, False

    def abort(self) -> None:
        self.aborted = True


def test_who_sends_without_end_is_heard_at_a_bounded_rate(monkeypatch):
    slept: list[float] = []

    async def sleep(seconds: float) -> None:
        slept.append(seconds)

    async def flood() -> None:
        browser = _Browser(Connection())
        for _ in range(MOST_AT_ONCE + 50):
            await browser.pause()

    monkeypatch.setattr(server.time, "monotonic", lambda: 1.0 + sum(slept))
    monkeypatch.setattr(server.asyncio, "sleep", sleep)
    asyncio.run(flood())
    assert not any(slept[:MOST_AT_ONCE])
    assert abs(sum(slept) - 50 / MOST_PER_SECOND) < 1e-6


def test_who_never_reads_is_cut_off_and_gets_no_numbers_of_what_the_next_message_replaces():
    async def tell() -> None:
        connection, text = Connection(), "x" * 1_000_000
        browser = _Browser(connection)
        for _ in range(10 * MOST_WAITING):
            browser.tell("picture", passing=True)
        assert browser.waiting.qsize() == MOST_WAITING
        for _ in range(MOST_UNREAD // len(text) - 1):
            browser.tell(text)
        assert not connection.aborted
        browser.tell(text)
        assert connection.aborted

    asyncio.run(tell())


@pytest.mark.trial
def test_others_are_heard_during_a_flood():
    async def heard(text: str, tell: server.Tell) -> None:
        tell(text)

    async def send(connection: object) -> None:
        while True:
            await connection.send("x" * 1000)  # type: ignore[attr-defined]

    async def both() -> str:
        connections = Connections(heard)
        await connections.open(0)
        origin, token = connections.address.strip("/").rsplit("/", 1)
        where = f"{connections.socket}/{token}/live"
        async with connect(where, origin=origin) as flooding, connect(where, origin=origin) as other:
            flood = asyncio.create_task(send(flooding))
            await asyncio.sleep(0.1)
            await other.send(json.dumps({"do": "undo"}))
            answer = await other.recv()
            flood.cancel()
        await connections.close()
        return str(answer)

    assert json.loads(asyncio.run(asyncio.wait_for(both(), 60.0))) == {"do": "undo"}


def ends(act: Callable[[], None]) -> bool:
    thread = threading.Thread(target=act, daemon=True)
    thread.start()
    thread.join(60.0)
    return not thread.is_alive()


def test_a_process_that_does_not_read_holds_nobody_up(monkeypatch):
    monkeypatch.setattr(rankings, "_serve", lambda *_: time.sleep(1000.0))

    def ask() -> None:
        worker = WorkerProcess(Path("cell"), 0, 1)
        for number in range(20):
            worker.ask(("rank", Asked(b"x" * 1_000_000, "pickup", "q_eoi"), number))
        worker.close()

    assert ends(ask)


def test_drops_that_no_job_listens_to_hold_nobody_up(monkeypatch):
    monkeypatch.setattr(jobs, "_work", lambda *_, playing: time.sleep(1000.0))  # noqa: ARG005 - a job reads nothing

    async def drop() -> None:
        for playing in (False, True):
            under_way = Jobs(Connections(None), lambda _: None)
            under_way.begin(print, playing=playing)
            for _ in range(5000):
                with suppress(InputError):
                    under_way.drop()
            under_way.end()

    assert ends(lambda: asyncio.run(drop()))

"""Processes that work for this one: how they are started, what happens when they die, and who ends them."""

from __future__ import annotations

import importlib.util
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.platform.processes import MOST_PER_CORE, Pool, Worker, WorkerDied, forked, in_processes
from sqrp_cli.run.image import NEEDED
from tests.cells import ROOT, read_cases

PATIENCE = 60.0
"""How long anything may take before it counts as hanging [s]."""

SCRIPTS, UNGUARDED = read_cases("process_scripts.yaml"), "a script without a guard is not run again"


def test_what_the_processes_of_a_run_import_is_there() -> None:
    assert [name for name in NEEDED if importlib.util.find_spec(name) is None] == []


def _call(what: tuple[Any, ...]) -> Any:
    function, *arguments = what
    return function(*arguments)


def test_sending_much_to_a_process_that_was_killed_does_not_wait_for_ever() -> None:
    workers = [Worker(forked(), lambda: _call) for _ in range(2)]  # the second one inherits what is open when it begins
    for worker in workers:
        worker.send((os.getpid,))
    first, second = (worker.receive(PATIENCE) for worker in workers)
    assert first != second

    workers[0].send((time.sleep, 2 * PATIENCE))
    os.kill(first, signal.SIGKILL)
    for _ in range(3):
        workers[0].send((len, bytes(1_000_000)))  # more than a pipe holds
    with pytest.raises(WorkerDied, match="has ended"):
        workers[0].receive()
    workers[1].send((len, b"more"))
    assert workers[1].receive(PATIENCE) == 4
    for worker in workers:
        worker.close()


def test_a_worker_that_does_not_answer_in_time_is_killed_and_its_message_goes_to_another(tmp_path: Path) -> None:
    def hangs_once(number: int) -> int:
        if number == 3 and not (tmp_path / "hung").exists():
            (tmp_path / "hung").touch()
            time.sleep(PATIENCE)
        return number

    began = time.monotonic()
    assert list(in_processes(hangs_once, range(8), 2, deadline=0.5)) == list(range(8))
    assert time.monotonic() - began < 0.5 * PATIENCE
    with pytest.raises(InputError, match="died twice"):
        list(in_processes(time.sleep, [PATIENCE, 0.0, 0.0], 2, deadline=0.3))


def test_messages_of_a_kind_stay_with_one_worker_and_all_workers_are_used() -> None:
    pool: Pool[str, tuple[int, str]] = Pool(
        2, forked(), lambda: lambda text: (time.sleep(0.02), (os.getpid(), text))[1]
    )
    found = dict(pool.answers(["a1", "b1", "a2", "b2", "a3", "a4", "a5", "a6"], kind=lambda text: text[0]))
    pool.close()
    assert sorted(found) == list(range(8))
    by_kind = {kind: {one[0] for one in found.values() if one[1].startswith(kind)} for kind in "ab"}
    assert len(by_kind["b"]) == 1
    assert len(by_kind["a"]) == 2, "once there is nothing else, both do what is left"


def test_once_it_is_enough_only_what_is_begun_is_answered() -> None:
    pool: Pool[int, int] = Pool(2, forked(), lambda: lambda number: number, ahead=0)
    found: list[int] = []
    for index, _ in pool.answers(range(100), enough=lambda: len(found) > 2):
        found.append(index)
    assert 3 <= len(found) <= 5
    pool.close()


def test_what_goes_wrong_in_a_process_goes_wrong_here() -> None:
    with pytest.raises(ZeroDivisionError):
        list(in_processes(lambda number: 1 // number, [1, 0], 2))


def kill_oneself(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("third", [lambda _: time.sleep(0.2), kill_oneself])
def test_results_come_in_order_whether_one_takes_long_or_its_process_is_killed(tmp_path: Path, third: Any) -> None:
    def work(number: int) -> int:
        if number == 3 and not (tmp_path / "done").exists():
            (tmp_path / "done").touch()
            third(number)
        return -number

    assert list(in_processes(work, range(10), 2)) == [-number for number in range(10)]


def test_what_kills_its_process_twice_is_an_error() -> None:
    with pytest.raises(InputError, match="died twice; is there enough memory"):
        list(in_processes(lambda number: kill_oneself(number) if number == 3 else number, range(10), 2))
    assert not multiprocessing.active_children()


ORPHANS = """
import os, signal, time
from sqrp_cli.platform.processes import in_processes

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background processes ignore Ctrl-C

def work(number):
    os.write(1, b"%d\\n" % os.getpid())  # in one piece
    time.sleep(600)

list(in_processes(work, range(2), 2))
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_no_process_outlives_the_one_that_it_works_for(how: signal.Signals) -> None:
    process = subprocess.Popen([sys.executable, "-c", ORPHANS], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    workers = [int(process.stdout.readline()) for _ in range(2)]
    process.send_signal(how)
    process.wait(PATIENCE)
    deadline = time.monotonic() + PATIENCE
    while any(map(_runs, workers)) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not any(map(_runs, workers))


def _runs(process: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    except FileNotFoundError:
        return False


@pytest.mark.parametrize(("what", "typed"), [*((what, False) for what in SCRIPTS), (UNGUARDED, True)])
def test_processes_are_started_and_end_without_a_word(tmp_path: Path, what: str, typed: bool) -> None:
    script, environment = SCRIPTS[what]["script"], {**os.environ, "PYTHONPATH": str(ROOT)}
    if (name := SCRIPTS[what].get("temporary")) is not None:
        (tmp_path / name).mkdir()
        environment["TMPDIR"] = str(tmp_path / name)
    (tmp_path / "script.py").write_text(script, encoding="utf-8")
    command = [sys.executable, "-" if typed else str(tmp_path / "script.py")]
    found = subprocess.run(command, env=environment, check=True, capture_output=True, text=True, input=script)
    assert (found.stdout, found.stderr) == (SCRIPTS[what]["printed"], "")


def test_a_number_of_processes_that_no_machine_has_takes_no_memory() -> None:
    pool: Pool[int, int] = Pool(10**20, forked(), lambda: lambda number: number)
    assert list(pool.map([1, 2, 3])) == [1, 2, 3]
    assert len(pool._workers) <= MOST_PER_CORE * (os.cpu_count() or 1)
    pool.close(at_once=True)

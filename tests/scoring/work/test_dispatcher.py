"""Whatever happens to workers, every job is done once, and workspaces are loaded as seldom as can be."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import Future
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.platform.processes import WorkerDied
from sqrp_cli.programming.coverage.sampling import Adaptive
from sqrp_cli.scoring.work.dispatcher import Dispatcher, Done
from sqrp_cli.scoring.work.job import Job, PackedWorkspace


def make_job(name: str, trouble: str = "", workspace: str = "") -> SimpleNamespace:
    return SimpleNamespace(name=name, trouble=trouble, workspace=workspace, candidates=(SimpleNamespace(name=name),))


class FakeWorkers:
    """Workers that do their jobs when they are waited for: of those that have one, the first in turn does one.

    A job that kills its worker takes with it whatever else that worker had, and nothing of the others.
    """

    def __init__(self, count: int, ahead: int = 2, *, aside: bool = True, portion: int = 1) -> None:
        self.count, self.ahead, self.aside, self.portion = count, ahead, aside, portion
        self.waiting: list[list[tuple[Future, SimpleNamespace]]] = [[] for _ in range(count)]
        self.begun: Counter[str] = Counter()
        self.broken: set[int] = set()
        self.restarts = 0
        self.done_by: dict[int, list[str]] = {worker: [] for worker in range(count)}
        self.turn = 0

    def submit(self, job, worker):
        future: Future = Future()
        if worker in self.broken:
            future.set_exception(WorkerDied("it died earlier"))
            return future
        self.waiting[worker].append((future, job))
        assert len(self.waiting[worker]) <= self.ahead
        return future

    def work(self) -> None:
        busy = [worker for worker in range(self.count) if self.waiting[worker]]
        if not busy:
            return
        worker = busy[self.turn % len(busy)]
        self.turn += 1
        future, job = self.waiting[worker].pop(0)
        self.begun[job.name] += 1
        if job.trouble == "always dies" or (job.trouble == "dies once" and self.begun[job.name] == 1):
            for lost, _ in [(future, job), *self.waiting[worker]]:
                lost.set_exception(WorkerDied("a worker died"))
            self.waiting[worker].clear()
            self.broken.add(worker)
        elif job.trouble == "bad input":
            future.set_exception(InputError(Problem("bad", "no good")))
        elif job.trouble == "bug":
            future.set_exception(ZeroDivisionError("oh"))
        else:
            self.done_by[worker].append(job.workspace)
            future.set_result((f"result of {job.name}",))

    def restart(self, worker: int) -> None:
        self.restarts += 1
        self.broken.discard(worker)

    def close(self) -> None:
        pass


def run(workers: FakeWorkers, groups: list[list[SimpleNamespace]]) -> dict[str, Done]:
    """Run jobs; waiting for any of them makes the workers work."""
    import sqrp_cli.scoring.work.dispatcher as module

    kept: dict[str, Done] = {}

    def keep(done: Done) -> None:
        assert done.job.name not in kept
        kept[done.job.name] = done

    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(module, "wait", lambda _futures, **_options: workers.work())
        dispatcher = Dispatcher(workers, keep)
        for group in groups:
            dispatcher.add(group)
        dispatcher.finish()
    return kept


troubles = st.sampled_from(["", "", "", "dies once", "always dies", "bad input", "bug"])


@given(st.lists(st.lists(troubles, max_size=6), max_size=5), st.integers(1, 4), st.integers(1, 3), st.booleans())
def test_every_job_is_kept_once_and_only_those_in_trouble_without_outcome(found, count, ahead, aside):
    groups = [
        [make_job(f"{at}.{index}", trouble) for index, trouble in enumerate(group)] for at, group in enumerate(found)
    ]
    kept = run(FakeWorkers(count, ahead, aside=aside), groups)
    jobs = [job for group in groups for job in group]
    assert set(kept) == {job.name for job in jobs}
    for job in jobs:
        done = kept[job.name]
        if job.trouble in ("", "dies once"):
            assert done.outcomes == (f"result of {job.name}",)
        else:
            assert not done.outcomes
            assert done.problems


def test_a_job_that_kills_its_worker_twice_is_named():
    kept = run(FakeWorkers(2), [[make_job("a"), make_job("b", "always dies"), make_job("c")]])
    (problem,) = kept["b"].problems
    assert problem.code == "worker-died"
    assert "computed b died twice" in problem.message


def test_a_worker_that_died_while_it_had_nothing_to_do_is_replaced():
    workers = FakeWorkers(2)
    workers.broken = {0, 1}
    assert len(run(workers, [[make_job(name) for name in "abcd"]])) == 4


def test_a_worker_that_is_found_dead_with_work_to_do_is_replaced_once():
    workers, kept = FakeWorkers(1), []
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr("sqrp_cli.scoring.work.dispatcher.wait", lambda _futures, **_options: None)
        dispatcher = Dispatcher(workers, kept.append)
        dispatcher.add([make_job("a", "dies once")])
        workers.work()
        dispatcher.add([make_job("b")])
        assert workers.restarts == 1
        dispatcher.add([])
    assert workers.restarts == 1
    assert [job.name for _, job in workers.waiting[0]] == ["b"]


@given(st.integers(1, 4), st.lists(st.integers(1, 20), min_size=1, max_size=12))
def test_a_workspace_is_loaded_again_only_where_a_worker_had_nothing_else_to_do(count, sizes):
    workers = FakeWorkers(count)
    run(workers, [[make_job(f"{at}.{i}", workspace=f"{at}") for i in range(size)] for at, size in enumerate(sizes)])
    changes = sum(
        len([1 for at, name in enumerate(done) if at == 0 or done[at - 1] != name]) for done in workers.done_by.values()
    )
    # A worker takes over half of what another has left, at most once for every halving, and only when no workspace is
    # left that nobody has; while workspaces come in, that may also be for the first one.
    halvings = max(sizes).bit_length()
    assert changes <= len(sizes) + 2 * (count - 1) * halvings
    assert max(map(len, workers.done_by.values())) - min(map(len, workers.done_by.values())) <= workers.ahead


class PortionWorkers(FakeWorkers):
    """Workers that do several candidates as one job; which of them are in trouble is known by their name."""

    def __init__(self, count: int, portion: int) -> None:
        super().__init__(count, aside=False, portion=portion)  # they begin when all is there
        self.portions: list[list[str]] = []

    def submit(self, job, worker):
        names = [candidate.name for candidate in job.candidates]
        self.portions.append(names)
        assert len(names) <= self.portion
        future: Future = Future()
        self.waiting[worker].append((future, names))
        return future

    def work(self) -> None:
        worker = max(range(self.count), key=lambda at: len(self.waiting[at]))
        future, names = self.waiting[worker].pop(0)
        troubles = {name.partition(" ")[2] for name in names}
        if "dies" in troubles:
            for lost, _ in [(future, names), *self.waiting[worker]]:
                lost.set_exception(WorkerDied("a worker died"))
            self.waiting[worker].clear()
        elif "bad" in troubles:
            future.set_exception(InputError(Problem("bad", "no good")))
        else:
            future.set_result(tuple(f"result of {name}" for name in names))


def candidate_jobs(workspace: str, names: list[str], content: str = "") -> list[Job]:
    packed = PackedWorkspace(workspace, {}, b"")
    return [Job(packed, content, (SimpleNamespace(name=name),), Adaptive(), 0, coverage=False) for name in names]


def run_portions(workers: PortionWorkers, groups: list[list[Job]]) -> dict[str, Done]:
    kept: dict[str, Done] = {}
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr("sqrp_cli.scoring.work.dispatcher.wait", lambda _futures, **_options: workers.work())
        dispatcher = Dispatcher(workers, lambda done: kept.update({done.job.candidates[0].name: done}))
        for group in groups:
            dispatcher.add(group)
        dispatcher.finish()
    return kept


@given(
    st.lists(st.lists(st.sampled_from(["", " bad", " dies"]), max_size=9), max_size=6),
    st.integers(1, 3),
    st.integers(1, 6),
)
def test_only_the_candidate_that_is_in_trouble_is_without_outcome(found, count, portion):
    groups = [
        candidate_jobs(f"{at}", [f"{at}.{index}{trouble}" for index, trouble in enumerate(group)])
        for at, group in enumerate(found)
    ]
    kept = run_portions(PortionWorkers(count, portion), groups)
    assert set(kept) == {job.candidates[0].name for group in groups for job in group}
    for name, done in kept.items():
        if " " in name:
            assert done.problems
        else:
            assert done.outcomes == (f"result of {name}",)


def test_portions_are_of_one_workspace_and_one_skill_and_get_smaller_as_the_end_comes_near():
    workers = PortionWorkers(2, 5)
    pick, place = ([f"{skill}{index:02}" for index in range(7)] for skill in ("pick", "place"))
    first = [*candidate_jobs("a", pick, "pick"), *candidate_jobs("a", place, "place")]
    run_portions(workers, [first, candidate_jobs("b", [f"b{index:02}" for index in range(20)])])
    kinds = [{name.rstrip("0123456789") for name in names} for names in workers.portions]
    assert all(len(kind) == 1 for kind in kinds)
    sizes = [len(names) for names in workers.portions]
    assert sizes[0] == 5
    assert sizes[-1] == 1
    assert len(sizes) < sum(sizes) / 2


def test_workers_that_are_this_process_begin_only_when_they_are_waited_for():
    workers = FakeWorkers(1, 1, aside=False)
    dispatcher = Dispatcher(workers, lambda _done: None)
    dispatcher.add([make_job("a")])
    assert not workers.waiting[0]


def test_at_ctrl_c_what_is_under_way_is_kept(monkeypatch):
    import sqrp_cli.scoring.work.dispatcher as module

    workers, kept = FakeWorkers(2), []

    def interrupted(_futures, **options):
        if options.get("timeout") == 0:
            return
        workers.work()
        workers.work()
        if not kept:
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "wait", interrupted)
    dispatcher = Dispatcher(workers, kept.append)
    dispatcher.add([make_job(name) for name in "abcdefgh"])
    with pytest.raises(KeyboardInterrupt):
        dispatcher.finish()
    kept_before = len(kept)
    monkeypatch.setattr(module, "wait", lambda _futures: None)
    dispatcher.give_up()
    assert kept_before == 0
    assert len(kept) == 2
    assert {done.outcomes[0] for done in kept} <= {f"result of {name}" for name in "abcdefgh"}

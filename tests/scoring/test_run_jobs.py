"""Whatever happens to workers, every job is done once; one that kills its worker is given up and named."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.scoring.run_jobs import Done, run_jobs


def make_job(name: str, trouble: str = "") -> SimpleNamespace:
    return SimpleNamespace(name=name, trouble=trouble, candidates=(SimpleNamespace(name=name),))


class FakeWorkers:
    """Workers that do what is under way all at once; a job that kills takes with it whatever else is under way."""

    portion = 1

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.under_way: list[tuple[Future, SimpleNamespace]] = []
        self.begun: Counter[str] = Counter()

    def submit(self, job):
        future: Future = Future()
        self.begun[job.name] += 1
        self.under_way.append((future, job))
        if len(self.under_way) == self.capacity or job.trouble:
            self.work()
        return future

    def work(self) -> None:
        dies = any(
            job.trouble == "always dies" or (job.trouble == "dies once" and self.begun[job.name] == 1)
            for _, job in self.under_way
        )
        for future, job in self.under_way:
            if dies:
                future.set_exception(BrokenProcessPool("a worker died"))
            elif job.trouble == "bad input":
                future.set_exception(InputError(Problem("bad", "no good")))
            elif job.trouble == "bug":
                future.set_exception(ZeroDivisionError("oh"))
            else:
                future.set_result((f"result of {job.name}",))
        self.under_way.clear()

    def restart(self) -> None:
        pass

    def close(self) -> None:
        pass


def run(workers: FakeWorkers, jobs: list[SimpleNamespace], monkeypatch) -> dict[str, Done]:
    """Run jobs; waiting for any of them makes the workers work."""
    import sqrp_cli.scoring.run_jobs as module

    monkeypatch.setattr(module, "wait", lambda _futures, **_options: workers.work())
    kept: dict[str, Done] = {}

    def keep(done: Done) -> None:
        assert done.job.name not in kept
        kept[done.job.name] = done

    run_jobs(workers, jobs, keep)
    return kept


troubles = st.lists(st.sampled_from(["", "", "", "dies once", "always dies", "bad input", "bug"]), max_size=12)


@given(troubles, st.integers(1, 4))
def test_every_job_is_kept_once_and_only_those_in_trouble_without_outcome(found, capacity):
    jobs = [make_job(str(index), trouble) for index, trouble in enumerate(found)]
    with pytest.MonkeyPatch.context() as monkeypatch:
        kept = run(FakeWorkers(capacity), jobs, monkeypatch)
    assert set(kept) == {job.name for job in jobs}
    for job in jobs:
        done = kept[job.name]
        if job.trouble in ("", "dies once"):
            assert done.outcomes == (f"result of {job.name}",)
        else:
            assert not done.outcomes
            assert done.problems


def test_a_job_that_kills_its_worker_twice_is_named(monkeypatch):
    kept = run(FakeWorkers(2), [make_job("a"), make_job("b", "always dies"), make_job("c")], monkeypatch)
    (problem,) = kept["b"].problems
    assert problem.code == "worker-died"
    assert "computed b died twice" in problem.message


def test_at_ctrl_c_what_is_under_way_is_kept(monkeypatch):
    import sqrp_cli.scoring.run_jobs as module

    workers, kept, calls = FakeWorkers(3), [], []

    def interrupted(_futures, **_options):
        calls.append(1)
        workers.work()
        if len(calls) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_jobs(workers, [make_job(name) for name in "ab"], kept.append)
    assert [done.job.name for done in kept] == ["a", "b"]

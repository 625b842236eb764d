"""The process that computes for the studio: rankings in forked processes, sketches at once.

A later question supersedes an earlier one: what is still computed for that is ended.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import field, replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.ask.api.session import Session
from sqrp_cli.ask.requests import TaskRequest
from sqrp_cli.errors import Infeasible, InputError, bad_input
from sqrp_cli.geometry import matrix_to_quaternion
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.memory import give_back_memory
from sqrp_cli.platform.processes import Worker, WorkerDied, forked
from sqrp_cli.records import dataclass
from sqrp_cli.run.record.log import Track
from sqrp_cli.show.documents.scene import ShowDocument
from sqrp_cli.show.pages.assembly import row
from sqrp_cli.show.pages.candidate_page import candidate_rows, playback, scene_model
from sqrp_cli.show.pages.run_page import track_shown
from sqrp_cli.show.sentences import summary
from sqrp_cli.studio.messages import Asked, Question, findings, message
from sqrp_cli.studio.moves import Move, moved
from sqrp_cli.studio.sketch import CoverageShown, Sketch, joined
from sqrp_cli.study.find import Plans, WantedWay
from sqrp_cli.study.pipeline import RankJob, assess_all, described, shared
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.whole_analysis import planned_steps
from sqrp_cli.task.candidate import Candidate

KEPT_PLANS = 64  # motions of so many candidates at most are kept for other cameras
LOWER_PRIORITY = 20  # by how much processes that take longer are nicer than others: browser and sketches go first


@dataclass(eq=False)
class RankingRun:
    """A ranking under way."""

    asked: Asked
    number: int  # of the question; answers carry it
    of_saved: bool  # whether only figures are wanted, to compare others with
    session: Session
    worker: Worker[None, CandidateResult]  # which has the candidates, in order
    found: list[CandidateResult] = field(default_factory=list)


def _nicely(work: Callable[..., Iterator[Any]], *about: object) -> Callable[[None], Any]:
    """What a process that takes longer answers with, after others: one thing after the other that `work` yields."""
    os.nice(LOWER_PRIORITY)
    found = work(*about)
    return lambda _: next(found)


def _detail(job: RankJob, ranked: CandidateResult) -> Iterator[str]:
    """The message that shows a candidate over time."""
    explained = job.explain(ranked)
    detail = playback(job, explained, brief=True) if ranked.feasible else None
    yield message("detail", name=ranked.candidate.name, detail=detail)


def serve(pipe: Connection, path: Path, seed: int, jobs: int) -> None:
    """Answer questions until the other end is closed. Answers are texts in JSON, with `do` first."""
    serving = _Worker(pipe, path, seed, jobs)
    with suppress(EOFError, OSError):
        while True:
            try:
                serving.work()
            except (EOFError, OSError):
                break
            except Exception as error:  # the next question may be answered all the same
                serving.drop()
                serving.say("problems", number=None, problems=findings(error))
    serving.drop()


@dataclass(eq=False)
class _Worker:
    """What is computed now, and what is known of the cell and of its last ranking."""

    pipe: Connection
    path: Path
    seed: int
    jobs: int
    run: RankingRun | None = None
    explaining: Worker[None, str] | None = None
    _cell: Cell | None = None
    _kin: object = None  # what decides motions and requirements: equal for cells that differ in their cameras only
    _model: Mapping[str, object] | None = None
    _task: tuple[str, Session] | None = None
    """The last task with plans, as it was asked for; None once anything but cameras has changed."""
    _ranking: dict[str, CandidateResult] = field(default_factory=dict)  # The candidates by their names, the best first
    _session: Session | None = None
    _chosen: str = ""
    _sketches: dict[str, tuple[list[Sketch], CoverageShown]] = field(default_factory=dict)
    """Of the chosen candidate, by its name."""

    def say(self, do: str, **fields: object) -> None:
        """Send an answer."""
        self.pipe.send(message(do, **fields))

    def drop(self) -> None:
        """End what is computed."""
        if self.run is not None:
            self.run.worker.kill()
        if self.explaining is not None:
            self.explaining.kill()
        self.run = self.explaining = None

    def work(self) -> None:
        """Wait for something to happen, and see to it."""
        run = self.run
        others = (None if run is None else run.worker, self.explaining)
        ready = wait([self.pipe, *(worker.pipe for worker in others if worker is not None)])
        if self.pipe in ready:
            question = self.pipe.recv()
            while question[0] == "hold" and self.pipe.poll():  # only the newest counts
                question = self.pipe.recv()
            self.answer(question)
            return
        if run is not None and run.worker.pipe in ready:
            candidates = run.session.task.candidates
            try:
                run.found.append(shared(candidates[len(run.found)], run.worker.receive()))
            except WorkerDied as error:
                raise bad_input("worker-died", "a process was killed; is there enough memory?") from error
            done, count = len(run.found), len(candidates)
            if done == count:
                self.run = None
                run.worker.close()
                self._ranked(run)
            else:
                run.worker.send(None)
                if not run.of_saved:
                    self.say("progress", done=done, of=count, number=run.number)
        if (explaining := self.explaining) is not None and explaining.pipe in ready:
            self.explaining = None
            detail = explaining.receive()
            explaining.close()
            self.pipe.send(detail)
            if self._chosen and not self.pipe.poll():
                self._base()  # so that a hand need not wait for it
                give_back_memory()  # nor for this: cells that are no longer shown refer to themselves

    def answer(self, question: Question) -> None:
        """Begin with what is asked, or say why that cannot be."""
        try:
            match question:
                case ("hold", move, number):
                    self._sketch(move, number)
                case ("show", name, _):
                    self._chosen = name
                    self._explain()
                case (word, asked, number):
                    self._begin(asked, number, of_saved=word == "compare")
        except InputError as error:
            if question[0] == "hold":  # refused once it is put down
                self.say("held", number=question[2])
            else:
                self.say("problems", number=question[2], problems=findings(error))

    # A ranking

    def _begin(self, asked: Asked, number: int, *, of_saved: bool) -> None:
        """Rank in the cell of a text; what depends on no camera is reused."""
        self.drop()
        cell, wanted = self._read(asked.content, number, of_saved=of_saved), WantedWay(asked.by)
        if self._task is not None and self._task[0] == asked.task:
            before = self._task[1]
            session = Session(before.task, replace(before.job, cell=cell, wanted=wanted))
        else:
            session = Session.begin(cell, TaskRequest(asked.task))
            job, keeps = replace(session.job, wanted=wanted), len(session.task.candidates) <= KEPT_PLANS
            session = Session(session.task, replace(job, plans=Plans()) if keeps else job)
            if keeps:
                self._task = asked.task, session
        plans, candidates = session.job.plans, session.task.candidates
        for candidate in candidates:
            if plans is None or self.pipe.poll():
                break  # plans are made where they are needed
            if not candidate.steps:
                plans.of(session.cell, candidate, session.job.world, fastest=False)
        about = (session.job, candidates, self.jobs)
        worker: Worker[None, CandidateResult] = Worker(forked(), _nicely, assess_all, *about, starts_others=True)
        worker.send(None)
        self.run = RankingRun(asked, number, of_saved, session, worker)

    def _read(self, content: bytes, number: int, *, of_saved: bool) -> Cell:
        """The cell of a text, of which browsers are told; only its cameras are new if nothing else is."""
        opened = OpenCell.read(self.path, self.seed, content)
        if opened.errors:
            raise InputError(*opened.errors)
        workspace, model = opened.workspace, self._model
        values = {path: value for path, value in workspace.values.items() if not path.startswith("cameras.")}
        others = [one for one in workspace.files.items() if one[0] != "workspace" and not one[0].startswith("cameras.")]
        kin = values, {role: file.digest for role, file in others}
        if self._cell is not None and kin == self._kin:
            cell = self._cell.with_cameras_of(workspace)
        else:
            self._task, model, cell = None, None, opened.cell
            if of_saved:
                self._model = None  # of another cell, which browsers have
        self._cell, self._kin = cell, kin
        if not of_saved:
            model = scene_model(cell) if model is None else model
            new = None if model == self._model else model  # browsers have it
            self._model = model
            self.say("cell", scene=ShowDocument.of(cell), model=new, number=number)
            self._sketches.clear()
        return cell

    def _ranked(self, run: RankingRun) -> None:
        ranking = [*map(described, rank(run.found, run.asked.by))]
        details = ["" if one.feasible else None for one in ranking]
        rows = [row(one) for one in candidate_rows(ranking, details)]
        fields = {"task": run.asked.task, "by": run.asked.by, "number": run.number, "entries": rows}
        if run.of_saved:
            self.say("saved-ranking", **fields)
            return
        self._ranking, self._session = {one.candidate.name: one for one in ranking}, run.session
        self.say("ranking", summary=f"{summary(ranking, run.asked.by)}.", **fields)
        if self._chosen not in self._ranking:
            self._chosen = next(iter(self._ranking))
        self._explain()

    # The chosen candidate

    def _explain(self) -> None:
        """Show the chosen candidate over time, once another process has computed that."""
        chosen = self._ranking.get(self._chosen)
        if chosen is None or self._session is None:
            return
        if self.explaining is not None:
            self.explaining.kill()
        self.explaining = Worker(forked(), _nicely, _detail, self._session.job, chosen)
        self.explaining.send(None)

    def _base(self) -> tuple[list[Sketch], CoverageShown] | None:
        """The chosen candidate's motions, and what is seen of them in the cell as it is written."""
        chosen = self._ranking.get(self._chosen)
        if self._chosen not in self._sketches and self._session is not None and chosen is not None and chosen.feasible:
            found = sketches_of(self._session.cell, [step.way for step in chosen.steps or (chosen,)])
            if not isinstance(found, Infeasible):
                self._sketches = {self._chosen: (found, joined(found, [one.seen_by(one.cell) for one in found]))}
        return self._sketches.get(self._chosen)

    def _sketch(self, move: Move, number: int) -> None:
        """Answer what the chosen candidate would be with something elsewhere."""
        self.drop()
        session, base = self._session, self._base()
        if session is None or base is None or (move.kind != "camera" and len(base[0]) > 1):
            self.say("held", number=number)
            return
        workspace, (sketches, shown) = moved(session.cell.workspace, move), base
        was = {"q_eoi": shown.q_eoi, "q_avg": shown.q_avg}  # as the cell is, at the same instants
        if move.kind == "camera":
            cell = session.cell.with_cameras_of(workspace)
            seen = joined(sketches, [one.seen_by(cell, move.name) for one in sketches])
            self.say("sketch", name=self._chosen, seen=seen, was=was, number=number)
            return
        cell = Cell.load(workspace, self.seed)
        alone = sketches_of(cell, [sketches[0].planned.candidate])
        if isinstance(alone, Infeasible):
            self.say("sketch", name=self._chosen, reasons=alone.reasons, number=number)
            return
        (found,) = alone
        # Where everything is at the instants of the sketch: poses (m, 4, 4) or (1, 4, 4), as they change.
        stage, samples, X_WF = found.planned.stage, found.samples, found.states.X_WF
        values, poses = [cell.model.joint_values(row) for row in stage.positions(samples)], {}
        for name in (name for name in workspace.objects if name in X_WF):
            X = X_WF[name]
            moves = np.flatnonzero(np.r_[True, np.any(X[1:] != X[:-1], axis=(1, 2))]).tolist()
            poses[name] = tuple((k, (*X[k, :3, 3].tolist(), *matrix_to_quaternion(X[k, :3, :3]))) for k in moves)
        q = np.array([list(one.values()) for one in values])
        track = track_shown(Track(samples.t, tuple(values[0]), q, tuple(stage.held(samples)), poses))
        self.say("sketch", name=self._chosen, seen=found.seen_by(cell), was=was, track=track, number=number)


def sketches_of(cell: Cell, ways: Sequence[Candidate]) -> list[Sketch] | Infeasible:
    """The motions of a candidate in a cell, a sketch for the way of each step; or why one is not possible there."""
    sketches = list[Sketch]()
    for planned in planned_steps(cell, ways, cell.initial_world):
        if isinstance(planned, Infeasible):
            return planned
        sketches.append(Sketch.of(cell, planned))
    return sketches

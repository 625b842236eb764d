"""The process that computes for the studio: rankings in forked processes, sketches at once.

A later question supersedes an earlier one: what is still computed for that is ended.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.ask.api.session import Session
from sqrp_cli.ask.requests import TaskRequest
from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible, InputError, Problem, bad_input
from sqrp_cli.geometry import matrix_to_quaternion
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.memory import give_back_memory, keep_all_so_far
from sqrp_cli.platform.processes import Worker, WorkerDied, forked
from sqrp_cli.run.record.log import Track
from sqrp_cli.show.documents.scene import ShowDocument
from sqrp_cli.show.pages.assembly import row
from sqrp_cli.show.pages.candidate_page import candidate_rows, played, scene_model
from sqrp_cli.show.pages.run_page import track_shown
from sqrp_cli.show.sentences import summary
from sqrp_cli.sight.sight_memory import Seen, SightMemory
from sqrp_cli.studio.messages import Hold, Question, Rank, findings, message
from sqrp_cli.studio.moves import moved
from sqrp_cli.studio.sketch import CoverageShown, Sketch, joined
from sqrp_cli.study.assessment import planned_motion
from sqrp_cli.study.find import Plans, WantedWay
from sqrp_cli.study.pipeline import RankJob, described
from sqrp_cli.study.program_update import world_after
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.task.candidate import Candidate
from sqrp_cli.task.feasibility import feasible_motion

KEPT_PLANS = 64  # motions of so many candidates at most are kept for other cameras
LOWER_PRIORITY = 10  # by how much processes that take longer are nicer than others: browser and sketches go first

_Answer = tuple[CandidateResult, Sequence[Seen]]
"""Of a process that assesses a candidate, with what it learnt of what cameras see."""


class RankingRun:
    """A ranking under way."""

    def __init__(self, asked: Rank, session: Session, jobs: int, memory: SightMemory) -> None:
        """jobs: processes at most. memory: of the session's cell; what the processes learn is added to it."""
        self.asked, self.session, self._memory = asked, session, memory
        candidates = session.task.candidates
        memory.learnt.clear()  # by this process, which need not be told; the others begin with what it knows
        self._left, self.found = deque(range(len(candidates))), dict[int, CandidateResult]()
        workers = [
            Worker(forked(), _assessor, session.assignment, candidates, memory)
            for _ in range(min(jobs, len(candidates)))
        ]
        self.workers: dict[Worker[int, _Answer], int | None] = dict.fromkeys(workers)
        """The candidate that each computes; None if it computes none."""
        for worker in workers:
            self._hand_out(worker)

    def take(self, worker: Worker[int, _Answer]) -> None:
        """Take the answer of a busy process. Raises InputError where it was killed."""
        index = self.workers[worker]
        assert index is not None  # noqa: S101 - it is busy
        try:
            assessment, learnt = worker.receive()
        except WorkerDied as error:
            raise bad_input("worker-died", "a process was killed; is there enough memory?") from error
        candidate = self.session.task.candidates[index]
        way = assessment.best_way and replace(assessment.best_way, skill=candidate.skill)
        self.found[index] = replace(assessment, candidate=candidate, best_way=way)
        for seen in learnt:
            self._memory.take(seen)
        self._hand_out(worker)

    def end(self) -> None:
        """End all processes at once."""
        for worker in self.workers:
            worker.kill()

    def _hand_out(self, worker: Worker[int, _Answer]) -> None:
        self.workers[worker] = index = self._left.popleft() if self._left else None
        if index is not None:
            worker.send(index)


def _assessor(assignment: RankJob, candidates: Sequence[Candidate], memory: SightMemory) -> Callable[[int], _Answer]:
    os.nice(LOWER_PRIORITY)
    os.nice(LOWER_PRIORITY)

    def assess(index: int) -> _Answer:
        memory.learnt.clear()
        return assignment.assess(candidates[index]), memory.learnt

    return assess


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
                internal = Problem("internal-error", f"internal error: {type(error).__name__}: {error}")
                problems = error.problems if isinstance(error, InputError) else (internal,)
                serving.say("problems", number=None, problems=findings(problems))
    serving.drop()


class _Worker:
    def __init__(self, pipe: Connection, path: Path, seed: int, jobs: int) -> None:
        self._pipe, self._path, self._seed, self._jobs = pipe, path, seed, jobs
        self._cell: Cell | None = None
        self._kin: object = None
        self._memory = SightMemory()
        self._model: Mapping[str, object] | None = None
        self._task: tuple[str, Session] | None = None
        """The last task with plans, as it was asked for; None once anything but cameras has changed."""
        self._run: RankingRun | None = None
        self._ranking: list[CandidateResult] = []
        self._session: Session | None = None
        self._chosen = ""
        self._explaining: Worker[str, str] | None = None
        self._sketches: dict[str, tuple[list[Sketch], CoverageShown]] = {}  # of the chosen candidate, by its name

    def say(self, do: str, **fields: object) -> None:
        """Send an answer."""
        self._pipe.send(message(do, **fields))

    def drop(self) -> None:
        """End what is computed."""
        if self._run is not None:
            self._run.end()
        if self._explaining is not None:
            self._explaining.kill()
        self._run = self._explaining = None

    def work(self) -> None:
        """Wait for something to happen, and see to it."""
        computing = {} if self._run is None else self._run.workers
        workers = [worker for worker, index in computing.items() if index is not None]
        others: list[Worker[Any, Any]] = [*workers, *([] if self._explaining is None else [self._explaining])]
        ready = wait([self._pipe, *(worker.pipe for worker in others)])
        if self._pipe in ready:
            question = self._pipe.recv()
            while isinstance(question, Hold) and self._pipe.poll():  # only the newest counts
                question = self._pipe.recv()
            self._answer(question)
            return
        for worker in workers:
            if worker.pipe in ready and self._run is not None:
                run = self._run
                run.take(worker)
                done, count = len(run.found), len(run.session.task.candidates)
                if done == count:
                    run.end()
                    self._run = None
                    self._ranked(run)
                elif not run.asked.of_saved:
                    self.say("progress", done=done, of=count, number=run.asked.number)
        if (explaining := self._explaining) is not None and explaining.pipe in ready:
            self._explaining = None
            detail = explaining.receive()
            explaining.close()
            self._pipe.send(detail)
            if self._chosen and not self._pipe.poll():
                self._base()  # so that a hand need not wait for it
                give_back_memory()  # nor for this: cells that are no longer shown refer to themselves

    def _answer(self, question: Question) -> None:
        number = getattr(question, "number", None)
        try:
            match question:
                case Rank():
                    self._begin(question)
                case Hold():
                    self._sketch(question)
                case str(name):
                    self._chosen = name
                    self._explain()
        except InputError as error:
            if isinstance(question, Hold):  # refused once it is put down
                self.say("held", number=number)
            else:
                self.say("problems", number=number, problems=findings(error.problems))

    # A ranking

    def _begin(self, asked: Rank) -> None:
        """Rank in the cell of a text; what depends on no camera is reused."""
        self.drop()
        cell, wanted = self._read(asked), WantedWay(asked.by)
        if self._task is not None and self._task[0] == asked.task:
            before = self._task[1]
            session = Session(before.task, replace(before.assignment, cell=cell, wanted=wanted))
        else:
            session = Session.begin(cell, TaskRequest(asked.task))
            assignment, keeps = replace(session.assignment, wanted=wanted), len(session.task.candidates) <= KEPT_PLANS
            session = Session(session.task, replace(assignment, plans=Plans()) if keeps else assignment)
            if keeps:
                self._task = asked.task, session
        keep_all_so_far()
        plans = session.assignment.plans
        for candidate in session.task.candidates:
            if plans is None or self._pipe.poll():
                break  # plans are made where they are needed
            if not candidate.steps:
                plans.of(session.cell, candidate, session.assignment.world, fastest=False)
        self._run = RankingRun(asked, session, self._jobs, self._memory)

    def _read(self, asked: Rank) -> Cell:
        """The cell of a text, of which browsers are told; only its cameras are new if nothing else is."""
        opened = OpenCell.read(self._path, self._seed, asked.content)
        if opened.errors:
            raise InputError(*opened.errors)
        # What decides motions and requirements: equal for workspaces that differ in their cameras only.
        workspace, model = opened.workspace, self._model
        values = {path: value for path, value in workspace.values.items() if not path.startswith("cameras.")}
        others = [one for one in workspace.files.items() if one[0] != "workspace" and not one[0].startswith("cameras.")]
        kin = values, {role: file.digest for role, file in others}
        if self._cell is not None and kin == self._kin:
            cell = self._cell.seen_by(workspace)
        else:
            self._memory, self._task, model = SightMemory(), None, None
            cell = replace(opened.cell, observer=replace(opened.cell.observer, memory=self._memory))
            if asked.of_saved:
                self._model = None  # of another cell, which browsers have
        self._cell, self._kin = cell, kin
        if not asked.of_saved:
            model = scene_model(cell) if model is None else model
            new = None if model == self._model else model  # browsers have it
            self._model = model
            self.say("cell", scene=ShowDocument.of(cell), model=new, number=asked.number)
            self._sketches.clear()
        return cell

    def _ranked(self, run: RankingRun) -> None:
        found = [run.found[index] for index in range(len(run.found))]
        ranking = [*map(described, rank(found, run.asked.by))]
        details = ["" if one.feasible else None for one in ranking]
        rows = [row(one) for one in candidate_rows(ranking, details)]
        fields = {"task": run.asked.task, "by": run.asked.by, "number": run.asked.number, "entries": rows}
        if run.asked.of_saved:
            self.say("saved-ranking", **fields)
            return
        self._ranking, self._session = ranking, run.session
        self.say("ranking", summary=f"{summary(ranking, run.asked.by)}.", **fields)
        if self._find(self._chosen) is None:
            self._chosen = ranking[0].candidate.name
        self._explain()

    # The chosen candidate

    def _find(self, name: str) -> CandidateResult | None:
        return next((one for one in self._ranking if one.candidate.name == name), None)

    def _explain(self) -> None:
        """Show the chosen candidate over time, once another process has computed that."""
        chosen = self._find(self._chosen)
        if chosen is None or self._session is None:
            return
        if self._explaining is not None:
            self._explaining.kill()
        self._explaining = Worker(forked(), _explainer, self._session.assignment, chosen)
        self._explaining.send(self._chosen)

    def _base(self) -> tuple[list[Sketch], CoverageShown] | None:
        """The chosen candidate's motions, and what is seen of them in the cell as it is written."""
        chosen = self._find(self._chosen)
        if self._chosen not in self._sketches and self._session is not None and chosen is not None and chosen.feasible:
            found = sketches_of(self._session.cell, chosen)
            self._sketches = {self._chosen: (found, joined(found, [one.shown for one in found]))} if found else {}
        return self._sketches.get(self._chosen)

    def _sketch(self, asked: Hold) -> None:
        """Answer what the chosen candidate would be with something elsewhere."""
        self.drop()
        session, base = self._session, self._base()
        if session is None or base is None or (asked.move.kind != "camera" and len(base[0]) > 1):
            self.say("held", number=asked.number)
            return
        workspace, (sketches, shown) = moved(session.cell.workspace, asked.move), base
        was = {"q_eoi": shown.q_eoi, "q_avg": shown.q_avg}  # as the cell is, at the same instants
        if asked.move.kind == "camera":
            cell = session.cell.seen_by(workspace)
            seen = joined(sketches, [one.seen_by(cell, asked.move.name) for one in sketches])
            self.say("sketch", name=self._chosen, seen=seen, was=was, number=asked.number)
            return
        cell = Cell.load(workspace, self._seed)
        found = _sketched(cell, sketches[0].scene.candidate, cell.initial_world)
        if isinstance(found, Infeasible):
            self.say("sketch", name=self._chosen, reasons=found.reasons, number=asked.number)
            return
        seen, track = found.seen_by(cell), _track(found)
        self.say("sketch", name=self._chosen, seen=seen, was=was, track=track, number=asked.number)


def _explainer(assignment: RankJob, ranked: CandidateResult) -> Callable[[str], str]:
    os.nice(LOWER_PRIORITY)
    os.nice(LOWER_PRIORITY)

    def explain(name: str) -> str:
        explained = assignment.explain(ranked)
        detail = played(assignment, explained, brief=True) if ranked.feasible else None
        return message("detail", name=name, detail=detail)

    return explain


def sketches_of(cell: Cell, assessment: CandidateResult) -> list[Sketch]:
    """The motions of a feasible candidate in a cell, a sketch for each step; none if it has none there."""
    world, sketches = cell.initial_world, list[Sketch]()
    for step in assessment.steps or (assessment,):
        found = _sketched(cell, step.way, world)
        if isinstance(found, Infeasible):
            return []
        sketches.append(found)
        world = world_after(step.way, found.scene.motion, world)
    return sketches


def _sketched(cell: Cell, way: Candidate, world: World) -> Sketch | Infeasible:
    """The motion of a way in a cell, from a world."""
    motion = feasible_motion(cell, way, world)
    return motion if isinstance(motion, Infeasible) else Sketch.of(cell, planned_motion(cell, way, world, motion))


def _track(sketch: Sketch) -> Mapping[str, object]:
    """Where everything is at the instants of a sketch."""
    stage, samples, model = sketch.scene.stage, sketch.samples, sketch.cell.model
    values, X_WF = [model.joint_values(row) for row in stage.positions(samples)], sketch.states.X_WF
    poses = {}
    for name in (name for name in sketch.cell.workspace.objects if name in X_WF):
        X = X_WF[name]  # shape (m, 4, 4) or (1, 4, 4)
        moves = np.flatnonzero(np.r_[True, np.any(X[1:] != X[:-1], axis=(1, 2))]).tolist()
        poses[name] = tuple((k, (*X[k, :3, 3].tolist(), *matrix_to_quaternion(X[k, :3, :3]))) for k in moves)
    q = np.array([list(one.values()) for one in values])
    return track_shown(Track(samples.t, tuple(values[0]), q, tuple(stage.held(samples)), poses))

"""Advice about a task: what is asked of the search, and the workspace file with a change."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sqrp_cli.ask.api.session import Session, assess, check_choice, choose_candidate
from sqrp_cli.cell.edits import stated_look_at, with_camera, with_further_camera, with_pose, with_task
from sqrp_cli.cell.workspace_file import read_again
from sqrp_cli.checks.lint import assumptions
from sqrp_cli.errors import InputError, bad_option
from sqrp_cli.figures import AdvisedFigures
from sqrp_cli.files.entries import from_fields
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.yaml_edit import patch
from sqrp_cli.geometry import inverse, read_only
from sqrp_cli.score.kept import Results, kept_search
from sqrp_cli.search.advice_result import AdviceDocument, AdviceFound, KindOutcome
from sqrp_cli.search.advise import outcomes
from sqrp_cli.search.aiming import Aim
from sqrp_cli.search.goal import KINDS, goal_of, read_goal
from sqrp_cli.search.question import ProposedChange, Question, TaskWays, figures_of, is_fastest
from sqrp_cli.search.suggestion import Suggester, with_first_steps
from sqrp_cli.study.find import Plans
from sqrp_cli.study.pipeline import assess_all
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.whole_analysis import whole_analysis
from sqrp_cli.task.candidate import THEN
from sqrp_cli.task.grips import first_grip
from sqrp_cli.task.task import Candidate, in_words, read_task

if TYPE_CHECKING:
    from sqrp_cli.ask.requests import AdviseRequest
    from sqrp_cli.motion.cell import Cell


_THRESHOLDS = ("min_q_eoi", "min_q_avg", "max_time", "max_delay")  # of a task in a workspace


def changed_file(question: Question, file: SourceDocument, change: ProposedChange) -> bytes:
    """The workspace file with a change. Raises InputError for what it does not say itself."""
    workspace = question.cell.workspace
    if change.unwritten:
        raise bad_option(change.unwritten)
    if change.parameters is not None:
        key = _key(question.best.candidate)
        listed = ((one.task, read_task(one.task, workspace).candidates) for one in workspace.tasks)
        alone = next((text for text, candidates in listed if list(map(_key, candidates)) == [key]), None)
        goal = question.goal
        figures = zip(_THRESHOLDS, (goal.q_eoi, goal.q_avg, goal.time, goal.delay), strict=True)
        thresholds = {name: value for name, value in figures if value is not None}
        # The text of a task that says this way, and has this candidate alone.
        candidate, texts = question.best.candidate, []
        for number, step in enumerate(candidate.steps or (candidate,), 1):
            own, text = change.parameters, step.task
            if candidate.steps:
                start = f"{number}."
                own = {name.removeprefix(start): one for name, one in own.items() if name.startswith(start)}
            if any(one.binding != step.binding for one in read_task(text, workspace).candidates):
                text = " ".join([step.skill.name, *(f"{name}={one}" for name, one in step.binding.items())])
            unsaid = [one.all_parameters for one in read_task(text, workspace).candidates]
            differing = {name: value for name, value in own.items() if any(one.get(name) != value for one in unsaid)}
            said = in_words(step.skill, differing)
            texts.append(" ".join([text, *(f"{name}={value.replace(' ', '')}" for name, value in said.items())]))
        return with_task(file, THEN.join(texts), thresholds, instead_of=alone)
    if change.X_WO is not None:
        stated = workspace.objects[change.target]
        now = question.world.X_WO.get(change.target)
        if stated.X_WO is None or now is None or not np.array_equal(stated.X_WO, now):
            message = f"the program before has moved `{change.target}`, so its place is no line of the workspace"
            raise bad_option(message, mend="change the program that puts it there")
        return with_pose(file, ("objects", change.target, "pose"), change.X_WO @ inverse(stated.X_FO))
    camera, aim = change.camera, change.aim
    assert camera is not None and aim is not None  # noqa: S101, PT018 - nothing else is left to change
    present = workspace.cameras.get(camera.name)
    if present is not None:
        return with_camera(file, present, camera, aim.point)
    return with_further_camera(file, camera, change.lens_of, aim.point)


def _with_patch(question: Question, file: SourceDocument, one: AdviceFound) -> AdviceFound:
    """An advice with the workspace file that says it, and the difference; or why none does."""
    try:
        content = changed_file(question, file, one.proposed)
    except InputError as error:
        return replace(one, content=error, unwritten=error.problems[0].message)
    if content == file.content:
        return replace(one, content=content, unwritten="the workspace says it already")
    return replace(one, content=content, patch=patch(file, content))


def find_advice(cell: Cell, ask: AdviseRequest, content: bytes | None = None) -> AdviceDocument:
    """The least changes that meet a goal; at Ctrl-C what was found so far.

    content: of the workspace file, where it is not that on the disk. Raises InputError for a goal or a choice that
    cannot be read, and for a folder that cannot be used.
    """
    session = Session.begin(cell, ask)
    session = replace(session, job=replace(session.job, plans=Plans()))
    workspace, came, interrupted = session.cell.workspace, list[KindOutcome](), None
    with closing(Results(ask.out)) as results:
        question = _question(session, ask)
        goal, best = question.goal, question.best
        found = AdviceDocument(
            workspace=workspace.name,
            task=session.task.text,
            want=goal,
            candidate=best.candidate.name,
            way=question.way.parameters,
            met=goal.met(question.before),
            before=from_fields(AdvisedFigures, question.before),
            best=from_fields(AdvisedFigures, best) if goal.met(best) else None,
            ways="first" if question.fixed else "best",
            starts_fastest=is_fastest(question.before),
            assumed=assumptions(workspace, best.candidate.binding.values()),
            question=question,
        )
        if found.met:
            return found
        if not best.feasible and not best.candidate.steps:
            suggester = Suggester(session.cell, question.world, jobs=ask.jobs)
            found = replace(found, first=suggester.suggest(best.candidate).advice or None)
        remembered = partial(kept_search, results, _all_it_depends_on(session, question), [*workspace.skills.values()])
        try:
            with ask.progress(f"Searching for {goal}", len(KINDS if ask.kinds is None else ask.kinds)) as advance:
                for outcome in outcomes(question, remembered):
                    came.append(outcome)
                    advance(1)
        except KeyboardInterrupt:
            interrupted = True
    advice, file = tuple(one for outcome in came for one in outcome.advice), None
    try:
        file = read_again(workspace.whole_file.file, workspace.files["workspace"].digest, content)
        advice = tuple(_with_patch(question, file, one) for one in advice)
    except InputError as error:  # the file has changed meanwhile
        advice = tuple(replace(one, content=error, unwritten=error.problems[0].message) for one in advice)
    near = [outcome.nearest for outcome in came if outcome.nearest is not None]
    nearest = None if advice else min(near, key=lambda one: goal.shortfall(one.found), default=None)
    return replace(found, advice=advice, kinds=tuple(came), nearest=nearest, interrupted=interrupted, file=file)


def _question(session: Session, ask: AdviseRequest) -> Question:
    """What is to be met by which candidate, once all candidates are assessed."""
    workspace, job = session.cell.workspace, session.job
    check_choice(session.task, ask.choose)
    expected = next((task for task in workspace.tasks if task.task == session.task.text), None)
    goal = goal_of(expected) if ask.want is None else read_goal(ask.want)
    results = list(assess(session, ask))
    chosen = choose_candidate(rank(results, "q_eoi"), ask.choose).candidate
    best = next(one for one in results if one.candidate is chosen)
    stated = {name: stated_look_at(workspace, name) for name in workspace.cameras}
    fastest = first_grip(best.candidate)
    found = figures_of(fastest, whole_analysis(session.cell, fastest, job.world, job.sampling, full=False))
    before = replace(found, candidate=best.candidate, best_way=found.candidate)
    return Question(
        task=session.task.text,
        cell=session.cell,
        world=job.world,
        sampling=job.sampling,
        fastest=fastest,
        before=best if goal.met(before) and not goal.met(best) else before,
        best=best,
        results=results,
        goal=goal,
        aims={name: Aim(*map(read_only, aim)) for name, aim in stated.items() if aim is not None},
        affected=lambda: _listed(session, results, best, ask.jobs),
        plans=job.plans,
        kinds=ask.kinds,
        fixed=job.wanted.fastest,
        jobs=ask.jobs,
    )


def _all_it_depends_on(session: Session, question: Question) -> tuple[object, ...]:
    """All that the answer of a kind depends on in addition to the kind and the program: the key of kept searches."""
    world, sampling = question.world, question.sampling
    return (
        session.cell.workspace.digest,
        question.task,
        question.best.candidate.name,
        vars(question.goal),
        {"sampling": type(sampling).__name__, **asdict(sampling)},
        session.cell.seed,
        question.fixed,
        dict(world.X_WO),
        dict(world.joints),
        world.held,
        world.X_TO,
        sorted(map(str, world.facts)),
    )


def _listed(session: Session, results: Sequence[CandidateResult], chosen: CandidateResult, jobs: int) -> list[TaskWays]:
    """Every task of the workspace, and the one that was asked for, with the ways in which candidates are done.

    Tasks that need others first are done with these, as `score` does. results: of the task that was asked for.
    chosen: the one that advice is about, which alone counts of a task that the workspace does not list.
    """
    workspace, job = session.cell.workspace, session.job
    facts = job.world.facts
    known = {_key(one.candidate): one.way for one in results}
    found: list[TaskWays] = []
    for listed in workspace.tasks:
        task = read_task(listed.task, workspace, facts)
        if listed.feasible is not False:
            task = with_first_steps(task, workspace, facts)
        candidates = task.candidates
        if job.wanted.fastest:
            ways = tuple(map(first_grip, candidates))
        else:
            missing = [one for one in candidates if _key(one) not in known]
            known |= {_key(one.candidate): one.way for one in assess_all(job, missing, jobs)}
            ways = tuple(replace(known[_key(one)], name=one.name) for one in candidates)
        found.append((listed.task, ways))
    if all(text != session.task.text for text, _ in found):
        found.append((session.task.text, (chosen.way,)))
    return found


def _key(candidate: Candidate) -> str:
    """What tells candidates apart."""
    return repr((candidate.skill.name, sorted(candidate.binding.items()), sorted(candidate.values.items())))

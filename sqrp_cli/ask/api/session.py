"""A task in a cell: its world and candidates, the chosen candidate, and the program step that it becomes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask import values
from sqrp_cli.cell.recordings import USUAL_SIZE
from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible, InputError, Place, bad_input, bad_option, expected_names, first_names
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.files import alone, check_writable, real_path
from sqrp_cli.records import dataclass
from sqrp_cli.show.documents.analysis_shown import analysis_shown
from sqrp_cli.show.documents.explanation import ExplainedAll, ExplainedCandidate, Explanation
from sqrp_cli.study.analysis import analyse
from sqrp_cli.study.pipeline import Explained, RankJob, assess_all, described, recalibrated, sampling_done
from sqrp_cli.study.program_update import make_step, with_usual_images
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.result import CandidateResult, Ranking
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.whole_analysis import worst_seen
from sqrp_cli.task.candidate import split_steps
from sqrp_cli.task.grips import first_grip
from sqrp_cli.task.task import Task, read_task

if TYPE_CHECKING:
    from sqrp_cli.ask.requests import ExplainRequest, RankRequest, TaskRequest
    from sqrp_cli.program.record import Program
    from sqrp_cli.search.planned_step import PlannedStep


@dataclass(frozen=True, eq=False)
class Session:
    """A task in a cell."""

    task: Task
    job: RankJob
    again: int = 0
    """How many of the last steps of the program that is written are of this task already: they are replaced."""
    anew: bool = False
    """Whether these are all its steps, of the workspace before it was changed: the program is written anew."""
    windows: float | None = None  # how long a camera needs a free view, if that is asked for [s]

    @property
    def cell(self) -> Cell:
        """The cell."""
        return self.job.cell

    @classmethod
    def begin(cls, cell: Cell, ask: TaskRequest, written: Path | None = None) -> Session:
        """Read the task, and load the world to start from: that in which the program `after` ends, or the workspace's.

        written: the program to be continued, where it ends; one whose last step is of the same task, from the same
        world, is made again from there on, unless `after` names it, too. Where that is all of it, the workspace may
        have changed since it was written. Raises InputError for input that cannot be used.
        """
        after = None if ask.after is None else Path(ask.after)
        world, again, anew = cell.initial_world, 0, False
        if after is not None:
            from sqrp_cli.program.file import check_program, load_program

            check_program(before := load_program(after), after, cell.workspace)
            world = before.steps[-1].after if before.steps else world
        if written is not None and written.exists() and (after is None or real_path(after) != real_path(written)):
            again, start, anew = _goes_on(written, ask.task, cell)
            if after is not None and not (again and _same(start, world)):
                raise _continues_elsewhere(written, after)
            world = start
        task = read_task(ask.task, cell.workspace, world.facts)
        if task.skill.recorded is not None:
            # What makes no sense of a recording: its motions are what they are.
            for name, value, why in (
                ("program", written, "no program can be written of it"),
                ("after", ask.after, "it begins where it began"),
                ("ways", ask.ways if ask.ways != "best" else None, "each episode is done in one way only"),
                ("max_time", getattr(ask, "max_time", None), "its episodes take as long as they took"),
            ):
                if value is not None:
                    option = ask.called(name) if name != "program" else "--program"
                    raise bad_option(f"`{ask.task}` is a recording, so {why}", mend=f"leave {option} out")
        job = ask.job(cell, world)
        if job.wanted.fastest:
            task = replace(task, candidates=tuple(map(first_grip, task.candidates)))
        return cls(task, job, again, anew, getattr(ask, "windows", None))

    def ranking(self, found: Sequence[CandidateResult], ask: RankRequest, *, interrupted: bool = False) -> Ranking:
        """What is found of the candidates, ranked; interrupted: whether some are missing."""
        job = self.job
        drawn = None if job.calibration is None else recalibrated(found, ask.by, job.calibration)
        ranked = list(rank(found, ask.by))
        place = sum(one.feasible for one in ranked) - 1
        if place >= 0 and not job.verdicts:
            ranked[place] = job.add_verdict(ranked[place])
        from sqrp_cli.checks.lint import assumptions

        named = {name for one in ranked for name in one.candidate.binding.values()}
        recording, stated = self.cell.workspace.recordings.get(self.task.skill.name), self.cell.workspace.places
        handled = {} if recording is None else {name: one.size for name, one in recording.objects.items()}
        guessed = [name for name, size in handled.items() if size is None and f"objects.{name}" not in stated]
        sizes = f"{first_names(guessed)} is taken to be {100 * USUAL_SIZE:g} cm wide" if guessed else ""
        if ask.worst:
            ranked[: place + 1] = ranked[place::-1] if place >= 0 else []
        return Ranking(
            workspace=self.cell.workspace.name,
            task=self.task.text,
            by=ask.by,
            ways=ask.ways,
            sampling=sampling_done(job.sampling, found),
            calibration=drawn,
            interrupted=interrupted or None,
            worst_first=ask.worst,
            of=len(self.task.candidates),
            assumed="; ".join(filter(None, [sizes, assumptions(self.cell.workspace, named)])),
            candidates=tuple(map(described, ranked)),
            session=self,
        )

    def shown(self, one: Explained) -> ExplainedCandidate:
        """All that is found about one candidate."""
        return analysis_shown(self.cell, one.analysis, one.result, self.job.sampling, self.windows)

    def explanation(self, explained: Explained, ranking: Sequence[CandidateResult], **step: object) -> Explanation:
        """What is found about one candidate of a ranking; step: fields of the document, if it is one of several."""
        about = {"workspace": self.cell.workspace.name, "task": self.task.text, "ranking": ranking}
        return Explanation(**{**vars(self.shown(explained)), **step, **about, "explained": explained})

    def write(self, ranking: Ranking, path: str | Path, choose: str) -> None:
        """Write a candidate of a ranking into a program file; see `Ranking.write`."""
        file = values.path.read(path, "path")
        values.text("the name of a candidate, or `best`").read(choose, "choose")
        check_choice(self.task, choose)
        chosen = choose_candidate(ranking.candidates, choose)
        if not chosen.feasible:
            raise bad_option(f"{chosen.name} cannot be done ({chosen.reasons[0]}), so {file} was not written")
        again, start, _ = _goes_on(file, self.task.text, self.cell) if file.exists() else (0, self.job.world, False)
        replaced = again if _same(start, self.job.world) else 0
        add_steps(self.cell, steps_of(self, chosen), self.job.sampling, file, replaced)


def _same(one: World, other: World) -> bool:
    """Whether files would say the same of two worlds."""
    from pydantic import TypeAdapter

    dump = TypeAdapter(World).dump_python
    return bool(dump(one) == dump(other))


def _goes_on(path: Path, text: str, cell: Cell) -> tuple[int, World, bool]:
    """How many last steps of a program a task replaces, the world it starts from, and whether that is all anew."""
    from sqrp_cli.program.file import check_program, load_program

    steps = (program := load_program(path)).steps
    last, again = steps[-len(split_steps(text)) :], 0  # all that the task became, or none
    if len(last) == 1:
        again = int(last[0].task == text)
    elif last:
        candidates = read_task(text, cell.workspace, last[0].before.facts).candidates
        known = [[one.task for one in candidate.steps] for candidate in candidates]
        again = len(last) if [step.task for step in last] in known else 0
    anew = check_program(program, path, cell.workspace, again)
    start = cell.initial_world if anew or not steps else steps[-again].before if again else steps[-1].after
    return again, start, anew


def assess(session: Session, ask: TaskRequest) -> Iterator[CandidateResult]:
    """The results of all candidates, in order, with the progress shown."""
    with ask.progress(f"Assessing {session.task.text}", len(session.task.candidates)) as advance:
        for result in assess_all(session.job, session.task.candidates, ask.jobs):
            yield result
            advance(1)


def check_choice(task: Task, choice: str) -> None:
    """Raises InputError for a name that no candidate has, or a place in no ranking, before any of them is computed."""
    names = [candidate.name for candidate in task.candidates]
    if choice == "best" or any(set(choice.split()) <= set(name.split()) for name in names):
        return
    if choice.isdecimal():
        if not 1 <= int(choice) <= len(names):
            upto = f" to {len(names)} (what cannot be done comes last)" if len(names) > 1 else ""
            message = f"there is no place {choice} in a ranking of {len(names)} candidate{'s' * (len(names) != 1)}"
            message += f"; expected 1{upto}, or the name of one"
            raise bad_input("unknown-candidate", message)
    else:
        raise bad_input("unknown-candidate", f"there is no candidate `{choice}`; {expected_names(choice, names)}")


def choose_candidate(ranking: Sequence[CandidateResult], choice: str) -> CandidateResult:
    """The candidate that `choice` means: the first of the ranking, the first whose name has all its words, a place."""
    if choice == "best":
        return ranking[0]
    named = (ranked for ranked in ranking if set(choice.split()) <= set(ranked.candidate.name.split()))
    return next(named, None) or ranking[int(choice) - 1]


def world_before(after: Path | None, program: Path | None) -> Path | None:
    """The program after which a task starts: an appended step starts where its program ends.

    Raises InputError if that contradicts `--after`, or if the program cannot be written.
    """
    if program is None:
        return after
    check_writable(program)
    if not program.exists():
        return after
    if after is not None and real_path(after) != real_path(program):
        raise _continues_elsewhere(program, after)
    return program


def _continues_elsewhere(program: Path, after: Path) -> InputError:
    message = f"{program} exists, so its next step starts where it ends and not where {after} does"
    return bad_option(message, mend="leave out --after, or name a new file after --program")


ChosenStep = tuple[str, CandidateResult, World]
"""What is appended to a program: the text of a task, a feasible candidate of it, and the world that it starts from."""


def steps_of(session: Session, chosen: CandidateResult) -> list[ChosenStep]:
    """What a feasible candidate appends to a program: a step, or several."""
    job = session.job
    if not chosen.candidate.steps:
        return [(session.task.text, chosen, job.world)]
    done = job.steps_done(chosen.candidate)
    return [(one.candidate.task, one, before) for one, before in done]


def explained(session: Session, ask: ExplainRequest) -> Explanation | ExplainedAll:
    """What is asked about the candidates of a task. Raises InputError for what there is not."""
    choose, steps, option = ask.choose, session.task.candidates[0].steps, ask.called("step")
    check_choice(session.task, "best" if choose is None else choose)
    if ask.step is not None and not steps:
        raise bad_option(f"{option} is {ask.step}, but `{ask.task}` is a task of one step")
    if choose is None and steps:
        message = f"`{session.task.text}` has several steps, and --all looks at one"
        mend = "write the steps before it with `sqrp rank ... --program FILE`, then ask about it with `--after FILE`"
        raise bad_option(message, mend=mend)
    ranking = rank(list(assess(session, ask)), "q_eoi")
    place, chosen = dict[str, object](), ranking
    if choose is not None:
        chosen = (choose_candidate(ranking, choose),)
    if choose is not None and steps:
        # A step as a task of its own, in the world that the steps before it leave: by default the one seen worst.
        whole = chosen[0]
        done = session.job.steps_done(whole.candidate)
        number = 1 + worst_seen([one for one, _ in done]) if ask.step is None else ask.step
        if not 1 <= number <= len(done):
            raise bad_option(f"{option} is {number}, expected a step of {whole.candidate.name}: 1 to {len(done)}")
        step, before = done[number - 1]
        task = Task(step.candidate.task, step.candidate.skill, (step.candidate,))
        session = Session(task, replace(session.job, world=before))
        chosen = ranking = rank([step], "q_eoi")
        place = {"step": number, "of_steps": len(steps), "whole": whole.candidate.name}
        place |= {"rank": whole.rank, "pareto": whole.pareto}
    found = []
    with ask.progress("Looking up causes", len(chosen)) as advance:
        for result in chosen:
            found.append(session.job.explain(result))
            advance(1)
    if choose is not None:
        return session.explanation(found[0], ranking, **place)
    shown = list(map(session.shown, found))
    name = session.cell.workspace.name
    return ExplainedAll(workspace=name, task=ask.task, candidates=shown, explained=found, ranking=ranking)


def chosen_steps(suggested: Sequence[PlannedStep]) -> list[ChosenStep]:
    """The steps of a suggestion, all of which are feasible."""
    return [(step.task, step.result, step.world) for step in suggested if step.result and step.world]


def add_steps(cell: Cell, steps: Sequence[ChosenStep], sampling: Sampling, path: Path, replaced: int = 0) -> Program:
    """Append steps to a program file, all or none; it is created if it does not exist. Returns the program.

    replaced: how many of its last steps make room for them.

    Raises InputError if the file has changed meanwhile, so that the steps do not begin where it ends.
    """
    from sqrp_cli.program.file import check_program, load_program, made_for, new_program, save_program

    cameras = tuple(camera.name for camera in cell.observer.cameras)
    added = []
    for task, chosen, world in steps:
        found = analyse(cell, chosen.way, world, sampling, full=True)
        if isinstance(found, Infeasible):
            raise ValueError(f"{chosen.candidate.name} is infeasible: {found.reasons[0]}")
        step = make_step(task, found, chosen, cameras)
        added.append(with_usual_images(step, found, cell.observer))
    with alone(path):
        program = load_program(path) if path.exists() else None
        if program is None or check_program(program, path, cell.workspace, replaced):
            program = new_program(cell.workspace, cell.model.joints, path)
        there = program.steps[: len(program.steps) - replaced]
        program = program.model_copy(update={"steps": (*there, *added)})
        if there and not _same(there[-1].after, added[0].before):
            now = f"ends with step {len(there)}, {there[-1].short_task},"
            message = f"another command has changed this program meanwhile: it {now} "
            message += f"and `{steps[0][0]}` would not begin where it ends; nothing was written"
            mend = "the same command again starts where it ends now; with another file after --program both are kept"
            raise bad_input("changed-meanwhile", message, Place(path), mend=mend)
        program = made_for(program, path, cell.workspace)
        save_program(program, path)
    return program

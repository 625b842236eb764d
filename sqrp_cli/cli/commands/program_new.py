"""`sqrp program new`: makes a program step by step in questions and answers; every step is saved at once."""

from __future__ import annotations

import os
from pathlib import Path

from sqrp_cli.ask.api.session import ChosenStep, Session, add_steps, assess, chosen_steps
from sqrp_cli.ask.requests import RankRequest
from sqrp_cli.cli.options import open_with_warnings
from sqrp_cli.errors import ExitCode, Infeasible, InputError, Place, bad_input
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.files import check_writable
from sqrp_cli.program.file import new_program
from sqrp_cli.program.record import Program
from sqrp_cli.search.suggestion import Suggester, best_suggestion, check_candidate
from sqrp_cli.show.documents.programs import ProgramDocument
from sqrp_cli.show.terminal.cell_tables import print_suggested
from sqrp_cli.show.terminal.console import Column, ask, note, print_problems, print_table, progress, say
from sqrp_cli.study.pipeline import RankJob
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.task.feasibility import possibilities
from sqrp_cli.task.task import Task, read_task

CORES = os.cpu_count() or 1


def make_program(path: Path) -> ExitCode:
    """Ask for one task after the other until there is no answer, and after the first for the file."""
    opened = open_with_warnings(path)
    workspace, cell, file = opened.workspace, opened.cell, None
    program, kept = new_program(workspace, cell.model.joints, Path()), "no step was chosen, so nothing was written"
    say(f"A program for {workspace.name}. Enter without an answer takes what is in brackets.\n")
    try:
        while (steps := _next_steps(cell, program)) is not None:
            while steps and file is None:  # a new one that can be written
                proposal = f"{workspace.name}-program.yaml"
                named = Path(ask(f"File for the program [{proposal}]: ") or proposal)
                try:
                    check_writable(named)
                    if named.exists():
                        mend = "choose another name; `sqrp rank WORKSPACE TASK --program FILE` goes on with it"
                        raise bad_input("would-overwrite", "this file is there already", Place(named), mend=mend)
                    file = named
                except InputError as error:
                    print_problems(error.problems)
            if steps and file is not None:
                program = add_steps(cell, steps, Adaptive(), file)
                count = len(program.steps)
                kept = f"{file} holds the program: {count} step{'s' * (count != 1)}"
                added = ", ".join(one.short_task for one in program.steps[-len(steps) :])
                say(f"Added and saved in {file}: {added}.\n")
    except EOFError:
        say()
    except KeyboardInterrupt:
        say()
        note(kept)
        return ExitCode.INTERRUPTED
    if file is not None and program.steps:
        ProgramDocument.of(program, file, stale=False).show()
    note(kept)
    return ExitCode.OK


def _next_steps(cell: Cell, program: Program) -> list[ChosenStep] | None:
    """Show what can be done after a program, and ask for a task and one of its ways; None without an answer."""
    workspace = cell.workspace
    world = program.steps[-1].after if program.steps else cell.initial_world
    # What can be done now, and why the rest cannot.
    with progress("Looking for what can be done", None) as advance:
        found = []
        for possibility in possibilities(cell, world):
            found.append(possibility)
            advance()
    doable = [(one.task, motion.time) for one, _, motion in found if not isinstance(motion, Infeasible)]
    if doable:
        rows = [(str(number), task, f"{time:.1f}") for number, (task, time) in enumerate(doable, 1)]
        print_table([Column("#", right=True), Column("can be done now"), Column("time [s]", right=True)], rows)
    else:
        say("Nothing can be done now.")
    impossible = [(one, allowed, why.reasons[0]) for one, allowed, why in found if isinstance(why, Infeasible)]
    for one, allowed, reason in impossible:
        if allowed:
            say(f"not {one.task}: {reason}")
    for skill in workspace.skills:
        barred = [(one.task, why) for one, allowed, why in impossible if one.skill.name == skill and not allowed]
        if barred:
            more = f" (and {len(barred) - 1} more like it)" if len(barred) > 1 else ""
            say(f"not {barred[0][0]}: {barred[0][1]}{more}")
    example = workspace.tasks[0].task if workspace.tasks else "pickup red screw"
    say()
    while answer := ask(f'Step {len(program.steps) + 1}: a number, or a task like "{example}" [finish]: '):
        if answer.isdecimal() and not 1 <= int(answer) <= len(doable):
            say(f"There is no number {answer}; the numbers are those of the table above.")
            continue
        try:
            task = read_task(doable[int(answer) - 1][0] if answer.isdecimal() else answer, workspace)
        except InputError as error:
            print_problems(error.problems)
            continue
        if task.candidates[0].steps:
            say("One step at a time, please: name the first one alone.")
            continue
        return _chosen_way(task, RankJob(cell=cell, world=world))
    return None


def _chosen_way(task: Task, job: RankJob) -> list[ChosenStep]:
    """Rank the ways of a task and ask for one; if there is none, propose what to do first."""
    session, world = Session(task, job), job.world
    question = RankRequest(task.text, jobs=CORES, progress=progress)
    ranking = session.ranking(list(assess(session, question)), question)
    say()
    ranking.show(all_rows=True)
    say()
    if ranking.best is None:
        suggester = Suggester(job.cell, world, jobs=CORES)
        suggested = best_suggestion([check_candidate(c, suggester) for c in task.candidates], suggester)
        if not suggested:
            return []
        print_suggested(suggested)
        return chosen_steps(suggested) if (ask("\nTake these steps [yes]: ").lower() in ("", "y", "yes")) else []
    while True:
        answer = ask("Which one becomes the step, by its #; 0 for none [1]: ") or "1"
        if answer.isdecimal() and int(answer) <= len(ranking.feasible):
            chosen = ranking.feasible[int(answer) - 1 : int(answer)] if int(answer) else ()
            return [(task.text, one, world) for one in chosen]
        say(f"There is no number {answer}; expected 0 to {len(ranking.feasible)}.")

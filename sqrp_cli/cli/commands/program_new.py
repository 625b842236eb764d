"""`sqrp program new`: makes a program step by step in questions and answers; every step is saved at once."""

from __future__ import annotations

from pathlib import Path

from sqrp_cli.ask.api.session import ChosenStep, Session, add_steps, assess, chosen_steps
from sqrp_cli.ask.requests import RankRequest
from sqrp_cli.ask.values import cores
from sqrp_cli.cell.workspace import World
from sqrp_cli.cli.options import open_with_warnings
from sqrp_cli.errors import ExitCode, InputError, Place, bad_input
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.files import check_writable
from sqrp_cli.program.file import new_program
from sqrp_cli.program.record import Program
from sqrp_cli.records import dataclass
from sqrp_cli.search.suggestion import Suggester, best_suggestion, check_candidate
from sqrp_cli.show.documents.checks import PlannedStep
from sqrp_cli.show.documents.programs import ProgramDocument
from sqrp_cli.show.terminal.cell_tables import print_suggested
from sqrp_cli.show.terminal.console import Column, ask, note, print_problems, print_table, progress, say
from sqrp_cli.study.pipeline import RankJob
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.task.feasibility import Possibility, possibilities
from sqrp_cli.task.task import Task, read_task


def make_program(path: Path) -> ExitCode:
    """Ask for one task after the other until there is no answer, and after the first for the file.

    Raises InputError for a workspace that cannot be used. Wrong answers are explained and asked for again.
    """
    opened = open_with_warnings(path)
    workspace, cell = opened.workspace, opened.cell
    dialog = _Dialog(cell, None, new_program(workspace, cell.model.joints, Path()))
    say(f"A program for {workspace.name}. Enter without an answer takes what is in brackets.\n")
    try:
        while dialog.add_step():
            pass
    except EOFError:
        say()
    except KeyboardInterrupt:
        say()
        note(dialog.kept)
        return ExitCode.INTERRUPTED
    if dialog.file is not None and dialog.program.steps:
        ProgramDocument.of(dialog.program, dialog.file, stale=False).show()
    note(dialog.kept)
    return ExitCode.OK


@dataclass
class _Dialog:
    """The program so far; its file has all of it."""

    cell: Cell
    file: Path | None
    program: Program

    @property
    def kept(self) -> str:
        """What has been saved."""
        count = len(self.program.steps)
        if self.file is None or not count:
            return "no step was chosen, so nothing was written"
        return f"{self.file} holds the program: {count} step{'s' * (count != 1)}"

    @property
    def world(self) -> World:
        """The world after the steps so far."""
        steps = self.program.steps
        return steps[-1].after if steps else self.cell.initial_world

    def add_step(self) -> bool:
        """Show what can be done, and ask for a task and one of its ways; returns whether there was an answer."""
        doable = self._show_possibilities()
        example = self.cell.workspace.tasks[0].task if self.cell.workspace.tasks else "pickup red screw"
        say()
        while answer := ask(f'Step {len(self.program.steps) + 1}: a number, or a task like "{example}" [finish]: '):
            if answer.isdecimal() and not 1 <= int(answer) <= len(doable):
                say(f"There is no number {answer}; the numbers are those of the table above.")
                continue
            text = doable[int(answer) - 1].task if answer.isdecimal() else answer
            try:
                task = read_task(text, self.cell.workspace)
            except InputError as error:
                print_problems(error.problems)
                continue
            if task.candidates[0].steps:
                say("One step at a time, please: name the first one alone.")
                continue
            steps = self._choose(task)
            if steps:
                while self.file is None:  # a new one that can be written
                    proposal = f"{self.cell.workspace.name}-program.yaml"
                    file = Path(ask(f"File for the program [{proposal}]: ") or proposal)
                    try:
                        check_writable(file)
                        if file.exists():
                            mend = "choose another name; `sqrp rank WORKSPACE TASK --program FILE` goes on with it"
                            raise bad_input("would-overwrite", "this file is there already", Place(file), mend=mend)
                        self.file = file
                    except InputError as error:
                        print_problems(error.problems)
                self.program = add_steps(self.cell, steps, Adaptive(), self.file)
                added = ", ".join(step.short_task for step in self.program.steps[-len(steps) :])
                say(f"Added and saved in {self.file}: {added}.\n")
            return True
        return False

    def _show_possibilities(self) -> list[Possibility]:
        """Print what can be done now, and why the rest cannot; returns the former."""
        with progress("Looking for what can be done", None) as advance:
            found = []
            for possibility in possibilities(self.cell, self.world):
                found.append(possibility)
                advance()
        doable = [possibility for possibility in found if possibility.time is not None]
        if doable:
            rows = [(str(number), p.task, f"{p.time:.1f}") for number, p in enumerate(doable, 1)]
            print_table([Column("#", right=True), Column("can be done now"), Column("time [s]", right=True)], rows)
        else:
            say("Nothing can be done now.")
        for possibility in found:
            if possibility.allowed and possibility.time is None:
                say(f"not {possibility.task}: {possibility.reason}")
        for skill in self.cell.workspace.skills:
            barred = [p for p in found if p.skill == skill and not p.allowed]
            if barred:
                more = f" (and {len(barred) - 1} more like it)" if len(barred) > 1 else ""
                say(f"not {barred[0].task}: {barred[0].reason}{more}")
        return doable

    def _choose(self, task: Task) -> list[ChosenStep]:
        """Rank the ways of a task and ask for one; if there is none, propose what to do first."""
        session = Session(task, RankJob(cell=self.cell, world=self.world))
        ranking = session.ranking(list(assess(session, cores(), progress)), RankRequest(task.text))
        say()
        ranking.show(all_rows=True)
        say()
        if ranking.best is None:
            suggester = Suggester(self.cell, self.world, jobs=cores())
            suggested = best_suggestion([check_candidate(c, suggester) for c in task.candidates], suggester)
            if not suggested:
                return []
            print_suggested([PlannedStep.of(step) for step in suggested])
            return chosen_steps(suggested) if (ask("\nTake these steps [yes]: ").lower() in ("", "y", "yes")) else []
        while True:
            answer = ask("Which one becomes the step, by its #; 0 for none [1]: ") or "1"
            if answer.isdecimal() and int(answer) <= len(ranking.feasible):
                chosen = ranking.feasible[int(answer) - 1 : int(answer)] if int(answer) else ()
                return [(task.text, one, self.world) for one in chosen]
            say(f"There is no number {answer}; expected 0 to {len(ranking.feasible)}.")

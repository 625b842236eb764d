"""One session of the studio: what browsers ask for, the draft that this changes, and what they are told."""

from __future__ import annotations

import asyncio
import os
import shlex
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.cell.workspace_file import read_workspace_document, replace_workspace, workspace_file
from sqrp_cli.errors import InputError, bad_input, bad_option
from sqrp_cli.files.input_file import YAML_ENDINGS, read_input
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.yaml_edit import changed_values, from_here, patch, with_values
from sqrp_cli.files.yaml_file import MAX_BYTES
from sqrp_cli.platform.files import stamp_of
from sqrp_cli.show.pages.assembly import assembled, asset
from sqrp_cli.studio.jobs import Jobs, play, search, write
from sqrp_cli.studio.messages import Asked, findings, handles, message, read_request
from sqrp_cli.studio.moves import Draft, DraftChange, written
from sqrp_cli.studio.rankings import Rankings, WorkerProcess
from sqrp_cli.studio.server import Connections, Tell
from sqrp_cli.task.task import in_words, read_task

if TYPE_CHECKING:
    from sqrp_cli.study.result import Criterion

LOOK_EVERY = 0.4  # how often files are looked at for changes of others [s]
LINES_SHOWN = 50  # how many of the last commands are shown
SCRIPTS = ("gizmo", "fields", "runs", "studio")  # the page's own scripts, each after those that it needs


class Studio:
    """The state that all browsers share."""

    def __init__(self, opened: OpenCell, task: str, jobs: int, worker: WorkerProcess) -> None:
        """worker: of the same workspace. Raises InputError for a workspace that cannot be read."""
        self._given, self._seed = opened.path, opened.seed
        file = workspace_file(opened.path)
        saved = read_input(file, MAX_BYTES)
        self._draft = Draft(path=file, saved=saved, first=saved)
        self._workspace = opened.workspace
        self._task: str = task
        self._by: Criterion = "q_eoi"
        self._chosen = ""
        self._searched = b""  # the text for which changes are offered
        self._jobs = jobs
        self._parent = os.getppid()
        self._lines = deque[tuple[str, str]](maxlen=LINES_SHOWN)
        self._stamps: Mapping[Path, object] = {}
        self.connections = Connections(self._heard)
        self._rankings = Rankings(worker, self.connections, self._asked, self._named)
        self.under_way = Jobs(
            self.connections, lambda told: self._note("dropped", _run_line(told["file"], told["faults"]))
        )

    # What browsers are told

    def _tell_state(self) -> None:
        draft, workspace, task = self._draft, self._workspace, self._task
        parameters = []
        if task.split() and (skill := workspace.skills.get(task.split()[0].lower())) is not None:
            for one in skill.motion_parameters:
                values = [in_words(skill, {one.name: value})[one.name].replace(" ", "") for value in one.values]
                words = [word for kind in one.kinds for word in kind.words]
                parameters.append({"name": one.name, "values": values, "words": words})
        told = message(
            "state",
            workspace=workspace.name,
            path=str(self._given),
            file=str(draft.path),
            task=task,
            by=self._by,
            tasks=[one.task for one in workspace.tasks],
            skills=[*workspace.skills, *workspace.recordings],
            parameters=parameters,  # of the task's skill, with the words that they may have instead of a value
            chosen=self._chosen,
            number=self._rankings.number,
            dirty=draft.dirty,
            undo=draft.past[-1].label if draft.past else None,
            redo=draft.future[0].label if draft.future else None,
            unsaved=[one.label for one in draft.past] if draft.dirty else [],
            lines=[{"what": what, "line": line} for what, line in self._lines],
            handles=handles(workspace),
        )
        self.connections.post("state", told)

    def _note(self, what: str, line: str) -> None:
        """Tell what was done, and the command that does it."""
        self._lines.append((what, line))
        self._tell_state()

    def _command(self, *words: str) -> str:
        return shlex.join(["sqrp", words[0], str(self._given), *words[1:]])

    def _setting(self, before: SourceDocument, content: bytes) -> str:
        """The command that makes a text of another; empty where that takes more than setting values, or nothing."""
        values = changed_values(before, content)
        return self._command("set", *(f"{path}={text}" for path, text in values.items())) if values else ""

    # From beginning to end

    async def run(self, port: int, ready: Callable[[str], None], closed: Callable[[], bool]) -> None:
        """Serve until it is closed, or none can. ready: called with the address. Raises InputError for a taken port."""
        await self.connections.open(port)
        over = self._rankings.listen()
        self._rankings.rank(self._asked(saved=False))  # meanwhile the page is put together
        self.connections.page = assembled(
            f"{self._workspace.name}: studio",
            "\n".join(asset(f"{name}.js", "sqrp_cli.studio") for name in SCRIPTS),
            data={},
            style=asset("studio.css", "sqrp_cli.studio"),
            further=asset("studio.html", "sqrp_cli.studio"),
            policy=f"; connect-src {self.connections.socket}; img-src data:; base-uri 'none'; form-action 'none'",
        )
        ready(self.connections.address)
        self._stamps = self._stamped()
        self._tell_state()
        try:
            while os.getppid() == self._parent and not closed():  # who started it is there, so that it can be closed
                await asyncio.wait([over], timeout=LOOK_EVERY)
                if over.done():
                    over.result()
                if (stamps := self._stamped()) != self._stamps:
                    self._stamps = stamps
                    self._reread()
        finally:
            await self.connections.close()

    def _asked(self, *, saved: bool = True) -> Asked:
        """What the text is ranked for; saved: that of the file, to compare."""
        return Asked(self._draft.saved if saved else self._draft.content, self._task, self._by)

    def _named(self, names: Sequence[str]) -> None:
        """The candidates of a new ranking."""
        if self._chosen not in names:
            self._chosen = names[0]
            self._tell_state()

    # What browsers ask for

    async def _heard(self, text: str, tell: Tell) -> None:
        try:
            self.obey(text)
        except InputError as error:
            tell(message("refused", problems=findings(error)))

    def obey(self, text: str) -> None:
        """Do what a browser asks for. Raises InputError where that cannot be."""
        asked = read_request(text)
        order = ["--by", self._by] if self._by != "q_eoi" else []
        match asked.do:
            case "hold":
                self.connections.tell(message("move", move=asked.move))
                self._rankings.hold(asked.move, asked.number)
            case "put" | "rest":
                try:
                    if asked.do == "put":
                        label = asked.move.in_words(handles(self._workspace)[asked.move.kind].get(asked.move.name))
                        self._edit(label, lambda document: written(document, self._workspace, asked.move))
                finally:
                    if self._rankings.held:  # nothing was changed: rank again what the hand has interrupted
                        self._rankings.rank(self._asked(saved=False))
                        self._tell_state()
            case "set":
                label = f"{asked.path} = {asked.value}"
                self._edit(label, lambda document: with_values(document, {asked.path: asked.value}))
            case "undo" | "redo":
                self._step(back=asked.do == "undo")
            case "task":
                read_task(asked.text, self._workspace)
                self._task, self._by = asked.text, asked.by
                self._rankings.rank(self._asked(saved=False))
                order = ["--by", self._by] if self._by != "q_eoi" else []
                self._note("task", self._command("rank", self._task, *order))
            case "choose":
                self._chosen = asked.name
                self.connections.forget("detail")
                self._rankings.worker.ask(("show", asked.name, None))
                self._note("shown", self._command("explain", self._task, "--choose", asked.name))
            case "advise" | "place":
                self._searched, chosen = self._draft.content, self._chosen or "best"
                about = (self._given, self._seed, self._searched, self._task, self._jobs)
                self.under_way.begin(partial(search, *about, "" if asked.do == "place" else chosen))
                line = ("--choose", self._chosen) if asked.do == "advise" else ()
                self._note("asked", self._command(asked.do, self._task, *line))
            case "apply":
                self._apply(asked.number)
            case "program":
                if self._draft.dirty:
                    raise bad_input("unsaved", "a program is for the cell as it is saved", mend="save first, or undo")
                file, chosen = program_file(asked.file), self._chosen
                job = partial(write, self._given, self._seed, self._task, self._jobs, self._by, chosen, file)
                self.under_way.begin(job)
                words = (*order, "--program", str(file), "--choose", chosen)
                self._note("program", self._command("rank", self._task, *words))
            case "run":
                file = program_file(asked.file)
                self.under_way.begin(partial(play, file, asked.faults, self._seed), playing=True)
                self._note("run", _run_line(str(file), asked.faults))
            case "fault":
                self.under_way.drop()
            case "stop":
                self.under_way.stop()
            case "difference":
                saved = read_workspace_document(self._draft.path, self._draft.saved)
                text = patch(saved, self._draft.content, from_here(self._draft.path))
                line_of_it = self._setting(saved, self._draft.content)
                self.connections.tell(message("difference", patch=text.splitlines(), line=line_of_it))
            case "save":
                self._save()
            case "reread":
                self._reread()

    def _edit(self, label: str, make: Callable[[SourceDocument], bytes], line: str | None = None) -> None:
        """Change the text by a command, else by setting values. Raises InputError where that makes no workspace."""
        document = read_workspace_document(self._draft.path, self._draft.content)
        content = make(document)
        if content == self._draft.content:
            self._tell_state()
            return
        change = DraftChange(label=label, values=changed_values(document, content), content=content)
        self._go_on(self._draft.changed(change))
        self._note(label, self._setting(document, content) if line is None else line)

    def _apply(self, number: int) -> None:
        """Make a change that was found."""
        offers = self.under_way.offers
        if not 1 <= number <= len(offers):
            raise bad_option(f"there is no change {number}")
        if self._searched != self._draft.content:
            changed = "the cell has changed since this was found"
            raise bad_input("changed-meanwhile", changed, mend="ask for advice or places again")
        words, line, content = offers[number - 1]
        self._edit(words, lambda _: content, self._command(*line))
        self.under_way.offers = ()
        self.connections.forget("offers")

    def _go_on(self, draft: Draft) -> None:
        """Take over another text, and rank in its cell. Raises InputError where it is no workspace."""
        opened = OpenCell.read(self._given, self._seed, draft.content)
        if opened.errors:
            raise InputError(*opened.errors)
        self._draft, self._workspace = draft, opened.workspace
        self._rankings.rank(self._asked(saved=False))

    def _step(self, *, back: bool) -> None:
        """Take back a change, or make it again."""
        before = read_workspace_document(self._draft.path, self._draft.content)
        for change in self._draft.past[-1:] if back else self._draft.future[:1]:
            self._go_on(self._draft.stepped(back=back))
            label = f"{'undone' if back else 'again'}: {change.label}"
            self._note(label, self._setting(before, self._draft.content))

    def _save(self) -> None:
        """Write the text into the file. Raises InputError where the file has changed meanwhile."""
        saved = read_workspace_document(self._draft.path, self._draft.saved)
        line = self._setting(saved, self._draft.content)
        mend = "mend the file, or read it again; unsaved changes are kept where they still fit"
        replace_workspace(saved, self._draft.content, mend)
        self._draft = replace(self._draft, saved=self._draft.content)
        self._stamps = self._stamped()
        self._rankings.take_as_saved()
        self._note("saved", line)

    # Changes of others

    def _stamped(self) -> Mapping[Path, object]:
        """What tells whether a file of the workspace has changed."""
        paths = {self._draft.path.absolute(), *(file.path for file in self._workspace.files.values())}
        return {path: stamp_of(path) for path in paths}

    def _reread(self) -> None:
        """Take over what others changed. What cannot be read is shown, and the last good state stays."""
        before = self._draft
        try:
            saved = read_input(before.path, MAX_BYTES)
            draft, lost = (before, ()) if saved == before.saved else before.on(saved)
            self._go_on(draft)
        except InputError as error:
            self.connections.post("outside", message("outside", problems=findings(error), lost=[]))
            return
        self._stamps = self._stamped()
        self._tell_state()
        labels = [one.label for one in lost]
        told = message("outside", problems=[], lost=labels, taken=draft is not before)
        self.connections.post("outside", told)


def program_file(name: str) -> Path:
    """The file of a program. Raises InputError for a name that is none of a YAML file."""
    if not name.endswith(YAML_ENDINGS) or not name.isprintable():
        raise bad_option(f"found `{name}`, expected a file of a program, such as pick.yaml")
    return Path(name)


def _run_line(file: str, faults: Sequence[str]) -> str:
    return shlex.join(["sqrp", "run", file, "--sim", *(word for fault in faults for word in ("--fault", fault))])

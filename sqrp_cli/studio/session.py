"""One session of the studio: what browsers ask for, the draft that this changes, and what they are told."""

from __future__ import annotations

import asyncio
import os
import shlex
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cell.workspace_file import read_workspace_document, replace_workspace, workspace_file
from sqrp_cli.errors import InputError, Place, bad_input, bad_option
from sqrp_cli.files.input_file import YAML_ENDINGS, read_input
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.yaml_edit import changed_values, from_here, patch, with_values
from sqrp_cli.files.yaml_file import MAX_BYTES
from sqrp_cli.studio.jobs import Jobs, Play, Search, Write
from sqrp_cli.studio.messages import (
    Apply,
    Asked,
    AskTask,
    Choose,
    DropFault,
    Hold,
    Plain,
    PutDown,
    RunProgram,
    SetValue,
    WriteProgram,
    findings,
    handles,
    message,
    parameters,
    read_request,
    studio_page,
)
from sqrp_cli.studio.moves import Draft, DraftChange, written
from sqrp_cli.studio.rankings import Rankings, WorkerProcess
from sqrp_cli.studio.server import Connections, Tell

if TYPE_CHECKING:
    from sqrp_cli.study.result import Criterion

LOOK_EVERY = 0.4  # how often files are looked at for changes of others [s]


LINES_SHOWN = 50  # how many of the last commands are shown


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
        self._rankings = Rankings(worker, self.connections, self._saved, self._named)
        self._under_way = Jobs(
            self.connections, lambda told: self._note("dropped", _run_line(told["file"], told["faults"]))
        )

    # What browsers are told

    def say(self, do: str, **fields: object) -> None:
        """Tell all browsers, and keep it for those that come."""
        self.connections.post(do, message(do, **fields))

    def _tell_state(self) -> None:
        draft, workspace = self._draft, self._workspace
        self.say(
            "state",
            workspace=workspace.name,
            path=str(self._given),
            file=str(self._draft.path),
            task=self._task,
            by=self._by,
            tasks=[one.task for one in workspace.tasks],
            skills=list(workspace.skills),
            parameters=parameters(workspace, self._task),
            chosen=self._chosen,
            number=self._rankings.number,
            dirty=draft.dirty,
            undo=draft.past[-1].label if draft.past else None,
            redo=draft.future[0].label if draft.future else None,
            unsaved=[one.label for one in draft.past] if draft.dirty else [],
            lines=[{"what": what, "line": line} for what, line in self._lines],
            handles=handles(workspace),
        )

    def _note(self, what: str, line: str) -> None:
        """Tell what was done, and the command that does it."""
        self._lines.append((what, line))
        self._tell_state()

    def _command(self, *words: str) -> str:
        return shlex.join(["sqrp", words[0], str(self._given), *words[1:]])

    def _setting(self, values: Mapping[str, str] | None) -> str:
        """The command that sets values; empty where that takes more, or nothing."""
        return self._command("set", *(f"{path}={text}" for path, text in values.items())) if values else ""

    # From beginning to end

    async def run(self, port: int, ready: Callable[[str], None]) -> None:
        """Serve until it is cancelled or alone; ready: called with the address. Raises InputError for a taken port."""
        await self.connections.open(port)
        over = self._rankings.listen()
        self._rank()  # meanwhile the page is put together
        self.connections.show(studio_page(f"{self._workspace.name}: studio", self.connections.socket))
        ready(self.connections.address)
        self._stamps = self._stamped()
        self._tell_state()
        try:
            watching = asyncio.ensure_future(self._watch())
            await asyncio.wait([watching, over], return_when=asyncio.FIRST_COMPLETED)
            (watching if watching.done() else over).result()
        finally:
            watching.cancel()
            await self.connections.close()

    def close(self) -> None:
        """End what takes longer."""
        self._under_way.end()

    def _rank(self) -> None:
        self._rankings.rank(Asked(self._draft.content, self._task, self._by))

    def _saved(self) -> Asked:
        """What the saved file is ranked for, to compare."""
        return Asked(self._draft.saved, self._task, self._by)

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
            tell(message("refused", problems=findings(error.problems)))

    def obey(self, text: str) -> None:
        """Do what a browser asks for. Raises InputError where that cannot be."""
        match read_request(text):
            case Hold() as asked:
                self.connections.tell(message("move", move=asked.move))
                self._rankings.hold(asked)
            case PutDown(move=move):
                try:
                    label = move.in_words(handles(self._workspace)[move.kind].get(move.name))
                    self._edit(label, lambda: written(self._document(), self._workspace, move))
                finally:
                    self.rest()
            case SetValue(path=path, value=value):
                self._edit(f"{path} = {value}", lambda: with_values(self._document(), {path: value}))
            case AskTask(text=task, by=by):
                from sqrp_cli.task.task import read_task

                read_task(task, self._workspace)
                self._task, self._by = task, by
                self._rank()
                self._note("task", self._command("rank", task, *(["--by", by] if by != "q_eoi" else [])))
            case Choose() as asked:
                self._chosen = asked.name
                self._rankings.choose(asked)
                self._note("shown", self._command("explain", self._task, "--choose", asked.name))
            case Apply(number=number):
                offers = self._under_way.offers
                if not 1 <= number <= len(offers):
                    raise bad_option(f"there is no change {number}")
                if self._searched != self._draft.content:
                    changed = "the cell has changed since this was found"
                    raise bad_input("changed-meanwhile", changed, mend="ask for advice or places again")
                offer = offers[number - 1]
                self._edit(offer.words, lambda: offer.content, self._command(*offer.line))
                self._under_way.forget_offers()
            case WriteProgram(file=name):
                if self._draft.dirty:
                    raise bad_input("unsaved", "a program is for the cell as it is saved", mend="save first, or undo")
                file, task, by, chosen = _program_file(name), self._task, self._by, self._chosen
                about = (self._given, task, self._seed, self._jobs)
                self._under_way.begin(Write(*about, by=by, chosen=chosen, file=file))
                order = ["--by", by] if by != "q_eoi" else []
                line = self._command("rank", task, *order, "--program", str(file), "--choose", chosen)
                self._note("program", line)
            case RunProgram(file=name, faults=faults):
                file = _program_file(name)
                self._under_way.begin(Play(file=file, faults=tuple(faults), seed=self._seed))
                self._note("run", _run_line(str(file), faults))
            case DropFault():
                self._under_way.drop()
            case Plain(do=do):
                _PLAIN[do](self)

    def _document(self) -> SourceDocument:
        return read_workspace_document(self._draft.path, self._draft.content)

    def _edit(self, label: str, make: Callable[[], bytes], line: str | None = None) -> None:
        """Change the text. Raises InputError where that makes no workspace; then nothing changes.

        line: the command that does it, if it is not the one that sets what differs.
        """
        document = self._document()
        content = make()
        if content == self._draft.content:
            self._tell_state()
            return
        workspace = self._read(content)
        values = changed_values(document, content)
        self._go_on(self._draft.changed(DraftChange(label=label, values=values, content=content)), workspace)
        self._note(label, self._setting(values) if line is None else line)

    def rest(self) -> None:
        """Nothing is held any more: rank again what a hand has interrupted without changing anything."""
        if self._rankings.interrupted:
            self._rank()
            self._tell_state()

    def _read(self, content: bytes) -> Workspace:
        opened = OpenCell.read(self._given, self._seed, content)
        if opened.errors:
            raise InputError(*opened.errors)
        return opened.workspace

    def _go_on(self, draft: Draft, workspace: Workspace) -> None:
        self._draft, self._workspace = draft, workspace
        self._rank()

    def _step(self, draft: Draft, what: str) -> None:
        """Take back a change, or make it again."""
        before = self._document()
        self._go_on(draft, self._read(draft.content))
        self._note(what, self._setting(changed_values(before, draft.content)))

    def undo(self) -> None:
        """Take back the last change."""
        if self._draft.past:
            self._step(self._draft.undone(), f"undone: {self._draft.past[-1].label}")

    def redo(self) -> None:
        """Make again what was undone."""
        if self._draft.future:
            self._step(self._draft.redone(), f"again: {self._draft.future[0].label}")

    def difference(self) -> None:
        """Show what saving would change."""
        saved = read_workspace_document(self._draft.path, self._draft.saved)
        line = self._setting(changed_values(saved, self._draft.content))
        text = patch(saved, self._draft.content, from_here(self._draft.path))
        self.connections.tell(message("difference", patch=text.splitlines(), line=line))

    def save(self) -> None:
        """Write the text into the file. Raises InputError where the file has changed meanwhile."""
        if read_input(self._draft.path, MAX_BYTES) != self._draft.saved:
            message = "the workspace has changed meanwhile"
            mend = "mend the file, or read it again; unsaved changes are kept where they still fit"
            raise bad_input("changed-meanwhile", message, Place(self._draft.path), mend=mend)
        saved = read_workspace_document(self._draft.path, self._draft.saved)
        line = self._setting(changed_values(saved, self._draft.content))
        if self._draft.dirty:
            replace_workspace(saved, self._draft.content)
        self._draft = replace(self._draft, saved=self._draft.content)
        self._stamps = self._stamped()
        self._rankings.take_as_saved()
        self._note("saved", line)

    # What takes longer

    def search(self, *, placing: bool) -> None:
        """Look for the least changes that help the chosen candidate, or for other places of all cameras."""
        content = self._searched = self._draft.content
        chosen, about = self._chosen or "best", (self._given, self._task, self._seed, self._jobs)
        self._under_way.begin(Search(*about, content=content, chosen=chosen, placing=placing))
        line = ("place", self._task) if placing else ("advise", self._task, "--choose", self._chosen)
        self._note("asked", self._command(*line))

    # Changes of others

    def _stamped(self) -> Mapping[Path, object]:
        """What tells whether a file of the workspace has changed."""
        stamps: dict[Path, object] = {}
        for path in {self._draft.path.absolute(), *(file.path for file in self._workspace.files.values())}:
            with suppress(OSError):
                status = path.stat()
                stamps[path] = (status.st_mtime_ns, status.st_size, status.st_ino)
        return stamps

    async def _watch(self) -> None:
        """Look at the files, until the process that started this one is gone: nobody could close the studio then."""
        while os.getppid() == self._parent:
            await asyncio.sleep(LOOK_EVERY)
            stamps = self._stamped()
            if stamps != self._stamps:
                self._stamps = stamps
                self.reread()

    def reread(self) -> None:
        """Take over what others changed. What cannot be read is shown, and the last good state stays."""
        try:
            saved = read_input(self._draft.path, MAX_BYTES)
            draft, lost = (self._draft, ()) if saved == self._draft.saved else self._draft.on(saved)
            workspace = self._read(draft.content)
        except InputError as error:
            self.say("outside", problems=findings(error.problems), lost=[])
            return
        changed = draft is not self._draft
        self._go_on(draft, workspace)
        self._stamps = self._stamped()
        self._tell_state()
        self.say("outside", problems=[], lost=[one.label for one in lost], taken=changed)


_PLAIN: Mapping[str, Callable[[Studio], None]] = {
    "rest": Studio.rest,
    "undo": Studio.undo,
    "redo": Studio.redo,
    "difference": Studio.difference,
    "save": Studio.save,
    "advise": lambda studio: studio.search(placing=False),
    "place": lambda studio: studio.search(placing=True),
    "stop": lambda studio: studio._under_way.stop(),
    "reread": Studio.reread,
}
"""What is done at a word."""


def _program_file(name: str) -> Path:
    """The file of a program. Raises InputError for a name that is none of a YAML file."""
    if not name.endswith(YAML_ENDINGS) or not name.isprintable():
        raise bad_option(f"found `{name}`, expected a file of a program, such as pick.yaml")
    return Path(name)


def _run_line(file: str, faults: Sequence[str]) -> str:
    return shlex.join(["sqrp", "run", file, "--sim", *(word for fault in faults for word in ("--fault", fault))])

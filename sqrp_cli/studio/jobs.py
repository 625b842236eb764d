"""What takes longer: advice, placing, writing a program, and runs; one at a time, in a process of its own."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import select
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.errors import InputError, Problem, bad_input
from sqrp_cli.platform.processes import Worker, forked
from sqrp_cli.records import dataclass
from sqrp_cli.studio.messages import findings, kind_of, message
from sqrp_cli.studio.server import Connections

if TYPE_CHECKING:
    from sqrp_cli.study.result import Criterion


IMAGE_SPACING = 0.2  # simulated time between the images of a camera that browsers get [s]
STATE_SPACING = 0.05  # the same of the poses of everything [s]
IMAGE_QUALITY = 70  # of JPEG, in percent


TOO_LATE = "the run was over before the click"  # why nothing is dropped


@dataclass(frozen=True)
class _OnTask:
    """What is done about a task of a workspace."""

    path: Path  # of the workspace, as it was given
    task: str
    seed: int
    jobs: int


@dataclass(frozen=True)
class Search(_OnTask):
    """For changes of a text."""

    content: bytes
    chosen: str  # the candidate that is to get better
    placing: bool  # whether cameras are placed anew, instead of the least change


@dataclass(frozen=True)
class Write(_OnTask):
    """A candidate into a program file."""

    by: Criterion
    chosen: str
    file: Path


@dataclass(frozen=True, kw_only=True)
class Play:
    """A program in the simulated cell."""

    file: Path
    faults: tuple[str, ...]
    seed: int


Job = Search | Write | Play


@dataclass(frozen=True, kw_only=True)
class Offer:
    """A change that was found."""

    words: str
    line: tuple[str, ...]  # the words of the command that makes it, without the workspace
    content: bytes  # the workspace file with it


class Running:
    """A job under way, in its process."""

    def __init__(self, job: Job) -> None:
        import multiprocessing

        self.job = job
        self.pipe, theirs = multiprocessing.Pipe()
        self._process: Worker[None, None] = Worker(forked(), _work, theirs, self.pipe, job, starts_others=True)
        theirs.close()

    def drop(self) -> bool:
        """Drop what the tool holds, in a run; whether that was heard."""
        if isinstance(self.job, Play) and select.select([], [self.pipe], [], 0.0)[1]:
            with suppress(OSError):  # it has just ended
                self.pipe.send("slip")
                return True
        return False

    def end(self) -> None:
        """End it at once, if it has not ended."""
        self._process.kill()
        self.pipe.close()


def _work(pipe: Connection, theirs: Connection, job: Job) -> Callable[[None], None]:
    theirs.close()
    if isinstance(job, Play):  # where a run is ended while its processes start, these complain
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
    say = _Teller(pipe)
    try:
        match job:
            case Search():
                _search(job, say)
            case Write():
                _write(job, say)
            case Play():
                _play(job, say)
    except InputError as error:
        say("refused", problems=findings(error.problems))
    except Exception as error:
        problem = Problem("internal-error", f"internal error: {type(error).__name__}: {error}")
        say("refused", problems=findings([problem]))
    pipe.close()
    return lambda _: None


class _Teller:
    """Sends reports: a text in JSON for browsers, and what can be applied."""

    def __init__(self, pipe: Connection) -> None:
        self.pipe = pipe

    def __call__(self, do: str, offers: Sequence[Offer] = (), **fields: object) -> None:
        self.pipe.send((message(do, **fields), tuple(offers)))

    @contextmanager
    def progress(self, title: str, total: int) -> Iterator[Callable[[int], None]]:
        """Progress, as the commands show it."""
        done = 0

        def advance(count: int) -> None:
            nonlocal done
            done += count
            self("searching", text=f"{title}: {done} of {total}")

        advance(0)
        yield advance


def _search(job: Search, say: _Teller) -> None:
    """The least changes that help a candidate, or other places of all cameras."""
    from sqrp_cli.ask.api.cell import OpenCell

    opened = OpenCell.read(job.path, job.seed, job.content)
    offers, changes, unwritten = list[Offer](), list[dict[str, object]](), list[str]()
    if job.placing:
        placed = opened.place(job.task, jobs=job.jobs, progress=say.progress)
        names = ", ".join(f"{one.name} on {one.mount}" for one in placed.cameras)
        title = f"{len(placed.cameras)} cameras: {names}" if names else "no cameras on these mounts meet the goal"
        line: tuple[str, ...] = ("place", job.task, "--patch", "cameras.patch")
        if names:
            offers.append(Offer(words=f"cameras: {names}", line=line, content=placed.content))
            changes.append({"words": offers[0].words, "q_eoi": None, "q_avg": None, "worse": []})
    else:
        found = opened.advise(job.task, choose=job.chosen, jobs=job.jobs, progress=say.progress)
        title = f"{found.candidate} is to have {found.want}"
        if found.met:
            title += ": it has that already"
        elif not found.advice:
            title += ": no change meets that" + (f"; {found.first}" if found.first else "")
        for number, one in enumerate(found.advice, 1):
            if not one.patch:
                unwritten.append(f"{one.words} ({one.unwritten})")
                continue
            line = ("advise", job.task, "--choose", job.chosen, "--apply", str(number))
            offers.append(Offer(words=one.words, line=line, content=found.patched(number)))
            changes.append({"words": one.words, "q_eoi": one.q_eoi, "q_avg": one.q_avg, "worse": list(one.worse)})
    say("offers", offers, title=title, unwritten=unwritten, changes=changes)


def _write(job: Write, say: _Teller) -> None:
    """Append the chosen candidate as `rank --program` does."""
    from sqrp_cli.ask.api.cell import open_cell
    from sqrp_cli.ask.api.session import world_before
    from sqrp_cli.platform.files import check_not_read

    opened = open_cell(job.path, seed=job.seed)
    check_not_read([job.file], opened.files)
    before = world_before(None, job.file)
    ranking = opened.rank(job.task, by=job.by, after=before, jobs=job.jobs, progress=say.progress)
    ranking.write(job.file, job.chosen)
    say("written", file=str(job.file))


class _Watching:
    """Somebody who looks on from a browser: gets images, poses and events, and may drop what the tool holds."""

    def __init__(self, say: _Teller, file: Path, faults: Sequence[str]) -> None:
        self._say, self._file, self._faults = say, file, list(faults)
        self._began: float | None = None
        self._shown: dict[str, float] = {}
        self._state: dict[str, Any] = {"q": {}, "objects": {}, "held": None}
        self._joints: list[str] = []

    # As a screen

    def add(self, frame: Any, outlines: Any, _caption: str) -> None:  # noqa: ANN401 - see `images.Screen`
        """Show an image with what was seen in it."""
        if frame.t - self._shown.get(frame.camera, -1.0) < IMAGE_SPACING - 1e-6:
            return
        import cv2

        from sqrp_cli.run.record.images import drawn

        self._shown[frame.camera] = frame.t
        picture = drawn(frame.image, outlines, "")
        height = round(320 * picture.shape[0] / picture.shape[1])
        small = cv2.resize(picture, (320, height), interpolation=cv2.INTER_AREA)
        _, data = cv2.imencode(
            ".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, IMAGE_QUALITY]
        )
        self._say("run-image", camera=frame.camera, t=frame.t, data=base64.b64encode(data.tobytes()).decode())

    def close(self) -> None:
        """There are no more."""

    # As a spectator

    def wants_slip(self) -> bool:
        """Whether somebody has clicked."""
        wanted = False
        while self._say.pipe.poll():
            wanted = self._say.pipe.recv() == "slip"
        return wanted

    def told(self, fault: str, refused: str) -> None:
        """What became of the click."""
        if refused:
            self._say("run-event", t=None, text=f"{fault} cannot happen: {refused}", kind="refused")
            return
        self._faults.append(fault)
        self._say("run-fault", faults=self._faults, file=str(self._file))

    # As a listener

    def __call__(self, event: Any) -> None:  # noqa: ANN401 - an event of a run
        """Show what happens, not faster than it would."""
        from sqrp_cli.show.terminal.run_view import event_in_words

        now = time.monotonic()
        self._began = now - event.t if self._began is None else self._began
        if self._began + event.t > now:
            time.sleep(self._began + event.t - now)
        match event.event:
            case "state":
                told = event.model_fields_set
                if "joints" in told:
                    self._joints = event.joints
                if "q" in told:
                    self._state["q"] = dict(zip(self._joints, event.q, strict=True))
                if "held" in told:
                    self._state["held"] = event.held
                self._state["objects"].update(event.objects)
                if event.t - self._shown.get("", -1.0) >= STATE_SPACING - 1e-6:
                    self._shown[""] = event.t
                    self._say("run-state", t=event.t, **self._state)
            case "evidence":
                shown = {}
                for atom, one in event.literals.items():
                    cameras = {name: truth.word for name, truth in one.cameras.items()}
                    flags = {"asked": one.asked, "predicted": one.predicted}
                    shown[atom] = {"value": one.value.word, **flags, "cameras": cameras}
                self._say("run-evidence", t=event.t, literals=shown)
            case "primitive":
                self._say("run-doing", t=event.t, text=event.does or event.name)
            case "done" | "stopped" | "missed":
                self._say("run-event", t=event.t, text=event.reason or event.event, kind=event.event)
            case _:
                text = event_in_words(event)
                if text is not None:
                    self._say("run-event", t=event.t, text=text, kind=event.event)


def _play(job: Play, say: _Teller) -> None:
    from sqrp_cli.ask.api.program import open_program
    from sqrp_cli.ask.requests import RunRequest

    opened = open_program(job.file, seed=job.seed)
    watching = _Watching(say, job.file, job.faults)
    cameras = list(opened.workspace.cameras)
    say("run-began", file=str(job.file), cameras=cameras, faults=list(job.faults))
    ask = RunRequest(job.faults, listeners=[watching])
    run = opened.run_into(ask, screen=watching, spectator=watching)
    if watching.wants_slip():
        watching.told("slip", TOO_LATE)
    told = [
        {"name": one.name, "happened": one.happened, "detected": one.detected, "recovered": one.recovered}
        for one in run.faults
    ]
    say("run-ended", outcome=run.outcome, time=run.time, faults=told)


PASSING = ("run-image", "run-state", "run-evidence", "searching")  # reports that the next ones replace


class Jobs:
    """The job under way, and what was found."""

    def __init__(self, connections: Connections, dropped: Callable[[dict[str, Any]], None]) -> None:
        """dropped: called with the report that a part was dropped."""
        self._connections, self._dropped = connections, dropped
        self._running: Running | None = None
        self.offers: Sequence[Offer] = ()  # the changes that can be applied

    def begin(self, job: Job) -> None:
        """Start a job instead of the one that is under way."""
        self.stop()
        self._connections.forget("run-began", "run-ended", "written", "refused")
        self.forget_offers()
        self._running = Running(job)
        asyncio.get_running_loop().add_reader(self._running.pipe.fileno(), self._reported)

    def stop(self) -> None:
        """End the job under way, in the loop that serves browsers."""
        if self._running is not None:
            asyncio.get_running_loop().remove_reader(self._running.pipe.fileno())
            self.end()
            self._connections.tell(message("job-ended"))

    def end(self) -> None:
        """End the job under way, once nobody is told any more."""
        if self._running is not None:
            self._running.end()
            self._running = None

    def drop(self) -> None:
        """Drop what the tool holds in the run under way. Raises InputError where that is over."""
        if self._running is None or not self._running.drop():
            raise bad_input("bad-fault", f"nothing was dropped: {TOO_LATE}")

    def forget_offers(self) -> None:
        """Offer nothing any more."""
        self.offers = ()
        self._connections.forget("offers")

    def _reported(self) -> None:
        assert self._running is not None  # noqa: S101 - its pipe is read
        try:
            text, offers = self._running.pipe.recv()
        except (EOFError, OSError):
            self.stop()
            return
        do = kind_of(text)
        if do == "offers":
            self.offers = offers
        if do == "run-fault":
            self._dropped(json.loads(text))
        if do in ("offers", "run-began", "run-ended"):
            self._connections.post(do, text)
        else:
            self._connections.tell(text, passing=do in PASSING)

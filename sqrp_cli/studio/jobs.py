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
from dataclasses import field
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.errors import bad_input
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
Offer = tuple[str, tuple[str, ...], bytes]
"""A change that was found: in words, the words of the command that makes it, without the workspace, and the file."""
Job = Callable[[Connection], None]
"""Does its work, and reports through the pipe: each time a text in JSON for browsers, and what can be applied."""


def tell(pipe: Connection, do: str, offers: Sequence[Offer] = (), **fields: object) -> None:
    """Send a report."""
    pipe.send((message(do, **fields), tuple(offers)))


@contextmanager
def _progress(pipe: Connection, title: str, total: int) -> Iterator[Callable[[int], None]]:
    """Progress, as the commands show it."""
    done = 0

    def advance(count: int) -> None:
        nonlocal done
        done += count
        tell(pipe, "searching", text=f"{title}: {done} of {total}")

    advance(0)
    yield advance


def _work(pipe: Connection, theirs: Connection, job: Job, *, playing: bool) -> Callable[[None], None]:
    theirs.close()
    if playing:  # where a run is ended while its processes start, these complain
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
    try:
        job(pipe)
    except Exception as error:
        tell(pipe, "refused", problems=findings(error))
    pipe.close()
    return lambda _: None


def search(path: Path, seed: int, content: bytes, task: str, jobs: int, chosen: str, pipe: Connection) -> None:
    """The least changes that help a candidate in the cell of a text; without one, other places of all cameras."""
    from sqrp_cli.ask.api.cell import OpenCell

    opened, progress = OpenCell.read(path, seed, content), partial(_progress, pipe)
    offers, changes, unwritten = list[Offer](), list[dict[str, object]](), list[str]()
    if not chosen:
        placed = opened.place(task, jobs=jobs, progress=progress)
        names = ", ".join(f"{one.name} on {one.mount}" for one in placed.cameras)
        title = f"{len(placed.cameras)} cameras: {names}" if names else "no cameras on these mounts meet the goal"
        if names:
            offers.append((f"cameras: {names}", ("place", task, "--patch", "cameras.patch"), placed.content))
            changes.append({"words": offers[0][0], "q_eoi": None, "q_avg": None, "worse": []})
    else:
        found = opened.advise(task, choose=chosen, jobs=jobs, progress=progress)
        title = f"{found.candidate} is to have {found.want}"
        if found.met:
            title += ": it has that already"
        elif not found.advice:
            title += ": no change meets that" + (f"; {found.first}" if found.first else "")
        for number, one in enumerate(found.advice, 1):
            if not one.patch:
                unwritten.append(f"{one.words} ({one.unwritten})")
                continue
            line = ("advise", task, "--choose", chosen, "--apply", str(number))
            offers.append((one.words, line, found.patched(number)))
            changes.append({"words": one.words, "q_eoi": one.q_eoi, "q_avg": one.q_avg, "worse": list(one.worse)})
    tell(pipe, "offers", offers, title=title, unwritten=unwritten, changes=changes)


def write(
    path: Path, seed: int, task: str, jobs: int, by: Criterion, chosen: str, file: Path, pipe: Connection
) -> None:
    """Write the chosen candidate into a program file as `rank --program` does."""
    from sqrp_cli.ask.api.cell import open_cell, ranked
    from sqrp_cli.ask.requests import RankRequest
    from sqrp_cli.platform.files import check_not_read, check_writable

    opened = open_cell(path, seed=seed)
    check_not_read([file], opened.files)
    check_writable(file)
    ask = RankRequest(task, by=by, jobs=jobs, progress=partial(_progress, pipe))
    ranked(opened, ask, file).write(file, chosen)
    tell(pipe, "written", file=str(file))


@dataclass(eq=False)
class _Watching:
    """Somebody who looks on from a browser: gets images, poses and events, and may drop what the tool holds."""

    pipe: Connection
    file: Path  # of the program
    faults: list[str]
    _began: float | None = None
    _shown: dict[str, float] = field(default_factory=dict)
    _state: dict[str, Any] = field(default_factory=lambda: {"q": {}, "objects": {}, "held": None})
    _joints: list[str] = field(default_factory=list)
    _says: dict[str, str] = field(default_factory=dict)

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
        tell(self.pipe, "run-image", camera=frame.camera, t=frame.t, data=base64.b64encode(data.tobytes()).decode())

    def close(self) -> None:
        """There are no more."""

    # As a spectator

    def wants_slip(self) -> bool:
        """Whether somebody has clicked."""
        wanted = False
        while self.pipe.poll():
            wanted = self.pipe.recv() == "slip"
        return wanted

    def told(self, fault: str, refused: str) -> None:
        """What became of the click."""
        if refused:
            tell(self.pipe, "run-event", t=None, text=f"{fault} cannot happen: {refused}", kind="refused")
            return
        self.faults.append(fault)
        tell(self.pipe, "run-fault", faults=self.faults, file=str(self.file))

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
                    tell(self.pipe, "run-state", t=event.t, **self._state)
            case "evidence":
                shown = {}
                for atom, one in event.literals.items():
                    flags = {"asked": one.asked, "predicted": one.predicted}
                    said = {"says": self._says.get(atom, atom), "value": one.value}
                    shown[atom] = {**said, **flags, "cameras": one.cameras}
                tell(self.pipe, "run-evidence", t=event.t, literals=shown)
            case "step":
                self._says = event.says
            case "primitive":
                tell(self.pipe, "run-doing", t=event.t, text=event.does or event.name)
            case "done" | "stopped" | "missed":
                tell(self.pipe, "run-event", t=event.t, text=event.reason or event.event, kind=event.event)
            case _:
                text = event_in_words(event)
                if text is not None:
                    tell(self.pipe, "run-event", t=event.t, text=text, kind=event.event)


def play(file: Path, faults: Sequence[str], seed: int, pipe: Connection) -> None:
    """Run a program in the simulated cell."""
    from sqrp_cli.ask.api.program import open_program
    from sqrp_cli.ask.requests import RunRequest

    opened = open_program(file, seed=seed)
    watching = _Watching(pipe, file, [*faults])
    tell(pipe, "run-began", file=str(file), cameras=list(opened.workspace.cameras), faults=list(faults))
    run = opened.run_into(RunRequest(faults, listeners=[watching]), spectator=watching)
    if watching.wants_slip():
        watching.told("slip", TOO_LATE)
    told = [
        {"name": one.name, "happened": one.happened, "detected": one.detected, "recovered": one.recovered}
        for one in run.faults
    ]
    tell(pipe, "run-ended", outcome=run.outcome, time=run.time, faults=told)


PASSING = ("run-image", "run-state", "run-evidence", "searching")  # reports that the next ones replace


@dataclass(eq=False)
class Jobs:
    """The job under way, in a process of its own, and what was found."""

    connections: Connections
    dropped: Callable[[dict[str, Any]], None]  # called with the report that a part was dropped
    offers: Sequence[Offer] = ()  # the changes that can be applied
    _process: Worker[None, None] | None = None
    _pipe: Connection | None = None
    _playing: bool = False

    def begin(self, job: Job, *, playing: bool = False) -> None:
        """Start a job instead of the one that is under way. playing: whether it is a run."""
        import multiprocessing

        self.stop()
        self.connections.forget("run-began", "run-ended", "written", "refused", "offers")
        self.offers = ()
        self._pipe, theirs = multiprocessing.Pipe()
        self._playing, work = playing, partial(_work, playing=playing)
        self._process = Worker(forked(), work, theirs, self._pipe, job, starts_others=True)
        theirs.close()
        asyncio.get_running_loop().add_reader(self._pipe.fileno(), self._reported)

    def stop(self) -> None:
        """End the job under way, in the loop that serves browsers."""
        if self._pipe is not None:
            asyncio.get_running_loop().remove_reader(self._pipe.fileno())
            self.end()
            self.connections.tell(message("job-ended"))

    def end(self) -> None:
        """End the job under way at once, once nobody is told any more."""
        if self._process is not None and self._pipe is not None:
            self._process.kill()
            self._pipe.close()
            self._process = self._pipe = None

    def drop(self) -> None:
        """Drop what the tool holds in the run under way. Raises InputError where that is over."""
        if self._playing and self._pipe is not None and select.select([], [self._pipe], [], 0.0)[1]:
            with suppress(OSError):  # it has just ended
                self._pipe.send("slip")
                return
        raise bad_input("bad-fault", f"nothing was dropped: {TOO_LATE}")

    def _reported(self) -> None:
        assert self._pipe is not None  # noqa: S101 - it is read
        try:
            text, offers = self._pipe.recv()
        except (EOFError, OSError):
            self.stop()
            return
        do = kind_of(text)
        if do == "offers":
            self.offers = offers
        if do == "run-fault":
            self.dropped(json.loads(text))
        if do in ("offers", "run-began", "run-ended"):
            self.connections.post(do, text)
        else:
            self.connections.tell(text, passing=do in PASSING)

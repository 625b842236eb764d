"""A program, to run in the simulated cell, replay from a log, or compare with recorded frames."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask import values
from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.ask.request import question
from sqrp_cli.ask.requests import AuditRequest, RunRequest
from sqrp_cli.errors import InputError, Place, Problem, bad_input, bad_option, expected_names
from sqrp_cli.records import dataclass

if TYPE_CHECKING:
    from sqrp_cli.ask.api.run_results import SimulatedRun
    from sqrp_cli.cell.workspace import Workspace, World
    from sqrp_cli.field.audit.bag_footage import Footage
    from sqrp_cli.field.audit.report import AuditDocument, AuditedCamera
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.platform.processes import Progress
    from sqrp_cli.program.record import Program, Replanner, Step
    from sqrp_cli.run.cell.simulated_cell import SimulatedCell
    from sqrp_cli.run.faults import InjectedFault
    from sqrp_cli.run.record.bag_recorder import BagRecorder
    from sqrp_cli.run.record.events import Event, Listener, ProgramStep
    from sqrp_cli.run.record.images import ImageRecorder
    from sqrp_cli.run.record.report import RunReport, SweepDocument
    from sqrp_cli.run.run import Recording
    from sqrp_cli.show.documents.explanation import Explanation

PROGRAM = "program.yaml"  # the program in a folder of frames that a run keeps
LONG = re.compile(r"(?<![\w.])\d+\.\d{3,}(?!\w)")  # a time of a formula that has more decimals than are shown
DEFAULT_RUNS = 20  # runs of a sweep


def is_program(path: Path) -> bool:
    """Whether a file says that it is a program, sound or not."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return re.search(rb"^sqrp_program\s*:", file.read(200_000), re.MULTILINE) is not None


def start_of(named: Path, after: Path | None) -> tuple[Path, Path | None]:
    """The workspace, and the program after which a task starts; None: in the world of the workspace.

    named: a workspace, or a program in place of its workspace and of `after`. Raises InputError.
    """
    if not is_program(named):
        return named, after
    if after is not None:
        message = f"{named} is a program, so the task starts after it and not after {after}"
        raise bad_option(message, mend="leave out --after, or name a workspace")
    from sqrp_cli.program.file import find_workspace, load_program

    return find_workspace(load_program(named), named), named


def open_program(path: str | Path, *, seed: int = 0) -> OpenProgram:
    """Read a program and the workspace that it was made for.

    seed: of everything that a run draws at random. Raises InputError for a program without steps, or one that does not
    fit its workspace as it is now.
    """
    program = OpenProgram.read(values.path.read(path, "path"), values.count(0).read(seed, "seed"))
    if program.cell.errors:
        raise InputError(*program.cell.errors)
    program.check()
    return program


def audited(opened: OpenProgram, ask: AuditRequest) -> AuditDocument:
    """A recording against what the program predicts, once moved cameras and wrong clocks are found."""
    from sqrp_cli.platform.simulator import check_packages

    check_packages()
    from sqrp_cli.field.audit.frame_audit import audit

    program, workspace = opened.program, opened.workspace
    footage = opened.footage(Path(ask.recording), ask.topics or {})
    unsurveyed, cameras = None, {}
    try:  # without an OpenGL that draws, nothing is known of cameras
        from sqrp_cli.field.audit.survey import survey

        cameras = survey(program, workspace, footage, ask.progress)
    except InputError as error:
        if error.problems[0].code != "no-opengl":
            raise
        unsurveyed = error.problems[0].message
    with ask.progress(f"Looking at {ask.recording}", len(footage.frames)) as advance:
        found = audit(program, workspace, footage, cameras, ask.threshold, lambda: advance(1))
    patch = ""
    with suppress(InputError):
        patch = cameras_patch(workspace, cameras)
    return replace(found, unsurveyed=unsurveyed, patch=patch)


def cameras_patch(workspace: Workspace, cameras: Mapping[str, AuditedCamera]) -> str:
    """The change of the workspace file that puts cameras where they are; empty where none has moved.

    Raises InputError where the file does not say itself where such a camera is.
    """
    from sqrp_cli.cell.edits import with_camera
    from sqrp_cli.cell.workspace_file import read_workspace_document
    from sqrp_cli.files.yaml_edit import patch
    from sqrp_cli.files.yaml_file import parse_yaml
    from sqrp_cli.geometry import read_only

    document = read_workspace_document(workspace.whole_file.file)
    content = document.content
    for name, one in cameras.items():
        if one.pose is not None and one.pose.moved:
            moved = replace(workspace.cameras[name], X_FC=read_only(one.pose.pose))
            content = with_camera(parse_yaml(document.path, content), workspace.cameras[name], moved, None)
    return patch(document, content)


@dataclass(frozen=True, eq=False)
class OpenProgram:
    """A program to run, sweep or audit. What goes wrong in a run is a result; bad input raises InputError."""

    path: Path
    program: Program
    cell: OpenCell

    def __repr__(self) -> str:
        steps = ", ".join(step.short_task for step in self.program.steps)
        return f"OpenProgram({self.path.name} for {self.workspace.name}: {steps})"

    @classmethod
    def read(cls, path: Path, seed: int = 0) -> OpenProgram:
        """A program and its current workspace, whether or not they still fit."""
        from sqrp_cli.program.file import find_workspace, load_program

        program = load_program(path)
        return cls(path, program, OpenCell.read(find_workspace(program, path), seed))

    def check(self) -> None:
        """Raises InputError for a program that has no steps or does not fit its workspace."""
        from sqrp_cli.program.file import check_program

        check_program(self.program, self.path, self.workspace)
        if not self.program.steps:
            raise bad_input("no-steps", "this program has no steps", Place(self.path))

    def check_ran(self, ran: Sequence[Step] | Sequence[ProgramStep], what: str, place: Place, mend: str) -> None:
        """Raises InputError where steps that were run are not its own; what: tells of that run, at a place."""
        runs = [[(one.skill, dict(one.parameters), one.time) for one in steps] for steps in (ran, self.program.steps)]
        if runs[0] != runs[1]:
            same = set.intersection(*({*parameters.items()} for run in runs for _, parameters, _ in run))
            told: list[list[str]] = [[], []]
            for words, steps in zip(told, runs, strict=True):
                for skill, parameters, time in steps:
                    own = [f"{name}={value}" for name, value in parameters.items() if (name, value) not in same]
                    words.append(" ".join([skill, *own, f"of {time:.2f} s"]))
            was, now = map(", ".join, told)
            message = f"{what} not of a run of {self.path} as it is now: that was {was}; now it is {now or 'empty'}"
            raise bad_input("other-program", message, place, mend=mend)

    @property
    def workspace(self) -> Workspace:
        """The workspace that it was made for."""
        return self.cell.workspace

    @property
    def files(self) -> list[Path]:
        """The files that it was read from."""
        return [self.path, *self.cell.files]

    @property
    def warnings(self) -> list[Problem]:
        """Warnings about formulas that monitors cannot judge because the motion itself contradicts them."""
        from sqrp_cli.run.monitor.nominal_step import NominalStep
        from sqrp_cli.run.monitor.step_monitor import against_the_plan
        from sqrp_cli.run.robot_body import RobotBody

        mend = "correct the formula, or the boxes of its literals: one about an object holds while that is in its boxes"
        body, joints = RobotBody.load(self.workspace.robot), self.program.joints
        return [
            Problem(
                "against-the-plan",
                re.sub(LONG, lambda t: f"{float(t[0]):.2f}", text),
                Place(self.path),
                severity="warning",
                mend=mend,
            )
            for number, step in enumerate(self.program.steps, 1)
            for wrong in against_the_plan(NominalStep(step, joints, body))
            for text in [f"step {number} (`{step.short_task}`): {wrong}"]
        ]

    def read_faults(
        self, faults: Sequence[str], option: str = "faults", *, served: bool = False
    ) -> list[InjectedFault]:
        """Faults read from texts; random instants are the same each time.

        option: what gives them, for messages. served: whether they happen to a cell that is served to others. Raises
        InputError for a text that is no fault of this program.
        """
        import numpy as np

        from sqrp_cli.run.faults import parse_fault

        values.texts("texts such as ['slip@lift+0.4']").read(faults, option)
        rng, steps, cameras = np.random.default_rng(self.cell.seed), self.program.steps, self.workspace.cameras
        return [parse_fault(text, steps, cameras, rng, option, served=served) for text in faults]

    def explain(self, step: int | None = None, *, option: str = "step") -> Explanation:
        """Explain a step, from 1; by default the one that is seen worst. See `OpenCell.explain`.

        option: what gives the step, for messages. Raises InputError if there is no such step.
        """
        from sqrp_cli.ask.api.session import Session
        from sqrp_cli.study.pipeline import RankJob
        from sqrp_cli.study.program_update import candidate_of
        from sqrp_cli.study.ranking import rank
        from sqrp_cli.study.whole_analysis import worst_seen
        from sqrp_cli.task.candidate import Task

        steps = self.program.steps
        if step is None:
            step = 1 + worst_seen(steps)
        if values.count(1).read(step, option) > len(steps):
            upto = f"{len(steps)} steps; expected 1 to {len(steps)}" if len(steps) > 1 else "1 step; expected 1"
            raise bad_option(f"{option} is {step}, but {self.path} has {upto}")
        cell, chosen = self.cell.cell, steps[step - 1]
        job = RankJob(cell=cell, world=chosen.before)
        candidate = candidate_of(chosen, cell)
        task = Task(chosen.short_task, candidate.skill, (candidate,))
        ranking = rank([job.assess(candidate)], "q_eoi")
        place = {"step": step, "of_steps": len(steps)}
        return Session(task, job).explanation(job.explain(ranking[0]), ranking, **place)

    def run_into(
        self,
        ask: RunRequest,
        *,
        spectator: Any = None,  # noqa: ANN401 - see `ImageRecorder` and `Recording`
        elsewhere: Callable[[Recording], RunReport] | None = None,
    ) -> SimulatedRun:
        """A run in the simulated cell, watched through camera images alone.

        Raises InputError, before anything is written, where an output would replace an input or another output.
        spectator: is shown the images with what is seen in them, instead of a film, and may cause faults. elsewhere:
        runs it in another cell, to which no faults can be made to happen.
        """
        from sqrp_cli.ask.api.run_results import SimulatedRun
        from sqrp_cli.platform.files import check_writable
        from sqrp_cli.platform.simulator import check_simulator
        from sqrp_cli.program.file import made_for, save_program
        from sqrp_cli.run.record.events import event, run_began
        from sqrp_cli.run.record.log import written_log

        ask.check_outputs(self.files)
        workspace = self.workspace
        injected = self.read_faults(ask.faults, ask.called("faults"))
        if elsewhere is None:
            check_simulator()
        from sqrp_cli.run.run import Recording

        for path in filter(None, (ask.film, ask.log)):
            check_writable(path)
        events: list[Event] = []
        with ExitStack() as closing:  # closes the others even if one fails to close
            recorder, gallery = _recorders(workspace, ask, spectator, closing)
            texts = [fault.text for fault in injected]
            began, logged = run_began(self.program, workspace, self.cell.seed, texts), None
            if ask.log is not None:
                logged = closing.enter_context(written_log(ask.log, began))
            heard: list[Listener] = [
                one for one in (logged, *ask.listeners, events.append, recorder) if one is not None
            ]
            states = ask.witnessed or logged is not None or recorder is not None
            if ask.frames is not None:
                save_program(made_for(self.program, ask.frames / PROGRAM, workspace), ask.frames / PROGRAM)
            recording = Recording(heard, gallery, states=states, spectator=spectator)
            if elsewhere is not None:
                report = elsewhere(recording)
            else:
                with self.simulated_cell() as cell:
                    report = self.simulate(cell, injected, recording)
            if logged is not None:
                logged(event("report", report.time, report=report))
        happened = Counter(event.fault for event in events if event.event == "injected")
        return SimulatedRun(
            **vars(report),
            began=began,
            drawn=workspace,
            events=events,
            never_happened=list((Counter(texts) - happened).elements()),
            inputs=self.files,
            asked=ask,
        )

    run = question(RunRequest, run_into)
    audit = question(AuditRequest, audited)

    def sweep(
        self, slip: str, count: int = DEFAULT_RUNS, *, progress: Progress = values.silent, option: str = "slip"
    ) -> SweepDocument:
        """Run the program `count` times with a slip at other instants of a primitive action.

        slip: as `sqrp run --sweep` takes it, such as `slip@lift`; option: what gives it, for messages. At Ctrl-C the
        result has the runs that are finished.
        """
        from sqrp_cli.run.faults import InjectedFault, parse_sweep
        from sqrp_cli.run.record.report import FaultRecord, SweepDocument, SweptRun

        values.text("a slip and where, such as `slip@lift`").read(slip, option)
        values.count(1).read(count, "count")
        values.progress.read(progress, "progress")
        number, primitive = parse_sweep(slip, self.program.steps, option)
        runs: list[SweptRun] = []
        with suppress(KeyboardInterrupt), progress(f"Sweeping {slip}", count) as advance, self.simulated_cell() as cell:
            for index in range(count):  # in the middle of as many equal parts of the primitive
                x = primitive.start + (index + 0.5) / count * (primitive.end - primitive.start)
                report = self.simulate(cell, [InjectedFault("slip", f"slip@{x:.3f}", x, step=number)])
                advance(1)
                # A run may see a fault that was not injected, or stop, before the step begins.
                fault = next((one for one in report.faults if one.injected is not None), FaultRecord("slip"))
                swept = SweptRun(**vars(fault), x=x, outcome=report.outcome, reason=report.reason, time=report.time)
                runs.append(swept)
        slowest = max(1.0 / camera.rate for camera in self.workspace.cameras.values())
        tasks = [step.short_task for step in self.program.steps]
        asked = {"workspace": self.workspace.name, "sweep": slip, "step": number, "steps": tasks}
        return SweepDocument.of(runs, slowest, count=count, **asked)

    def footage(self, path: Path, topics: Mapping[str, str]) -> Footage:
        """A recording of the program's run, of any kind; topics: see `audit`.

        Raises InputError for what is none, and for frames beside which lies another program that was run.
        """
        from sqrp_cli.field.audit.bag_footage import BagFootage
        from sqrp_cli.field.audit.footage import FolderFootage
        from sqrp_cli.program.file import load_program
        from sqrp_cli.ros.bag import check_kind, is_bag

        unknown = [name for name in topics if name not in self.workspace.cameras]
        if unknown:
            message = f"there is no camera {unknown[0]}; {expected_names(unknown[0], list(self.workspace.cameras))}"
            raise bad_input("unknown-camera", message)
        check_kind(path)
        if path.exists() and is_bag(path):
            return BagFootage(self.program, self.workspace, path, topics)
        if (kept := path / PROGRAM).is_file():
            mend = f"name the program that was run: {kept}"
            self.check_ran(load_program(kept).steps, "these frames are", Place(path), mend)
        return FolderFootage(self.program, self.workspace, path)

    @cached_property
    def replanner(self) -> Replanner:
        """Plans retries."""
        return late_replanner(self.workspace)

    def simulated_cell(self) -> SimulatedCell:
        """A simulated cell at the start of the program. Raises InputError where the simulator cannot be used."""
        from sqrp_cli.platform.simulator import check_simulator

        check_simulator()
        from sqrp_cli.run.cell.simulated_cell import SimulatedCell  # MuJoCo is not needed to command a real cell

        return SimulatedCell(self.workspace, self.program.steps[0].before, self.cell.seed)

    def simulate(
        self, cell: SimulatedCell, faults: Sequence[InjectedFault] = (), recording: Recording | None = None
    ) -> RunReport:
        """One run in a simulated cell of its own, which can be used again: that saves the time to make it."""
        from sqrp_cli.run.run import Run

        cell.reset(self.program.steps[0].before)
        return Run(self.program, self.workspace, cell, self.replanner, faults, recording).run()


def read_run(log: str | Path) -> SimulatedRun:
    """A run read from its log. Raises InputError for anything but the log of a complete run."""
    if (run := run_of_log(file := values.path.read(log, "log"))) is None:
        raise interrupted_log(file)
    return run


def run_of_log(
    log: Path, program: OpenProgram | None = None, *listeners: Callable[[Event], None]
) -> SimulatedRun | None:
    """The run of a log, None if it was interrupted; listeners: called with each event.

    program: that was run; it knows where everything stands. Raises InputError for anything but a log, and for a program
    whose steps are not those of the log.
    """
    from sqrp_cli.ask.api.run_results import SimulatedRun
    from sqrp_cli.run.record.log import read_log

    events = read_log(log)
    header, workspace = next(events), None if program is None else program.workspace
    if program is not None and header.steps:
        mend = shlex.join(["sqrp", "run", "--replay", str(log)])
        program.check_ran(header.steps, "this log is", Place(log, 1), mend)
    report, kept = None, []
    for event in events:
        if event.event == "report":
            report = event.report
            continue
        kept.append(event)
        for listener in listeners:
            listener(event)
    if report is None:
        return None
    why_flat = ""  # of its page: without the workspace there are no shapes, nor if that has changed since
    if workspace is None:
        mend = "sqrp run PROGRAM --replay LOG --report FILE"
        why_flat = f"a log has no shapes; `{mend}` takes them from the workspace"
    elif workspace.name != header.workspace:
        why_flat = f"this program is for the workspace {workspace.name}, the run was in {header.workspace}"
    elif header.digest not in workspace.digests:
        why_flat = "the workspace of this program is not as it was in the run"
    inputs = [log, *([] if program is None else program.files)]
    drawn = {"began": header, "drawn": None if why_flat else workspace, "why_flat": why_flat}
    known = {**vars(report), "workspace": header.workspace, **drawn}
    return SimulatedRun(**known, events=kept, never_happened=(), inputs=inputs, asked=RunRequest())


def interrupted_log(log: Path) -> InputError:
    """The error where the log of a run that was interrupted is not enough."""
    message = "this log ends without a report, as the run was interrupted; expected one of a run that ended"
    return bad_input("no-log", message, Place(log), mend=shlex.join(["sqrp", "run", "--replay", str(log)]))


def late_replanner(workspace: Workspace, speed: float = 1.0) -> Callable[[Step, World], Step | None]:
    """Plans a step again at a share of its speed, see `replanned`; loads what plans only then."""
    cell: Cell | None = None

    def replan(step: Step, world: World) -> Step | None:
        from sqrp_cli.motion.cell import Cell
        from sqrp_cli.run.slowed import slowed
        from sqrp_cli.study.program_update import replanned

        nonlocal cell
        cell = cell or Cell.load(workspace)
        planned = replanned(cell, step, world)
        return None if planned is None else slowed(planned, speed)

    return replan


def _recorders(
    workspace: Workspace,
    ask: RunRequest,
    screen: Any,  # noqa: ANN401
    closing: ExitStack,
) -> tuple[BagRecorder | None, ImageRecorder | None]:
    """Writers of a run for ROS tools, and of its images; a recording leaves nothing behind if all fails."""
    recorder = None
    if ask.is_recording:
        from sqrp_cli.ros.bag import BagWriter
        from sqrp_cli.run.record.bag_recorder import BagRecorder
        from sqrp_cli.run.robot_body import RobotBody

        body, writer = RobotBody.load(workspace.robot), BagWriter(ask.film)
        closing.callback(writer.discard)
        recorder = BagRecorder(writer, workspace, body)
    if ask.film is None and ask.frames is None and screen is None:
        return recorder, None
    from sqrp_cli.run.record.images import Film, ImageRecorder

    rate = max(camera.rate for camera in workspace.cameras.values())
    filmed = ask.film is not None and recorder is None
    reel = Film(ask.film, list(workspace.cameras), rate) if filmed else screen
    gallery = ImageRecorder(ask.frames, reel, recorder)
    closing.callback(gallery.close)
    return recorder, gallery

"""Results of running a program: one run, a sweep, and an audit of recorded frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.api.results import Answer
from sqrp_cli.ask import values
from sqrp_cli.document import how_many
from sqrp_cli.errors import InputError, bad_option

if TYPE_CHECKING:
    from sqrp_cli.ask.requests import RunRequest
    from sqrp_cli.knowledge.workspace.workspace import Workspace
    from sqrp_cli.program.record import Program
    from sqrp_cli.report.documents.runs import AuditDocument, RunDocument, SweepDocument
    from sqrp_cli.report.pages.run_page import RunCell
    from sqrp_cli.runtime.audit.frame_audit import AuditReport
    from sqrp_cli.runtime.audit.survey import CameraSurvey
    from sqrp_cli.runtime.record.events import Event
    from sqrp_cli.runtime.record.report import RunReport
    from sqrp_cli.runtime.run.simulation import SweepRun, SweepSummary


@dataclass(frozen=True, kw_only=True)
class RunOutputs:
    """Files and folders that a run writes; None: not wanted."""

    film: Path | None = None
    """A film, or a recording for ROS tools, by its suffix."""
    log: Path | None = None
    frames: Path | None = None
    """A folder."""
    page: Path | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    """What messages call a field whose option has another name, such as `--record` for `film`."""

    @classmethod
    def of(cls, ask: RunRequest, page: Path | None = None) -> RunOutputs:
        """What a run is asked to write."""
        given = {"film": ask.film, "log": ask.log, "frames": ask.frames}
        paths = {name: None if path is None else Path(path) for name, path in given.items()}
        options = {name: ask.called(name) for name in given} | {"page": "path" if page is None else "--report"}
        return cls(**paths, page=page, options=options)

    @property
    def named(self) -> dict[str, Path | None]:
        """Each by what messages call it."""
        paths = {"film": self.film, "log": self.log, "frames": self.frames, "page": self.page}
        return {self.options.get(name, name): path for name, path in paths.items()}

    def check_names(self) -> None:
        """Raises InputError for a name that no film can have, and where two outputs have the same."""
        from sqrp_cli.platform.files import check_distinct

        if self.film is not None:
            _check_film(self.film, self.options.get("film", "film"))
        check_distinct(self.named)

    def check_not_read(self, inputs: Iterable[Path]) -> None:
        """Raises InputError where an output file is also an input file; a folder of frames is new or empty."""
        from sqrp_cli.platform.files import check_not_read

        check_not_read([self.film, self.log, self.page], inputs)


def is_recording(path: Path | None) -> bool:
    """Whether a film's name is that of a recording for ROS tools."""
    from sqrp_cli.ros.bag import SUFFIXES

    return path is not None and path.suffix.lower() in SUFFIXES


def _check_film(path: Path, name: str) -> None:
    """Raises InputError for a name that neither a recording nor an MP4 film of OpenCV can have."""
    if is_recording(path):
        return
    if path.suffix.lower() != ".mp4":
        expected = "expected a name that ends in .mp4 (film), .mcap (recording) or .bag (recording of ROS 1)"
        raise bad_option(f"{name} is `{path}`; {expected}")
    if str(path) != str(path).encode(errors="ignore").decode():
        raise bad_option(f"{name} is `{path}`, which is not UTF-8 text; films are written by a library that needs it")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SimulatedRun(Answer["RunDocument"]):
    """How a run of a program went."""

    cell: RunCell
    report: RunReport
    events: Sequence[Event]
    """What happened, in order."""
    never_happened: tuple[str, ...] = ()
    """Faults that never happened."""
    inputs: Sequence[Path] = ()
    """The files that it was read from, over which no page is written."""
    outputs: RunOutputs = field(default_factory=RunOutputs)
    """What it was kept in; neither."""

    @property
    def done(self) -> bool:
        """Whether the program was completed."""
        return self.report.outcome == "done"

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        report = self.report
        steps, faults = how_many(report.steps, "step"), how_many(report.faults, "fault")
        return f"{self.cell.name}: {report.outcome} at {report.time:.2f} s, {steps}, {faults}, {report.images} images"

    @cached_property
    def document(self) -> RunDocument:
        """The document of `sqrp run`."""
        from sqrp_cli.report.documents.runs import RunDocument

        return RunDocument.of(self.cell.name, self.report)

    def show(self) -> None:
        """Print what `sqrp run` prints."""
        from sqrp_cli.terminal.run_view import print_run

        print_run(self.cell.name, self.report)

    def write_page(self, path: str | Path, arguments: Sequence[str] = ()) -> None:
        """Write a page that plays the run; arguments: of the command that it names.

        Raises InputError if it cannot be written, or would replace a file that the run read or wrote.
        """
        from sqrp_cli.report.pages.run_page import write_run

        file = values.PATH.read(path, "path")
        values.texts("the words of a command, in a list").read(arguments, "arguments")
        outputs = replace(self.outputs, page=file)
        outputs.check_names()
        outputs.check_not_read(self.inputs)
        write_run(self.cell, self.report, self.events, file, arguments)


@dataclass(frozen=True, eq=False, repr=False)
class SlipSweep(Answer["SweepDocument"]):
    """Runs of a program with a slip at different instants, and how well the delays were predicted."""

    program: Program
    workspace: str
    text: str
    """The swept slip, such as `slip@a4`."""
    step: int
    """Number of the step that was swept, from 1."""
    runs: Sequence[SweepRun]
    """Those that are finished."""
    summary: SweepSummary
    count: int
    """How many runs were asked for."""

    @property
    def interrupted(self) -> bool:
        """Whether some are missing because of Ctrl-C."""
        return len(self.runs) < self.count

    @property
    def done(self) -> bool:
        """Whether all runs were completed."""
        return not self.interrupted and all(run.report.outcome == "done" for run in self.runs)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        done = sum(run.report.outcome == "done" for run in self.runs)
        cut = ", interrupted" if self.interrupted else ""
        return f"{self.text} in step {self.step}, {self.workspace}: {done} of {how_many(self.runs, 'run')} done{cut}"

    @cached_property
    def document(self) -> SweepDocument:
        """The document of `sqrp run --sweep`."""
        from sqrp_cli.report.documents.runs import SweepDocument

        return SweepDocument.of(
            self.workspace, self.text, self.step, self.runs, self.summary, interrupted=self.interrupted
        )

    def show(self) -> None:
        """Print what `sqrp run --sweep` prints."""
        from sqrp_cli.terminal.console import say
        from sqrp_cli.terminal.run_view import print_sweep

        if self.runs:
            print_sweep(self.program, self.step, self.workspace, self.text, self.runs, self.summary)
        if self.interrupted:
            are = "is" if 1 in (len(self.runs), self.count) else "are"
            of_all = f"of {self.count} slip{'' if self.count == 1 else 's'}"
            say(f"Interrupted: {len(self.runs)} {of_all} {are} finished.", "yellow")


@dataclass(frozen=True, eq=False, repr=False)
class Audit(Answer["AuditDocument"]):
    """What recorded frames say about the predictions of a program."""

    program: Program
    workspace: Workspace
    report: AuditReport
    threshold: float
    """Least share of predicted detections that must have come true."""
    cameras: Mapping[str, CameraSurvey]
    """Where each camera of the recording is, and what its clock says."""
    unsurveyed: str = ""
    """Why that is not known of any."""
    written: bool = False
    """Whether its patch was written to a file."""

    @property
    def not_as_stated(self) -> list[str]:
        """The cameras that are known to have moved, and the clocks that are wrong, in words."""
        moved = [f"{name} has moved" for name, one in self.cameras.items() if one.has_moved]
        wrong = {name for name, one in self.cameras.items() if one.has_wrong_clock} | {*self.report.apart}
        return [*moved, *(f"the clock of {name} is wrong" for name in sorted(wrong))]

    @property
    def passed(self) -> bool:
        """Whether so many came true, no camera is known to have moved and no clock to be wrong."""
        precision = self.report.total.precision
        return precision is not None and precision >= self.threshold and not self.not_as_stated

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        precision = self.report.total.precision
        share = "nothing was predicted" if precision is None else f"{100 * precision:.1f} % of predictions came true"
        passed = "passed" if self.passed else "not passed"
        return ", ".join([f"{self.workspace.name}: {share}", *self.not_as_stated, passed])

    @cached_property
    def patch(self) -> str:
        """The change of the workspace file that puts cameras where they are; empty where none has moved.

        Raises InputError where the file does not say itself where such a camera is.
        """
        from sqrp_cli.knowledge.text.yaml_edit import patch
        from sqrp_cli.knowledge.text.yaml_file import parse_yaml
        from sqrp_cli.knowledge.workspace.edits import with_camera
        from sqrp_cli.knowledge.workspace.workspace_file import read_workspace_document

        document = read_workspace_document(self.workspace.whole_file.file)
        content = document.content
        for one in self.cameras.values():
            if one.has_moved:
                moved = replace(one.camera, X_FC=one.X_FC)
                content = with_camera(parse_yaml(document.path, content), one.camera, moved, None)
        return patch(document, content)

    @cached_property
    def document(self) -> AuditDocument:
        """The document of `sqrp audit`."""
        from sqrp_cli.report.documents.runs import AuditDocument

        try:
            patch = self.patch
        except InputError:
            patch = ""
        return AuditDocument.of(self.workspace.name, self.report, self.threshold, self.cameras, self.passed, patch)

    def show(self) -> None:
        """Print what `sqrp audit` prints."""
        from sqrp_cli.terminal.audit_view import print_audit

        print_audit(
            self.program,
            self.workspace.name,
            self.report,
            self.threshold,
            self.cameras,
            unsurveyed=self.unsurveyed,
            not_as_stated=self.not_as_stated,
            written=self.written,
        )

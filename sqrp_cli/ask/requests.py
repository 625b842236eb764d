"""What may be asked: a request for each question of Python, and fields that they and commands share.

A command is its question, with what only a command line says: see `cli.command`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from sqrp_cli.ask import values
from sqrp_cli.ask.request import FieldKind, OptionWord, Request, argument, flag, option, optional, options, value
from sqrp_cli.errors import bad_option

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import World
    from sqrp_cli.logic.planner import Planner
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.platform.processes import Progress
    from sqrp_cli.run.record.events import Listener
    from sqrp_cli.score.compute import Means, Workers
    from sqrp_cli.search.goal import Objective
    from sqrp_cli.study.find import TimeLimit
    from sqrp_cli.study.pipeline import RankJob
    from sqrp_cli.study.result import Criterion
    from sqrp_cli.study.robustness import Calibration
    from sqrp_cli.study.sampling import Sampling

Ways = Literal["best", "all", "first"]
Certificates = tuple[Path, Path, Path]  # files of a certificate of an authority, of one's own, and of its key
AnyPath = Any  # a path, which Python may also give as text
TASK = values.text("a skill and what to do it with, such as `pickup green`")


# Fields that several requests and commands share.

WORKSPACE: Any = argument("WORKSPACE", "Folder of a workspace, or its YAML file.", values.path)
START: Any = argument(
    "WORKSPACE", "Folder of a workspace, its YAML file, or a PROGRAM: to go on after it.", values.path
)
PROGRAM: Any = argument("PROGRAM", "A program file, as `sqrp rank --program` writes.", values.path)
SEED: Any = option("--seed", "Seed of everything that is drawn at random.", values.count(0), default=0)
JSON: Any = flag("--json", "Print one JSON document and nothing else.")
WATCH: Any = flag("--watch", "Again whenever a file of the cell is saved, old and new side by side, until Ctrl-C.")
REPORT: Any = options(
    OptionWord("--report FILE", "Write a page with charts and 3D playback, for any browser.", Path),
    OptionWord("--open", "With --report: show the page in a browser.", bool),
    kind=values.page,
)
CLUSTER: Any = option(
    "--cluster ADDRESS",
    "Compute on this Dask cluster: tcp://HOST:PORT or scheduler file.",
    values.text("an address or a file"),
)
TLS: Any = option(
    "--tls CA CERT KEY",
    "With --cluster: encrypt, by the certificate of its authority, your own, and its key (PEM files).",
    FieldKind(Certificates, lambda value, _: value),
)
CHOOSE: Any = option(
    "--choose best|N|NAME",
    "Which candidate: best, its place in the ranking, or its name; best by default.",
    values.text("the name of a candidate, or `best`"),
    default="best",
    complete="candidates",
)
JOBS: Any = option(
    "--jobs",
    "Processes at most; by default one per core.",
    values.count(1),
    default=1,
    absent=lambda: os.cpu_count() or 1,
)
PROGRESS: Any = value(
    values.progress,
    default=values.silent,
    absent=lambda: import_module("sqrp_cli.show.terminal.console").progress,
)
"""Called with a title and a total; gives what is called with how many are done. A command shows it."""
SAMPLING: Any = options(
    OptionWord("--samples N", "N samples per piece of motion, instead of as many as needed.", int),
    OptionWord("--dt S", "A sample every S seconds, instead of as many as needed."),
    OptionWord("--tolerance POINTS", "How exact shares of time are to be, in points; 0.1 by default.", float),
    kind=values.sampling,
)
"""Adaptive by default."""
OUT: Any = option("--out DIR", "Keep results here as they finish; those there are used.", values.path)
AFTER: Any = option("--after PROGRAM", "Start from the world that this program leaves behind.", values.path)
MAX_TIME: Any = option(
    "--max-time T", "How long a way may take: 20 s, or 1.25x the time of the fastest of all.", values.time_limit
)


def _ways(help: str, *more: str, shown: str = "--ways") -> Any:  # noqa: A002, ANN401 - a field, as `option` makes it
    """Which ways of a candidate count. more: further words than best and first."""
    return option(shown, help, values.one_of("best", *more, "first", fastest="first"), default="best")


# Questions about a task.


class TaskRequest(Request):
    """A task in a cell."""

    task: str = argument(
        "TASK", 'A skill and what to do it with, such as "pickup red screw".', TASK, complete="tasks", kw_only=False
    )
    ways: Ways = _ways(
        "best: of all ways of a candidate that which is seen best; first: the first that is found, seen or not."
    )
    after: AnyPath = AFTER
    sampling: Sampling | None = SAMPLING
    jobs: int = JOBS
    progress: Progress = PROGRESS

    def job(self, cell: Cell, world: World) -> RankJob:
        """What is asked of each candidate, from a world of a cell."""
        from sqrp_cli.study.find import WantedWay
        from sqrp_cli.study.pipeline import RankJob
        from sqrp_cli.study.sampling import Adaptive

        by: Criterion = getattr(self, "by", "q_eoi")
        calibration = getattr(self, "calibration", None)
        wanted = WantedWay(by, self.ways == "first", getattr(self, "max_time", None))
        return RankJob(self.sampling or Adaptive(), calibration, wanted, cell=cell, world=world)


class RankRequest(TaskRequest):
    """Rank the candidates of a task, each in its best way.

    The best are those in which the cameras see what matters. The chosen one can be written as a program.
    """

    by: Criterion = option(
        "--by",
        "What counts first: critical time seen (q_eoi, by default), time seen (q_avg), how long it takes (time), how "
        "late a fault is noticed (delay), or when all is done after a retry (expected_time).",
        values.one_of("q_eoi", "q_avg", "time", "delay", "expected_time"),
        default="q_eoi",
    )
    ways: Ways = _ways(
        "best: each candidate by the way that is seen best; all: its other ways, too, that none beats in everything; "
        "first: by the first way that is found, seen or not.",
        "all",
    )
    calibration: Calibration | None = options(
        OptionWord('--calibration "5 mm, 0.5 deg"', "What if the cameras are off by this (1 sigma)?"),
        kind=values.calibration,
        default=None,
        uses=("seed",),
    )
    """Draws of camera poses tell its effect."""
    max_time: TimeLimit | str | float | None = MAX_TIME
    worst: bool = option(
        "--worst", "The worst first, such as episodes of a recording to leave out.", values.flag, default=False
    )


class ExplainRequest(TaskRequest):
    """Explain how well the cameras see a way of doing a task.

    Shows when each camera sees each fact, and what is in the way when it does not.
    """

    choose: str | None = CHOOSE._replace(kind=values.choice, kw_only=False)
    ways: Ways = _ways(
        "all (also without a value): show the other ways, too, that none beats in everything; first: explain the way "
        "that is found first, seen or not.",
        "all",
        shown="--ways [best|all|first]",
    )
    step: int | None = optional(
        "--step", "Of a task of several steps, or of a program: which; by default the one seen worst.", values.count(1)
    )
    windows: float | None = optional(
        "--windows TIME",
        "When does a camera have all in free view for so long, such as 500 ms, and what would open such a window?",
        values.seconds,
    )
    max_time: TimeLimit | str | float | None = MAX_TIME


class AdviseRequest(TaskRequest):
    """Find the least change that lets the cameras see enough.

    The motion comes first, then what it handles, cameras last: their aim, position, lens, and another camera.
    """

    want: str | None = optional(
        "--want GOAL",
        'Of q_eoi, q_avg, time, delay, such as "q_eoi 100 %, delay 1 s"; by default the thresholds of the task.',
        values.text("a goal such as `q_eoi 100 %, time 20 s`"),
    )
    kinds: Any = optional(
        "--kinds KIND,...", "What may change, all of it: way, path, object, aim, position, lens, camera.", values.kinds
    )
    ways: Ways = _ways("first: the motion stays as rank --ways first has it.")
    choose: str = CHOOSE
    out: AnyPath = OUT


class CheckRequest(Request):
    """Validate a workspace, and a task in it.

    With a task, show which candidates can be done, why the others cannot, and what would have to be done first. Times
    are those of `rank --ways first`; without that, rank takes the best of all ways.
    """

    task: str | None = argument(
        "TASK", 'Check this task as well, such as "pickup green".', TASK, default=None, complete="tasks", kw_only=False
    )
    plan: bool | None = value(values.where_needed, default=None)
    """Whether to plan the steps to do first; by default if no candidate can be done at once."""
    planner: Planner | None = optional("--planner NAME", "Plan with this engine of unified-planning.", values.planner)
    after: AnyPath = AFTER
    jobs: int = JOBS
    progress: Progress = PROGRESS


# Questions about many tasks.


class ScoreRequest(Request):
    """Score all tasks of workspaces.

    Each task's best candidate is compared with the thresholds in its workspace.
    """

    sampling: Sampling | None = SAMPLING
    jobs: int = JOBS
    progress: Progress = PROGRESS
    out: AnyPath = OUT

    def means(self, seed: int, workers: Workers | None = None) -> Means:
        """What computes it. seed: of everything that planning draws at random."""
        from sqrp_cli.score.compute import Means
        from sqrp_cli.study.sampling import Adaptive

        return Means(self.sampling or Adaptive(), self.jobs, workers, self.out, seed)


class PlaceRequest(ScoreRequest):
    """Find where cameras should go, and prove that no others do better.

    The mounts and lenses to choose from are in the file place.yaml beside the workspace.
    """

    tasks: Sequence[str] = argument(
        "TASK...",
        "Such as `pickup green`; by default all that the workspace lists.",
        values.texts("texts such as `pickup green`"),
        default=(),
        complete="tasks",
    )
    cameras: int | None = optional("--cameras", "Most cameras on mounts.", values.count(1))
    want: str | None = optional(
        "--want GOAL",
        'As few cameras as possible with which every candidate has it, such as "q_eoi 100 %, delay 0.5 s".',
        values.text("a goal such as `q_eoi 100 %, delay 0.5 s`"),
    )
    objective: Objective = option(
        "--objective", "Which quality of all candidates counts first.", values.one_of("least", "mean"), default="least"
    )
    survive: int = option("--survive", "1: any one camera may fail.", values.count(0, 1), default=0)
    keep: Sequence[str] = option(
        "--keep CAMERA",
        "A camera of the workspace that stays.",
        values.texts("names of cameras"),
        default=(),
        complete="cameras",
    )
    budget: float | None = optional("--budget PRICE", "Most that the cameras may cost.", values.number(0.0))
    ways: Ways = _ways("first: ways stay as rank --ways first has them.")
    mounts: AnyPath = optional(
        "--mounts FILE", "Mounts and lenses; by default place.yaml beside the workspace.", values.path
    )
    time: float | None = optional(
        "--time T", "Longest time for choosing, once all mounts are looked from; then the best so far.", values.seconds
    )
    gap: float = option(
        "--gap POINTS", "How far from the best the quality may be, in points.", values.number(0.0, 100.0), default=0.0
    )


# Questions about programs.


class RunRequest(Request):
    """Run a program, watched through camera images alone.

    The robot stops, tries again or goes on as the skill says when a fault is seen.
    """

    faults: Sequence[str] = option(
        "--fault FAULT",
        "Let this happen: slip@lift+0.4, slip@lift:random, slip@7.2, miss-pick, camera-loss:cam2@5, frozen:cam1@3, "
        "latency:cam3=0.5, perception-crash:cam1@4, 2:slip@lift in step 2; repeatable.",
        values.texts("texts such as ['slip@lift+0.4']"),
        default=(),
        kw_only=False,
    )
    film: AnyPath = optional(
        "--record FILE",
        "*.mp4: film all cameras, with what is seen drawn in. *.mcap, or *.bag for ROS 1: images, joints, frames, "
        "boxes and verdicts, as Foxglove and RViz show them and `sqrp audit` reads them.",
        values.path,
    )
    log: AnyPath = optional("--log FILE", "Write what happens, one JSON document per line.", values.path)
    frames: AnyPath = optional("--frames DIR", "Keep every image, as `sqrp audit` reads them.", values.path)
    listeners: Sequence[Listener] = value(values.listeners, default=())  # called with each event as it happens
    witnessed: bool = value(values.flag, default=True)
    """Whether the events have the true poses, for a page; a log always has them."""

    @property
    def is_recording(self) -> bool:
        """Whether the film's name is that of a recording for ROS tools."""
        from sqrp_cli.ros.bag import SUFFIXES

        return self.film is not None and self.film.suffix.lower() in SUFFIXES

    def check_outputs(self, inputs: Iterable[Path | None], page: Path | None = None) -> None:
        """Raises InputError for a name that no film can have, and where an output is also another one or an input."""
        from sqrp_cli.platform.files import check_distinct, check_not_read

        if self.film is not None and not self.is_recording:
            found = f"{self.called('film')} is `{self.film}`"
            if self.film.suffix.lower() != ".mp4":
                expected = "expected a name that ends in .mp4 (film), .mcap (recording) or .bag (recording of ROS 1)"
                raise bad_option(f"{found}; {expected}")
            if str(self.film) != str(self.film).encode(errors="ignore").decode():
                raise bad_option(f"{found}, which is not UTF-8 text; films are written by a library that needs it")
        files = {self.called("film"): self.film, self.called("log"): self.log}
        files["--report" if self.by_words else "path"] = page
        check_distinct({**files, self.called("frames"): self.frames})
        check_not_read(files.values(), inputs)


class AuditRequest(Request):
    """Compare recorded camera images with what a program predicts.

    Shows which cameras have moved, which clocks are wrong, and how often each camera showed each fact when it was
    predicted to.
    """

    recording: AnyPath = argument(
        "RECORDING",
        "Of a run of it: MCAP, rosbag2 or a bag of ROS 1; or a folder with PNG files and `frames.csv`.",
        values.path,
        kw_only=False,
    )
    threshold: float = option(
        "--threshold",
        "Least share of predicted detections that must have come true; 97% by default.",
        values.quantity("SHARE", 0.0, 1.0, "0% to 100%", "PERCENT"),
        default=0.97,
        kw_only=False,
    )
    topics: Mapping[str, str] | None = optional(
        "--topic CAMERA=TOPIC", "Images of a camera whose name is not in its topic's; repeatable.", values.topics
    )
    progress: Progress = PROGRESS


class CalibrateRequest(Request):
    """Learn from labelled frames how likely each detector sees.

    Prints how well its curve, and its limits, agree with frames that the curve was not learned from.
    """

    frames: AnyPath = argument(
        "FRAMES",
        "What `sqrp run --frames` kept, a recording, or PNG files and `labels.csv`.",
        values.path,
        kw_only=False,
    )
    workspace: AnyPath = optional("--workspace WORKSPACE", "The cell that `labels.csv` is about.", values.path)
    program: AnyPath = optional("--program FILE", "The program that was run, if it is not in FRAMES.", values.path)
    progress: Progress = PROGRESS


# A new workspace, and questions about one as it stands.


class InitRequest(Request):
    """Make a new workspace with its skill.

    Guesses about your arm are marked `check:` in the file. Nothing is ever overwritten. Exit code 1 if the arm can pick
    up nothing anywhere, or the first run stops.
    """

    asked_by = "new_cell"

    folder: AnyPath = argument("DIR", "The new folder; it must not exist or be empty.", values.path, kw_only=False)
    arguments: Mapping[str, str] | None = argument(
        "NAME:=VALUE", "Arguments of a xacro, such as ur_type:=ur5e.", values.xacro, default=None, kw_only=True
    )
    robot: str | None = optional(
        "--robot NAME",
        "Your arm by its name, such as ur5e, panda or so101; an unknown name lists what is installed.",
        values.text("the name of a robot"),
    )
    urdf: AnyPath = optional(
        "--urdf FILE", "Your arm, URDF or xacro; without it, one of the program's own.", values.urdf
    )
    mjcf: AnyPath = optional("--mjcf FILE", "Your arm as MuJoCo has it.", values.urdf)
    gripper: str | None = optional(
        "--gripper NAME|FILE",
        "Such as robotiq_2f_85, or its URDF; without it, the hand in the arm's URDF or a suction cup.",
        values.text("the name or the URDF of a gripper"),
    )
    moveit: AnyPath = optional(
        "--moveit DIR", "Its configuration of MoveIt; one beside the URDF is found.", values.path
    )
    recording: AnyPath = optional(
        "--recording FILE",
        "Somebody's motion: a LeRobot dataset, a bag, CSV and the like; its episodes are then the task.",
        values.path,
    )
    package_roots: Sequence[AnyPath] = option(
        "--package-root DIR", "Where packages are looked up; may be repeated.", values.paths, default=()
    )
    tip: str | None = optional(
        "--tip LINK", "The link at the end of the arm, of a robot with several arms.", values.text("the name of a link")
    )
    run: bool = option(
        "--run/--no-run",
        "Run its task once in the simulated cell, if there is one; may take minutes; by default it does.",
        values.flag,
        default=False,
        absent=lambda: True,
    )
    progress: Progress = PROGRESS

"""Runs as Python has them: the document with all that happened, and what a run writes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask import values
from sqrp_cli.document import live
from sqrp_cli.errors import bad_option
from sqrp_cli.records import dataclass
from sqrp_cli.run.record.report import RunReport

if TYPE_CHECKING:
    from sqrp_cli.ask.requests import RunRequest
    from sqrp_cli.run.record.events import Event
    from sqrp_cli.show.pages.run_page import RunCell


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

    @property
    def is_recording(self) -> bool:
        """Whether the film's name is that of a recording for ROS tools."""
        from sqrp_cli.ros.bag import SUFFIXES

        return self.film is not None and self.film.suffix.lower() in SUFFIXES

    def check_names(self) -> None:
        """Raises InputError for a name that no film can have, and where two outputs have the same.

        Films are recordings, or MP4 files by a library that writes only to names of UTF-8 text.
        """
        from sqrp_cli.platform.files import check_distinct

        if self.film is not None and not self.is_recording:
            found = f"{self.options.get('film', 'film')} is `{self.film}`"
            if self.film.suffix.lower() != ".mp4":
                expected = "expected a name that ends in .mp4 (film), .mcap (recording) or .bag (recording of ROS 1)"
                raise bad_option(f"{found}; {expected}")
            if str(self.film) != str(self.film).encode(errors="ignore").decode():
                raise bad_option(f"{found}, which is not UTF-8 text; films are written by a library that needs it")
        check_distinct(self.named)

    def check_not_read(self, inputs: Iterable[Path]) -> None:
        """Raises InputError where an output file is also an input file; a folder of frames is new or empty."""
        from sqrp_cli.platform.files import check_not_read

        check_not_read([self.film, self.log, self.page], inputs)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SimulatedRun(RunReport):
    """How a run of a program went.

    events: what happened, in order. never_happened: faults that did not. inputs: the files that it was read from, over
    which no page is written. outputs: what it was kept in.
    """

    cell: RunCell = live()
    events: Sequence[Event] = live()
    never_happened: Sequence[str] = live()
    inputs: Sequence[Path] = live()
    outputs: RunOutputs = live()

    def write_page(self, path: str | Path, arguments: Sequence[str] = ()) -> None:
        """Write a page that plays the run; arguments: of the command that it names.

        Raises InputError if it cannot be written, or would replace a file that the run read or wrote.
        """
        from sqrp_cli.show.pages.run_page import write_run

        file = values.path.read(path, "path")
        values.texts("the words of a command, in a list").read(arguments, "arguments")
        outputs = replace(self.outputs, page=file)
        outputs.check_names()
        outputs.check_not_read(self.inputs)
        write_run(self.cell, self, self.events, file, arguments)

"""Where a task starts: in the world of a workspace, or in the one that a program leaves behind."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from sqrp_cli.errors import bad_option


class Start(NamedTuple):
    """Where a task starts."""

    workspace: Path
    after: Path | None
    """The program after which it starts; None: in the world of the workspace."""

    @classmethod
    def of(cls, named: Path, after: Path | None, written: Path | None = None) -> Start:
        """The start that a command line names: a workspace, or a program in place of its workspace and of `--after`.

        written: the program to which steps are appended; that implies to start after it. Raises InputError.
        """
        from sqrp_cli.program.file import find_workspace, is_program, load_program

        if not is_program(named):
            return cls(named, after)
        if after is not None:
            message = f"{named} is a program, so the task starts after it and not after {after}"
            raise bad_option(message, mend="leave out --after, or name a workspace")
        same = written is not None and written.exists() and written.samefile(named)
        return cls(find_workspace(load_program(named), named), None if same else named)

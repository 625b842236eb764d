"""`sqrp audit`: a recording against what a program predicts."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

from sqrp_cli.ask import requests
from sqrp_cli.ask.api.program import audited, cameras_patch
from sqrp_cli.ask.request import option
from sqrp_cli.ask.values import PATH
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import Patches, answer, program_with_warnings
from sqrp_cli.errors import ExitCode, Place, bad_option

NAME = "audit"

PATCHES = Patches("# Cameras as `sqrp audit` found them", "of `sqrp audit`")


class AuditCommand(requests.AuditRequest, requests.Printed, requests.OnProgram):
    """Compare recorded camera images with what a program predicts.

    Shows which cameras have moved, which clocks are wrong, and how often each camera showed each literal when it was
    predicted to.
    """

    patch: Path | None = option(
        "--patch", "Write where cameras that have moved are, as a patch.", PATH, default=None, metavar="FILE"
    )


def audit(_context: Any, ask: AuditCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Compare, write the patch, and print."""
    from sqrp_cli.files.yaml_edit import to_apply
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.ros.bag import is_bag
    from sqrp_cli.run.cell.requirements import check_packages
    from sqrp_cli.show.terminal.console import note, progress

    if is_bag(ask.program):
        mend = shlex.join(["sqrp", "audit", str(ask.recording), str(ask.program)])
        raise bad_option("this is a recording; expected a program here", Place(ask.program), mend=mend)
    check_packages()
    opened = program_with_warnings(ask.program)
    if ask.patch is not None:
        PATCHES.check(ask.patch)
        check_not_read([ask.patch], opened.files)
    found = audited(opened, ask.but(progress=progress))
    answer(replace(found, written=ask.patch is not None), as_json=ask.json)
    if ask.patch is not None:
        if patch := cameras_patch(opened.workspace, found.cameras):
            PATCHES.write(ask.patch, patch)
            note(f"to have the poses: {to_apply(ask.patch, opened.workspace.whole_file.file)}")
        else:
            note(f"of no camera is it known that it has moved, so {ask.patch} is not written")
    return ExitCode.OK if found.passed else ExitCode.NONE_FEASIBLE


command = command_of(AuditCommand, audit)

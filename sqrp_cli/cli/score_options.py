"""Options of `sqrp score`, some of which `sqrp diff` shares."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DEFAULT_ALLOWANCE = 0.5
"""What may get worse without being a regression: points of Q, percent of times."""

Paths = Annotated[
    list[str],
    typer.Argument(metavar="PATH...", help="Workspaces, folders of workspaces, or patterns such as 'cells/*'."),
]
Baseline = Annotated[
    Path | None, typer.Option("--baseline", metavar="FILE", help="Fail where something is worse than in this file.")
]
SaveBaseline = Annotated[
    Path | None, typer.Option("--save-baseline", metavar="FILE", help="Write the scores, to compare later ones with.")
]
Allow = Annotated[
    float,
    typer.Option("--allow", metavar="POINTS", min=0.0, help="What may get worse: points of Q, percent of times."),
]
Junit = Annotated[Path | None, typer.Option("--junit", metavar="FILE", help="Write a JUnit file for a CI server.")]
Summary = Annotated[Path | None, typer.Option("--summary", metavar="FILE", help="Write a Markdown summary.")]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Keep results here as they finish; those there are used.")
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Say that --out is that of an interrupted run, to go on with it.")
]
Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster", metavar="ADDRESS", help="Compute on this Dask cluster: tcp://HOST:PORT or scheduler file."
    ),
]
Vary = Annotated[
    list[str] | None,
    typer.Option("--vary", metavar="PATH=FROM:TO:N", help="Score variants of a workspace, and name the best."),
]
Draws = Annotated[
    int | None, typer.Option("--draws", min=1, max=10_000, help="With --vary: so many at random, not a grid.")
]
Patch = Annotated[
    Path | None,
    typer.Option(
        "--patch", metavar="FILE", help="With --vary: where the best variant goes; NAME-best.patch by default."
    ),
]


def tell(text: str) -> None:
    """A line about what a run waits for; loads what it is printed with when there is one."""
    from sqrp_cli.terminal.console import note

    note(text)

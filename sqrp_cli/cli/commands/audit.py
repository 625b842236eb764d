"""`sqrp audit`: a recording against what a program predicts."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from sqrp_cli.cli.options import Json, Patches, ProgramPath, answer, program_with_warnings, read_share
from sqrp_cli.errors import ExitCode, Place, bad_option

NAME = "audit"

PATCHES = Patches("# Cameras as `sqrp audit` found them", "of `sqrp audit`")


def command(
    program: ProgramPath,
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            help="Of a run of it: MCAP, rosbag2 or a bag of ROS 1; or a folder with PNG files and `frames.csv`.",
        ),
    ],
    threshold: Annotated[
        str,
        typer.Option(
            "--threshold", metavar="PERCENT", help="Least share of predicted detections that must have come true."
        ),
    ] = "97%",
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic", metavar="CAMERA=TOPIC", help="Images of a camera whose name is not in its topic's; repeatable."
        ),
    ] = None,
    patch: Annotated[
        Path | None,
        typer.Option("--patch", metavar="FILE", help="Write where cameras that have moved are, as a patch."),
    ] = None,
    as_json: Json = False,
) -> ExitCode:
    """Compare recorded camera images with what a program predicts.

    Shows which cameras have moved, which clocks are wrong, and how often each camera showed each literal when it was
    predicted to.
    """
    from sqrp_cli.knowledge.text.yaml_edit import to_apply
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.ros.bag import is_bag
    from sqrp_cli.runtime.cell.requirements import check_packages
    from sqrp_cli.terminal.console import note, progress

    share = read_share(threshold, "--threshold", 0.0)
    topics = _topics(topic or [])
    if is_bag(program):
        mend = shlex.join(["sqrp", "audit", str(recording), str(program)])
        raise bad_option("this is a recording; expected a program here", Place(program), mend=mend)
    check_packages()
    opened = program_with_warnings(program)
    if patch is not None:
        PATCHES.check(patch)
        check_not_read([patch], opened.files)
    audit = opened.audit(recording, share, topics=topics, progress=progress)
    answer(replace(audit, written=patch is not None), as_json=as_json)
    if patch is not None:
        if audit.patch:
            PATCHES.write(patch, audit.patch)
            note(f"to have the poses: {to_apply(patch, opened.workspace.whole_file.file)}")
        else:
            note(f"of no camera is it known that it has moved, so {patch} is not written")
    return ExitCode.OK if audit.passed else ExitCode.NONE_FEASIBLE


def _topics(texts: list[str]) -> dict[str, str]:
    """Topics by camera. Raises InputError for a text that is no pair, and for two topics of a camera."""
    pairs: dict[str, str] = {}
    for text in texts:
        camera, equals, topic = text.partition("=")
        if not (camera and equals and topic):
            raise bad_option(f"--topic is `{text}`, expected CAMERA=TOPIC such as cam1=/left/image_raw/compressed")
        if pairs.get(camera, topic) != topic:
            raise bad_option(f"--topic names both {pairs[camera]} and {topic} for {camera}")
        pairs[camera] = topic
    return pairs

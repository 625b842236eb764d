"""Saved results: each is read as the typed document that its command made, and shows itself as the terminal did."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from sqrp_cli.ask import values
from sqrp_cli.document import Document
from sqrp_cli.errors import Place, bad_input
from sqrp_cli.show.documents import KINDS, record_of

LARGEST = 1 << 30  # most bytes of a file with a result


def is_result(path: Path) -> bool:
    """Whether a file is JSON that begins as a result of `--json` or a baseline does, or is called so: no workspace."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        begins = re.match(rb'\s*\{\s*("(schema|format)"\s*:|\})', file.read(1000)) is not None
    return begins or path.suffix == ".json"


def read_result(path: str | Path) -> Document:
    """A result that a command wrote with `--json`: its record, which `show` prints as the command did.

    Raises InputError for a file that is none, or of which no version of this program can make a record.
    """
    from pydantic import ValidationError

    from sqrp_cli.files.input_file import read_text
    from sqrp_cli.files.json_file import json_name, parse_json

    file = values.path.read(path, "path")
    text = read_text(file, LARGEST)
    data = parse_json(file, text)
    kind = data.get("document") if isinstance(data, dict) else None
    again = "run its command again, with --json"
    if isinstance(data, dict) and "workspaces" in data:
        message = "this is a baseline of `sqrp score`, which has no table of its own"
        mend = f"sqrp score WORKSPACE --baseline {shlex.quote(str(path))}"
        raise bad_input("no-result", message, Place(file), mend=mend)
    if not isinstance(kind, str) or kind not in KINDS:
        told = "does not say which command wrote it" if kind is None else f"is of `{kind}`"
        message = f"this {told}, so no table can be drawn from it; expected the JSON of {', '.join(KINDS)}"
        raise bad_input("no-result", message, Place(file), mend=again)
    record = record_of(kind)
    try:
        found = record.read(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = json_name(tuple(part for part in first["loc"] if isinstance(part, int) or part.isidentifier()))
        message = f"this is no result of `sqrp {kind}` of this version: {where}: {first['msg'].lower()}"
        raise bad_input("no-result", message, Place(file), mend=again) from None
    return found

"""What changed in a workspace since its baseline: which files, and which fields in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from sqrp_cli.knowledge.text.source import LeafValue
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.scoring.baselines.baseline import WorkspaceRecord
from sqrp_cli.scoring.baselines.source_fields import WORKSPACE, changed_fields, fields_of
from sqrp_cli.scoring.work.identity import says_something


@dataclass(frozen=True)
class Change:
    """A difference between two versions of a workspace.

    file: the role of the file that changed, such as `workspace`, `robot.urdf` or `skills.pickup.yaml`. field: where in
    it; None where only the content as a whole can be compared. before, now: the values; for a file as a whole the first
    digits of its digest. None where there is no such field or file.
    """

    file: str
    field: str | None
    before: LeafValue
    now: LeafValue

    def __str__(self) -> str:
        what = "content" if self.field is None else self.field
        where = what if self.file == WORKSPACE else f"{self.file} {what}"
        if self.before is None:
            return f"{where} = {self.now} is new"
        if self.now is None:
            return f"{where} = {self.before} is gone"
        return f"{where}: {self.before} -> {self.now}"


def workspace_changes(
    before: WorkspaceRecord, known: Mapping[str, Mapping[str, LeafValue]], now: Workspace
) -> tuple[Change, ...]:
    """The differences that may matter, so not those of comments and layout; known: fields of files by digest.

    The tasks of a workspace and what is expected of them are not compared.
    """
    return tuple(_changes(before, known, now))


def _changes(before: WorkspaceRecord, known: Mapping[str, Mapping[str, LeafValue]], now: Workspace) -> Iterator[Change]:
    digests = {role: file.digest for role, file in now.files.items()}
    for role in sorted({*before.files, *digests}, key=lambda role: (role != WORKSPACE, role)):
        old, new = before.files.get(role), digests.get(role)
        if old == new:
            continue
        fields = fields_of(now, role) if new is not None else {}
        if old is None or new is None or not (known.get(old) and fields):
            yield Change(role, None, old and old[:12], new and new[:12])
            continue
        for field, value, value_now in changed_fields(known[old], fields):
            if role != WORKSPACE or says_something(field):
                yield Change(role, field, value, value_now)

"""The workspace file as it is being edited, beside the file as it is saved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.text.yaml_edit import with_values
from sqrp_cli.knowledge.workspace.workspace_file import read_workspace_document

MOST_CHANGES, MOST_KEPT = 500, 50_000_000
"""How many changes can be taken back, and how long their texts may be together [bytes]; the oldest go first."""


@dataclass(frozen=True, kw_only=True)
class DraftChange:
    """One step of editing."""

    label: str
    """What it does, in words."""
    values: Mapping[str, str] | None
    """What it sets, by dotted path, as YAML text; None where it does more than that."""
    content: bytes
    """The file with it."""


@dataclass(frozen=True, kw_only=True)
class Draft:
    """The text of a workspace file, with what led to it."""

    path: Path
    """Of the file."""
    saved: bytes
    """The file on the disk."""
    first: bytes
    """The text before the changes that can be taken back."""
    past: tuple[DraftChange, ...] = ()
    """The changes that hold, in order."""
    future: tuple[DraftChange, ...] = ()
    """Those that were undone, the next to redo first."""

    @property
    def content(self) -> bytes:
        """The text now."""
        return self.past[-1].content if self.past else self.first

    @property
    def dirty(self) -> bool:
        """Whether the text is not as it is saved."""
        return self.content != self.saved

    def changed(self, change: DraftChange) -> Draft:
        """With one more change."""
        past, first = (*self.past, change), self.first
        while len(past) > MOST_CHANGES or (len(past) > 1 and sum(len(one.content) for one in past) > MOST_KEPT):
            first, past = past[0].content, past[1:]
        return replace(self, first=first, past=past, future=())

    def undone(self) -> Draft:
        """Without the last change, if there is one."""
        return replace(self, past=self.past[:-1], future=(*self.past[-1:], *self.future))

    def redone(self) -> Draft:
        """With the change that was undone last, if there is one."""
        return replace(self, past=(*self.past, *self.future[:1]), future=self.future[1:])

    def on(self, saved: bytes) -> tuple[Draft, tuple[DraftChange, ...]]:
        """The draft on a file that was changed elsewhere, and the changes that do not fit it any more."""
        unsaved = self.past if self.dirty else ()
        draft, lost = Draft(path=self.path, saved=saved, first=saved), list[DraftChange]()
        for change in unsaved:
            try:
                document = read_workspace_document(self.path, draft.content)
                if change.values is None:
                    raise InputError
                draft = draft.changed(replace(change, content=with_values(document, change.values)))
            except InputError:
                lost.append(change)
        return draft, tuple(lost)

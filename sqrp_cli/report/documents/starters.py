"""`init`: a new workspace."""

from __future__ import annotations

from dataclasses import dataclass

from sqrp_cli.report.documents.document import Document


@dataclass(frozen=True, kw_only=True)
class InitDocument(Document):
    """What `sqrp init` has made."""

    workspace: str
    """Its folder."""
    tool_link: str
    """The link of the robot that carries the tool, or grasps itself."""
    objects: list[str]
    task: str | None
    """A task that can be ranked at once."""

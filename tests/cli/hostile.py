"""Names and texts as somebody might write them who wants more of a terminal, a log or a page than to be shown there."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

EVIL = (
    "\x1b[31mred\x1b]0;title\x07\r\x9b2J\u202etxt\u2066\u200b\ufeff\x00\x7f\n::error::evil\n  ::stop-commands::evil"
    "\u2028##[error]evil\x85##vso[task.complete result=Failed]evil\n#<b>evil</b>|`x`| [evil](https://evil.test) \ud800"
)
"""Everything at once: escape sequences, line breaks, bidirectional marks, commands to CI servers, Markdown, HTML."""


def is_harmless(text: str) -> bool:
    """Whether a text is lines that only show something, none of which a CI server obeys."""
    lines = text.split("\n")
    commands = any(line.lstrip().startswith("::") or "##[" in line or "##vso[" in line for line in lines)
    return not commands and all(line.isprintable() for line in lines)


IN_PATH = "".join(character for character in EVIL if character not in "/\0\ud800")
"""As far as the name of a file may have it."""

IN_XML = "".join(character for character in EVIL if character == "\n" or " " <= character != "\ud800").strip()
"""As far as XML may have it."""

WORD = "".join(character for character in EVIL if not character.isspace() and character not in "=\ud800")
"""As far as a word of a task may have it."""

TASK = f"watch\n\u2028green{WORD}"
"""A task for one object of the hostile cell."""


def hostile_cell(watch: Path, folder: Path) -> Path:
    """A copy of the hand-worked cell with all that its files may name freely: task, colour, links, joints and paths."""
    cell = folder / f"{IN_PATH[:60]}cell"
    cell.mkdir(parents=True)
    in_path = f"skill{IN_PATH}"
    shutil.copytree(watch / "watch", cell / in_path / "watch")
    escaped = "".join(f"&#{ord(character)};" for character in IN_XML)
    urdf = (watch / "arm.urdf").read_text(encoding="utf-8")
    for name in ("turn", "tip", "post", "arm"):
        urdf = urdf.replace(f'"{name}"', f'"{name}{escaped}"')
    (cell / f"arm{in_path}.urdf").write_text(urdf, encoding="utf-8")
    text = (watch / "workspace.yaml").read_text(encoding="utf-8")
    for old, new in (
        ("urdf: arm.urdf", f"urdf: {json.dumps(f'arm{in_path}.urdf')}"),
        ("tool_frame: tip", f"tool_frame: {json.dumps(f'tip{IN_XML}')}"),
        ("{turn: 0.5", f"{{{json.dumps(f'turn{IN_XML}')}: 0.5"),
        ("skills: [watch]", f"skills: [{json.dumps(f'{in_path}/watch')}]"),
        ("turned: {type: cube, color: green", f"turned: {{type: cube, color: {json.dumps(f'green{WORD}')}"),
        ("task: watch green,", f"task: {json.dumps(TASK)},"),
    ):
        assert old in text
        text = text.replace(old, new)
    (cell / "workspace.yaml").write_text(text, encoding="utf-8")
    return cell

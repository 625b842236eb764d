"""The pages of the documentation that are generated from the code: commands, keys of files, findings.

A hook of MkDocs, which calls `on_files` before it builds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import Any

import typer.main
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from sqrp_cli.camera.calibration_formats import FORMATS
from sqrp_cli.checks.registry import RuleEntry, rules
from sqrp_cli.cli.app import app
from sqrp_cli.files.usual_values import CALIBRATION, HAND_EYE, SKILL, WORKSPACE, Usual
from sqrp_cli.show.documents.schemas import schema_of

Schema = Mapping[str, Any]
"""A JSON Schema, or a part of one."""

WHOLE_FILE = "The file"
"""Title of the keys at the top of a file."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are generated from the code."""
    pages = {
        "reference/commands.md": commands_page(),
        "reference/findings.md": findings_page(),
        "reference/workspace.md": keys_page("workspace", "Keys of `workspace.yaml`"),
        "reference/skill.md": keys_page("skill", "Keys of `skill.yaml`"),
        "reference/mounts.md": keys_page("mounts", "Keys of `place.yaml`"),
        "reference/robot.md": keys_page("robot", "Keys of `robot.yaml`"),
        "reference/usual-values.md": usual_values_page(),
        "reference/calibration-formats.md": formats_page(),
    }
    for path, text in pages.items():
        if (stands_in := files.get_file_from_path(path)) is not None:  # says how to make the page
            files.remove(stands_in)
        files.append(File.generated(config, path, content=text))
    return files


def commands_page() -> str:
    """Every command with its arguments and options, as `--help` has them."""
    parts = ["# Commands", "", "As `sqrp COMMAND --help` prints them.", ""]
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined] # it is a group
        parts += _command(name, command)
    return "\n".join(parts) + "\n"


def _command(name: str, command: Any) -> Iterator[str]:  # noqa: ANN401 # typer's own kind of command
    context = command.make_context(f"sqrp {name}", [], resilient_parsing=True)
    yield f"## sqrp {name}"
    yield ""
    yield f"```text\n{command.get_usage(context).removeprefix('Usage: ')}\n```"
    yield ""
    yield " ".join((command.help or "").split())
    yield ""
    yield "| argument or option | meaning |"
    yield "|---|---|"
    for parameter in command.get_params(context):
        names, meaning = parameter.get_help_record(context)
        yield f"| `{_cell(names)}` | {_cell(meaning)} |"
    yield ""


def findings_page() -> str:
    """Every finding with its examples, subject after subject."""
    parts = [
        "# Findings",
        "",
        "What can be wrong with the input, as `sqrp rules` lists it. Errors must be fixed;",
        "",
    ]
    parts[2] += " warnings are doubts. `sqrp check --json` has the codes in `problems[].code`."
    for subject, group in groupby(rules().values(), key=lambda rule: rule.subject):
        parts += [f"## {subject}", ""]
        for rule in group:
            parts += _finding(rule)
    return "\n".join(parts) + "\n"


def _finding(rule: RuleEntry) -> Iterator[str]:
    yield f"### {rule.code}"
    yield ""
    yield f"*{' or '.join(rule.severity).capitalize()}.* {_prose(rule.meaning)} {_prose(rule.why)}"
    yield ""
    of = f" in {rule.file}" if rule.file else ""
    yield f"```text\npasses{of}:\n{_indented(rule.passes)}\nfails{of}:\n{_indented(rule.fails)}\n```"
    yield ""


def _indented(example: str) -> str:
    return "\n".join(f"  {line}" for line in example.splitlines())


def _prose(sentence: str) -> str:
    """A sentence in which angle brackets are no HTML."""
    return sentence.replace("<", "&lt;")


def keys_page(name: str, title: str) -> str:
    """Every key of a file: its type, default and meaning."""
    schema = schema_of(name)
    parts = [f"# {title}", "", f"As `sqrp schema {name}` describes them. A key without a default is required.", ""]
    parts += _table(WHOLE_FILE, schema)
    for entry, definition in schema["$defs"].items():
        if "properties" in definition:
            parts += _table(_words(entry), definition)
    return "\n".join(parts) + "\n"


USUAL: Mapping[str, tuple[Usual, ...]] = {
    "workspace.yaml": WORKSPACE,
    "skill.yaml": SKILL,
    "camera calibration": CALIBRATION,
    "hand-eye file": HAND_EYE,
}
"""Usual values by the file that they are about."""


def usual_values_page() -> str:
    """Usual ranges of numbers; others get a warning."""
    parts = ["# Usual values", ""]
    parts += ["A number outside these ranges gets a warning (`unusual-value`), and is used as it is.", ""]
    parts += ["The first matching row counts. `*` is any name or index, `{fixed}` means fixed objects only.", ""]
    for file, rows in USUAL.items():
        parts += [f"## {file}", "", "| field | usual | because otherwise |", "|---|---|---|"]
        parts += [f"| `{row.at}` | {row} | {_cell(row.why)} |" for row in rows] + [""]
    return "\n".join(parts) + "\n"


def formats_page() -> str:
    """The formats of calibration files, as their readers describe them."""
    parts = ["# Formats of calibration files, one by one", "", "See [calibration files](calibrations.md).", ""]
    parts += ["| format | written by | what gives it away | not read |", "|---|---|---|---|"]
    return "\n".join([*parts, *(f"| {row} |" for one in FORMATS.values() for row in one["files"])]) + "\n"


def _table(title: str, schema: Schema) -> Iterator[str]:
    yield f"## {title}"
    yield ""
    yield schema.get("description", "").partition("\n\n")[0].replace("\n", " ")
    yield ""
    yield "| key | type | default | meaning |"
    yield "|---|---|---|---|"
    required = schema.get("required", ())
    for key, value in schema["properties"].items():
        default = "required" if key in required else _default(value.get("default"))
        yield f"| `{key}` | {_cell(_kind(value))} | {default} | {_cell(value.get('description', ''))} |"
    yield ""


def _kind(schema: Schema) -> str:
    """What a value may be, in words."""
    if "$ref" in schema:
        entry = schema["$ref"].rpartition("/")[2]
        return f"[{_words(entry)}](#{_anchor(entry)})"
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    for key in ("anyOf", "oneOf"):
        if key in schema:
            kinds = [_kind(part) for part in schema[key] if part.get("type") != "null"]
            return "number or text with a unit" if kinds == ["number", "text"] else " or ".join(dict.fromkeys(kinds))
    if schema.get("type") == "array":
        items = schema.get("items") or (schema.get("prefixItems") or [{}])[0]
        count = schema.get("maxItems") if schema.get("maxItems") == schema.get("minItems") else None
        return f"list of {f'{count} ' if count else ''}{_plural(_kind(items))}"
    if schema.get("type") == "object":
        named = next(iter(schema.get("patternProperties", {}).values()), schema.get("additionalProperties"))
        return f"names with {_kind(named)} each" if isinstance(named, dict) else "keys and values"
    names = {"string": "text", "boolean": "true or false", "integer": "whole number"}
    kinds = schema.get("type", "anything")
    return " or ".join(names.get(kind, kind) for kind in (kinds if isinstance(kinds, list) else [kinds]))


def _plural(kind: str) -> str:
    return {"text": "texts", "number": "numbers", "number or text with a unit": "numbers"}.get(kind, kind)


def _default(value: object) -> str:
    if value is None or value in ({}, []):
        return "none"
    if isinstance(value, dict):
        stated = {key: part for key, part in value.items() if part is not None}
        return f"`{_yaml(stated)}`" if stated else "none"
    return f"`{_yaml(value)}`"


def _yaml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_yaml(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_yaml, value)) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _words(entry: str) -> str:
    """The title of an entry: `JointMoveEntry` is *Joint move*."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", entry.removesuffix("Entry").removesuffix("Spec")).capitalize()


def _anchor(entry: str) -> str:
    return _words(entry).lower().replace(" ", "-")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")

"""The process in which the library `xacro` expands one file: it is limited, and reaches nothing but the description.

Expressions are evaluated by `xacro_expression`. Files must lie in the folder of the file, in its package or in a folder
of packages, links followed. Nothing comes from the environment. An audit hook refuses whatever else this process might
do to the machine.
"""

from __future__ import annotations

import errno
import json
import os
import re
import resource
import sys
from collections.abc import Callable
from dataclasses import asdict, field, replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.dom import expatbuilder, minidom

import xacro
import yaml
from xacro import substitution_args

from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.files import packages
from sqrp_cli.files.input_file import decoded, missing_file, read_input
from sqrp_cli.files.xml_file import MAX_BYTES, parse_xml
from sqrp_cli.records import dataclass
from sqrp_cli.robot.xacro_expression import UNOFFERED, evaluate

MAX_EXPANDED = 50_000  # most elements that are looked at while a file is expanded
MAX_RESULT = 20_000_000  # most characters of what a file stands for
_PLACE = "place"  # key under which a node of the document knows where it was written
_HOW_TO_GIVE = "say `args: {{{0}: VALUE}}` beside `xacro:`, or `{0}:=VALUE` after `init`"

_HARMLESS = ("compile", "exec", "import", "glob.", "os.listdir", "os.scandir", "object.", "sys._getframe",
             "builtins.id", "code.", "marshal.", "sys.excepthook")  # fmt: skip
"""Beginnings of the names of audit events that may happen, files that are opened for reading apart."""


class _PlacedBuilder(expatbuilder.ExpatBuilderNS):
    """Builds a document whose elements, and copies of them, know where they were written."""

    path: Path  # of the file that is read

    def handle(self, _operation: int, key: str, place: Place, _node: minidom.Node, copy: minidom.Node | None) -> None:
        """Copies the place of a node to a copy of it."""
        if copy is not None:
            copy.setUserData(key, place, self)

    def start_element_handler(self, name: str, attributes: list[str]) -> None:
        super().start_element_handler(name, attributes)
        parser = self.getParser()
        place = Place(self.path, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)
        self.curNode.setUserData(_PLACE, place, self)


@dataclass(eq=False)
class _Expansion:
    """One file's expansion: the parts of the library that reach outside are replaced by methods of this."""

    path: Path
    arguments: dict[str, str]
    roots: list[Path]
    search: list[Path]
    at: Place  # Of what is being expanded
    packages: dict[str, Path] = field(default_factory=dict)
    asked: dict[str, str | None] = field(default_factory=dict)
    warnings: list[Problem] = field(default_factory=list)
    written: dict[str, Place] = field(default_factory=dict)
    """Where the value of a property is written; it is evaluated where it is first used."""
    elements: int = 0

    def run(self) -> minidom.Element | None:
        """The document. Raises InputError, or what the library raises."""

        def noted(function: Callable[..., Any], node: Any, *rest: Any) -> Any:  # noqa: ANN401
            """A function of the library that first notes the place of its node."""
            self.at = node.getUserData(_PLACE) or self.at
            self.elements += function.__name__ == "eval_all"
            if self.elements > MAX_EXPANDED:
                message = f"the file expands to more than {MAX_EXPANDED:,} elements"
                raise bad_input("too-many-elements", message, self.at)
            return function(node, *rest)

        for name in ("eval_all", "handle_macro_call", "check_attrs", "reqd_attrs"):
            setattr(xacro, name, partial(noted, getattr(xacro, name)))

        def warning(*what: object, **_how: object) -> str:
            text = "the file warns: " + " ".join(map(str, what))[:300]
            self.warnings.append(Problem("xacro-warning", text, self.at, severity="warning"))
            return ""

        xacro.warning = xacro.message = xacro.print_location = lambda *_, **__: ""  # of the library itself
        xacro.parse, xacro.abs_filename_spec, xacro.safe_eval = self._parsed, self._absolute, evaluate
        symbols = xacro.create_global_symbols()
        symbols["xacro"].update(warning=warning, error=warning, message=xacro.message, print_location=xacro.message)
        symbols["xacro"]["arg"] = self._argument
        for name in UNOFFERED:
            symbols["python"].pop(name, None)
        xacro._global_symbols = symbols
        substitution_args._eval_find, substitution_args._eval_env = self._find, self._environment
        substitution_args._eval_optenv = self._environment
        substitution_args._eval_arg = self._argument

        dirname = substitution_args._eval_dirname = lambda *_: str(Path(xacro.filestack[-1]).parent)

        def evaluated(text: str, context: dict[str, Any]) -> str:
            """`$(eval ...)`: arguments are names, too."""
            convert = substitution_args.convert_value
            names = {**xacro._global_symbols, "true": True, "false": False}
            names.update({name: convert(value, "auto") for name, value in context["arg"].items()})
            names.update(arg=lambda name: convert(self._argument(name), "auto"), find=self._find,
                         dirname=dirname)  # fmt: skip
            return str(evaluate(text, names))

        substitution_args._eval = evaluated
        xacro.init_stacks(str(self.path))
        document = self._parsed(None, str(self.path))
        xacro.process_doc(document, mappings=dict(self.arguments), verbosity=0)
        return document.documentElement

    def _argument(self, name: str, args: object = None) -> str:  # noqa: ARG002 - the library hands it on
        self.asked.setdefault(name, None)
        values: dict[str, str] = xacro.substitution_args_context["arg"]
        if name not in values and name == "name":  # of the robot, which launch files state
            return self.path.name.split(".")[0]
        if name not in values:
            message = f"the argument `{name}` has no value"
            stated = re.compile(rf"""<xacro:arg\s[^>]*\bname\s*=\s*["']{re.escape(name)}["']""")
            found = stated.search(decoded(self.at.file, read_input(self.at.file, MAX_BYTES)))
            if found is not None:
                line = found.string.count("\n", 0, found.start()) + 1
                message += f" here: <xacro:arg> states it below, in line {line}, which xacro reads later"
            raise bad_input("xacro-argument", message, self.at, mend=_HOW_TO_GIVE.format(name))
        return values[name]

    def _environment(self, name: str, default: str | None = None) -> str:
        """A variable of the environment: only if it is given as an argument, or its default."""
        self.asked.setdefault(name, default)
        if name not in self.arguments and default is None:
            message = f"the file asks for the environment variable `{name}`, which is never read"
            raise bad_input("xacro-argument", message, self.at, mend=_HOW_TO_GIVE.format(name))
        return self.arguments.get(name, default or "")

    def _find(self, package: str) -> str:
        folder = packages.package_folder(package, [*self.roots, *self.search], self.at)
        self.packages[package] = folder
        return str(folder)

    def _absolute(self, name: str) -> str:
        """The path of a file that is named in the one being read, if it may be read."""
        if not name:
            raise bad_input("xacro", "found no name of a file: an argument is empty", self.at)
        if name.startswith("package://"):
            package, rest = packages.package_and_path(name)
            path = str(Path(self._find(package)) / rest)
        else:
            path = os.path.normpath(Path(xacro.filestack[-1]).parent / name.removeprefix("file://"))
        if not self.may_read(path):
            real = os.path.realpath(path)
            message = f"`{path}` is outside the folders that this file may read: its own, its package and those of"
            message += " packages" + (f"; it is a link to `{real}`" if real != path else "")
            mend = f"add {Path(real).parent} to `robot.package_roots` or to ROS_PACKAGE_PATH (`init --package-root`)"
            raise bad_input("outside-roots", message, self.at, mend=mend)
        return path

    def may_read(self, path: str) -> bool:
        """Whether a file lies, its links followed, in a folder that may be read."""
        real = os.path.realpath(path)
        folders = map(os.path.realpath, (*self.roots, *self.packages.values()))
        return any(real == folder or real.startswith(folder.rstrip(os.sep) + os.sep) for folder in folders)

    def _parsed(self, _text: None, name: str) -> minidom.Document:
        path = Path(self._absolute(name))
        try:
            content = read_input(path, MAX_BYTES)
        except InputError as error:
            if error.problems[0].code != "missing-file":
                raise
            xacro.filestack.pop()
            raise xacro.XacroException(exc=FileNotFoundError(errno.ENOENT, "", name)) from error  # some are optional
        parse_xml(path, content, None)  # well-formed, of bounded size, without entities
        builder = _PlacedBuilder()
        builder.path = path
        document: minidom.Document = builder.parseString(content)
        for node in document.getElementsByTagName("property"):
            if node.parentNode is document.documentElement:  # as xacro before 2014 wrote it
                document.renameNode(node, "", "xacro:property")
        for node in document.getElementsByTagName("xacro:property"):
            self.written.setdefault(node.getAttribute("value"), node.getUserData(_PLACE) or Place(path))
        for node in document.getElementsByTagName("xacro:arg"):
            self.asked.setdefault(node.getAttribute("name"), node.getAttribute("default"))
        return document

    def problem(self, error: BaseException) -> Problem:
        """What went wrong, from the innermost of the library's nested errors."""
        expressions, nested = [""], error
        while True:
            if suffix := getattr(nested, "suffix", None):
                expressions.append(suffix.strip().removeprefix("when evaluating expression ").strip("'"))
            inner = getattr(nested, "exc", None)
            if not isinstance(inner, BaseException):
                break
            nested = inner
        if isinstance(nested, InputError):
            return nested.problems[0]
        if isinstance(nested, FileNotFoundError):
            missing = missing_file(Path(nested.filename))
            return replace(missing, message=f"{nested.filename}: {missing.message}", place=self.at)
        if isinstance(nested, yaml.YAMLError):
            mark = getattr(nested, "problem_mark", None)
            place = Place(Path(mark.name), mark.line + 1, mark.column + 1) if mark else self.at
            return Problem("yaml-syntax", f"not YAML: {getattr(nested, 'problem', nested)}"[:300], place)
        message, expression, at = str(nested) or type(nested).__name__, expressions[-1], self.at
        if len(expressions) > 2:  # of a property, asked for by the expression that stands here
            at = next((place for value, place in self.written.items() if expression in value), at)
        if isinstance(nested, RecursionError):
            message = "a macro or an expression leads back to itself"
        elif isinstance(nested, MemoryError):
            message = "it takes too much memory to expand this file"
        elif message.startswith("unknown macro name: "):
            name = message.removeprefix("unknown macro name: ")
            message = f"<{name}> is no known macro; is the file included that defines it?"
        elif expression and not isinstance(nested, xacro.XacroException):
            what = "" if isinstance(nested, ValueError) else f"{type(nested).__name__}: "
            message = f"{expression[:100]!r} cannot be evaluated: {what}{message}"
        called = [macro.body.getAttribute("name") for macro in xacro.macrostack or [] if macro.body is not None]
        return Problem("xacro", message[:600] + (f" (in macro `{called[-1]}`)" if called else ""), at)


def _tree(node: Any, place: Place) -> list[object]:  # noqa: ANN401
    """An element as it is handed on: tag, attributes, file, line, column, children."""
    place = node.getUserData(_PLACE) or place
    attributes = {name: value for name, value in node.attributes.items() if not name.startswith("xmlns")}
    children = [_tree(child, place) for child in node.childNodes if child.nodeType == 1]
    return [node.tagName, attributes, str(place.file), place.line, place.column, children]


def main() -> None:
    """Expand the file that standard input names; standard output tells what it stands for, or the problem."""
    asked = json.load(sys.stdin)
    for limit, most in (("CPU", asked["seconds"]), ("AS", asked["memory"]), ("NOFILE", 64), ("FSIZE", 0), ("CORE", 0)):
        resource.setrlimit(getattr(resource, f"RLIMIT_{limit}"), (most, most))
    path, search = Path(asked["path"]), [Path(folder) for folder in asked["search"]]
    package = packages.package_around(path)
    roots = [path.parent, *([package] if package else ()), *map(Path, asked["roots"])]
    expansion = _Expansion(path, asked["arguments"], roots, search, Place(path))
    library, manifests = os.path.dirname(os.__file__), tuple(str(folder) for folder in search)  # noqa: PTH120

    def refuse(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            name, flags = str(arguments[0]), arguments[2] or 0
            manifest = name.endswith(f"/{packages.MANIFEST}") and name.startswith(manifests)
            reading = not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            if isinstance(arguments[0], int):  # what is open already
                return
            if reading and (manifest or expansion.may_read(name) or name.startswith(library)):
                return
        elif event.startswith(_HARMLESS):
            return
        raise PermissionError(f"{event} is not allowed while a description is expanded")

    sys.addaudithook(refuse)
    found: dict[str, object] = {}
    try:
        found["root"] = _tree(expansion.run(), Place(path))
    except Exception as error:
        found["problem"] = asdict(expansion.problem(error))
    found["packages"], found["asked"] = list(expansion.packages), expansion.asked
    found["warnings"] = [asdict(warning) for warning in expansion.warnings[:20]]
    text = json.dumps(found, default=str)
    if len(text) > MAX_RESULT:
        problem = Problem("xacro", f"the file stands for more than {MAX_RESULT:,} characters", Place(path))
        text = json.dumps({"problem": asdict(problem)}, default=str)
    sys.stdout.write(text)

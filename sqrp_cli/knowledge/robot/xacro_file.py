"""Expanding xacro files by the library `xacro`, without its ways to reach anything but the description.

The library's own evaluation hands expressions to Python's `eval`, opens any file and reads the environment. Here
expressions are evaluated by `xacro_expression`; files that are included or loaded must lie in the folder of the file,
in its package or in a folder of packages; nothing comes from the environment. What a file makes of itself is bounded.
"""

from __future__ import annotations

import glob
import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.dom import expatbuilder, minidom

import yaml

from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names, needed
from sqrp_cli.knowledge.robot.robot_source import ROOT, RobotSource, RobotXml, as_text
from sqrp_cli.knowledge.robot.xacro_expression import (
    GLOBALS,
    UNITS,
    Evaluator,
    Functions,
    RefusedExpressionError,
    bounded,
    unit_loader,
)
from sqrp_cli.knowledge.text import packages
from sqrp_cli.knowledge.text.input_file import decoded, read_input
from sqrp_cli.knowledge.text.xml_file import MAX_BYTES, MAX_DEPTH, Element, parse_xml
from sqrp_cli.knowledge.text.yaml_file import read_yaml

MAX_FILES = 200
"""Most files that a description includes and loads, counted as often as it does."""

MAX_CALLS = 5000
"""Most macros that are expanded."""

MAX_EXPANDED = 50_000
"""Most elements that are looked at while a file is expanded."""

MAX_INCLUDES = 30
"""Deepest nesting of includes."""

_ENGINE = threading.Lock()
"""The library keeps its state in its module."""

_ACCEPTED = frozenset({"duplicate-key", "not-finite", "not-a-mapping"})
"""What xacro accepts in a YAML file and a workspace does not; vendors ship files with keys given twice."""

_PLACE = "place"
"""Key under which a node of the document knows where it was written."""


def expand(path: Path, content: bytes, source: RobotSource) -> RobotXml:
    """The `<robot>` that a xacro file stands for.

    Every element has the place where it is written, in this file or an included one. Raises InputError, with that
    place, for whatever prevents it: a wrong expression, an unknown macro or argument, a file that is missing or outside
    the known folders, too large a result. Also if the library is not installed.
    """
    with needed("this is a xacro file, which needs the extra `xacro`", "pip install 'sqrp[xacro]'", Place(path)):
        import xacro
    expansion = _Expansion(xacro, path, source)
    with _ENGINE, expansion.engine():
        root = expansion.run(content)
    text = as_text(root)
    return RobotXml(root, text, text.encode(), (*expansion.packages,), (*expansion.warnings,))


class _MissingError(OSError):
    """A file that cannot be included, as the library expects it: an `optional` include goes on."""

    def __init__(self, error: InputError) -> None:
        super().__init__(str(error))
        self.error = error


@dataclass(frozen=True)
class _Call:
    """A macro that is being expanded, and where it was called."""

    name: str
    place: Place


class _Carry:
    """Copies a node's place to its copies."""

    def handle(self, _operation: int, key: str, place: Place, _node: minidom.Node, copy: minidom.Node | None) -> None:
        if copy is not None:
            copy.setUserData(key, place, self)


class _PlacedBuilder(expatbuilder.ExpatBuilderNS):
    """Builds a document whose elements know where they were written."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self._carry = path, _Carry()

    def start_element_handler(self, name: str, attributes: list[str]) -> None:
        super().start_element_handler(name, attributes)
        parser = self.getParser()
        place = Place(self._path, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)
        self.curNode.setUserData(_PLACE, place, self._carry)


class _Expansion:
    """One file's expansion: stands in for the parts of the library that reach outside."""

    def __init__(self, xacro: Any, path: Path, source: RobotSource) -> None:  # noqa: ANN401 - it has no types
        self._xacro, self._path, self._source = xacro, path, source
        self._arguments = dict(source.arguments)
        self._asked: dict[str, str | None] = {}
        package = packages.package_around(path)
        self._folders = (path.parent, *([package] if package else ()))
        self.packages: dict[str, Path] = {}
        self._at = Place(path)
        self._calls: list[_Call] = []
        self._files = self._elements = self._called = 0
        self.warnings: list[Problem] = []
        tools = Functions(
            load_yaml=self._load_yaml, abs_filename=self._absolute, dotify=lambda value: value, tokenize=xacro.tokenize,
            arg=self._argument, message=self._ignore, warning=self._warn, error=self._warn, fatal=self._fatal,
            print_location=self._ignore,
        )  # fmt: skip
        self._evaluator = Evaluator(*tools.values(), self._find)
        bare = {name: tools[name] for name in ("load_yaml", "abs_filename", "dotify")}
        self._symbols = {**GLOBALS, **bare, "xacro": tools}

    @contextmanager
    def engine(self) -> Iterator[None]:
        """The library with these parts in place."""
        xacro, eval_text = self._xacro, self._xacro.eval_text
        parts: dict[str, Any] = {
            "safe_eval": lambda expression, names, _locals=None: self._evaluator.value(expression, names),
            "eval_extension": self._extension,
            "eval_text": lambda text, symbols: bounded(eval_text(text, symbols)),
            "eval_all": self._counting(xacro.eval_all),
            "handle_macro_call": self._tracing(xacro.handle_macro_call),
            "check_attrs": self._noting(xacro.check_attrs),
            "reqd_attrs": self._noting(xacro.reqd_attrs),
            "get_include_files": self._included,
            "parse": self._parsed,
            "warning": self._ignore,
            "message": self._ignore,
            "error": self._ignore,
            "print_location": self._ignore,
            "_global_symbols": self._symbols,
            "substitution_args_context": {"arg": {}},
        }
        kept = {name: getattr(xacro, name) for name in parts}
        try:
            for name, part in parts.items():
                setattr(xacro, name, part)
            xacro.init_stacks(str(self._path))
            yield
        finally:
            for name, part in kept.items():
                setattr(xacro, name, part)
            xacro.init_stacks(None)

    def run(self, content: bytes) -> Element:
        """The expanded description. Raises InputError."""
        try:
            document = self._document(self._path, content)
            self._xacro.process_doc(document, mappings=dict(self._arguments))
        except InputError:
            raise
        except Exception as error:
            raise InputError(self._problem(error)) from error
        root = self._element(document.documentElement, Place(self._path), 0)
        self._check_arguments()
        if root.tag != ROOT:
            raise root.error("wrong-root", f"the file begins with <{root.shown_tag}>, expected <{ROOT}>")
        return root

    # Places and bounds: these go around functions of the library.

    def _noting(self, read: Callable[..., Any]) -> Callable[..., Any]:
        def noted(node: Any, *attributes: Any) -> Any:  # noqa: ANN401
            self._at = node.getUserData(_PLACE) or self._at
            if node.tagName == "xacro:arg" and node.getAttribute("name"):
                self._asked.setdefault(node.getAttribute("name"), node.getAttribute("default"))
            return read(node, *attributes)

        return noted

    def _counting(self, evaluate: Callable[..., Any]) -> Callable[..., Any]:
        def counted(node: Any, *scopes: Any) -> Any:  # noqa: ANN401
            self._at = node.getUserData(_PLACE) or self._at
            self._elements += 1
            if self._elements > MAX_EXPANDED:
                message = f"the file expands to more than {MAX_EXPANDED:,} elements"
                raise bad_input("too-many-elements", message, self._at)
            return evaluate(node, *scopes)

        return counted

    def _tracing(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def traced(node: Any, *scopes: Any) -> Any:  # noqa: ANN401
            if not node.tagName.startswith("xacro:"):
                return False
            self._at = node.getUserData(_PLACE) or self._at
            self._called += 1
            if self._called > MAX_CALLS:
                raise self._error("xacro", f"the file expands more than {MAX_CALLS:,} macros")
            self._calls.append(_Call(node.tagName.removeprefix("xacro:"), self._at))
            done = call(node, *scopes)
            self._calls.pop()
            return done

        return traced

    # What `$(...)` and functions of expressions stand for.

    def _extension(self, text: str) -> object:
        command, _, rest = text[2:-1].strip().partition(" ")
        words = rest.split()
        match command:
            case "arg" if len(words) == 1:
                return self._argument(words[0])
            case "find" if len(words) == 1:
                return self._find(words[0])
            case "dirname":
                return str(self._current.parent)
            case "eval":
                functions: dict[str, Callable[..., Any]] = {
                    "arg": self._converted,
                    "find": self._find,
                    "dirname": lambda: str(self._current.parent),
                }
                evaluator = Evaluator(*functions.values())
                flags = {"true": True, "false": False}
                return str(evaluator.value(rest, {**GLOBALS, **flags, **self._given, **functions}))
            case "env" | "optenv" if words:
                return self._environment(words[0], " ".join(words[1:]) if command == "optenv" else None)
        known = ("arg", "dirname", "env", "eval", "find", "optenv")
        raise self._error(
            "xacro", f"found `{text}`, expected $(arg NAME) or $(find PACKAGE); {expected_names(command, known)}"
        )

    @property
    def _given(self) -> dict[str, Any]:
        values: dict[str, Any] = self._xacro.substitution_args_context["arg"]
        return {name: self._converted(name) for name in values}

    def _argument(self, name: str) -> str:
        self._asked.setdefault(name, None)
        values: dict[str, str] = self._xacro.substitution_args_context["arg"]
        if name not in values and name == "name":  # of the robot, which launch files state
            return self._path.name.split(".")[0]
        if name not in values:
            message, line = f"the argument `{name}` has no value", self._line_of_argument(name)
            if line is not None:
                message += f" here: <xacro:arg> states it below, in line {line}, which xacro reads later"
            raise self._error("xacro-argument", message, mend=_how_to_give(name))
        return values[name]

    def _line_of_argument(self, name: str) -> int | None:
        """The line in which the file that is being read states an argument."""
        stated = re.compile(rf"""<xacro:arg\s[^>]*\bname\s*=\s*["']{re.escape(name)}["']""")
        found = stated.search(decoded(self._at.file, read_input(self._at.file, MAX_BYTES)))
        return None if found is None else found.string.count("\n", 0, found.start()) + 1

    def _converted(self, name: str) -> object:
        """An argument as `$(eval ...)` sees it: a number or a truth value if it looks like one."""
        value = self._argument(name)
        if value.lower() in ("true", "false"):
            return value.lower() == "true"
        for kind in (int, float):
            try:
                return kind(value)
            except ValueError:
                pass
        return value

    def _environment(self, name: str, default: str | None) -> str:
        """A variable of the environment: only if it is given as an argument, or its default."""
        self._asked.setdefault(name, default)
        if name in self._arguments:
            return self._arguments[name]
        if default is None:
            message = f"the file asks for the environment variable `{name}`, which is never read"
            raise self._error("xacro-argument", message, mend=_how_to_give(name))
        return default

    def _find(self, package: str) -> str:
        known = (*self._folders, *self._source.roots)
        folder = packages.package_folder(package, (*known, *self._source.search), self._at)
        self.packages[package] = folder
        return str(folder)

    def _load_yaml(self, name: str) -> object:
        if not name:
            raise self._error("xacro", "found `load_yaml('')`, expected the name of a file: an argument is empty")
        path = self._allowed(self._absolute(name))
        self._count_file()
        try:
            read_yaml(path, frozenset(f"!{unit}" for unit in UNITS))  # which has bounds and good messages
        except InputError as error:
            if not {problem.code for problem in error.problems} <= _ACCEPTED:
                raise InputError(*(self._with_arguments(problem) for problem in error.problems)) from error
        return bounded(yaml.load(read_input(path, MAX_BYTES), unit_loader(self._evaluator)))  # noqa: S506

    def _absolute(self, name: str) -> str:
        if name.startswith("package://"):
            package, rest = packages.package_and_path(name)
            return str(Path(self._find(package)) / rest)
        return os.path.normpath(self._current.parent / name.removeprefix("file://"))

    def _ignore(self, *_what: object, **_how: object) -> str:
        return ""

    def _warn(self, *what: object, **_how: object) -> str:
        message = "the file warns: " + " ".join(map(str, what))[:300]
        self.warnings.append(Problem("xacro-warning", message, self._at, severity="warning"))
        return ""

    def _fatal(self, *what: object) -> str:
        raise self._error("xacro", "the file refuses this: " + " ".join(map(str, what))[:300])

    # Files.

    @property
    def _current(self) -> Path:
        return Path(self._xacro.filestack[-1] or self._path)

    def _included(self, spec: str, symbols: Any) -> Iterator[str]:  # noqa: ANN401
        """Paths of an include, also with wildcards."""
        wanted = self._absolute(str(self._xacro.eval_text(spec, symbols)))
        matches = sorted(glob.glob(wanted)) if any(sign in wanted for sign in "*?[") else [wanted]  # noqa: PTH207 # absolute
        if len(self._xacro.filestack) > MAX_INCLUDES:
            raise self._error("xacro", f"files include each other deeper than {MAX_INCLUDES} levels")
        yield from (str(self._allowed(path)) for path in matches)

    def _parsed(self, _text: None, name: str) -> minidom.Document:
        self._count_file()
        asked_at = self._at
        try:
            return self._document(Path(name), read_input(Path(name), MAX_BYTES))
        except InputError as error:
            if error.problems[0].code != "missing-file":
                raise
            self._xacro.filestack.pop()
            problem = self._with_arguments(error.problems[0])
            problem = Problem("missing-file", f"{name}: {problem.message}", asked_at, mend=problem.mend)
            missing = _MissingError(InputError(problem))
            raise self._xacro.XacroException(exc=missing) from error

    def _document(self, path: Path, content: bytes) -> minidom.Document:
        parse_xml(path, content, None)  # well-formed, of bounded size, without entities
        document: minidom.Document = _PlacedBuilder(path).parseString(content)
        for node in document.getElementsByTagName("property"):
            if node.parentNode is document.documentElement:  # as xacro before 2014 wrote it
                document.renameNode(node, "", "xacro:property")
        return document

    def _allowed(self, name: str) -> Path:
        """The path, if it may be read. Raises InputError."""
        path = Path(os.path.normpath(name))
        readable = (*self._folders, *self._source.roots, *self.packages.values())
        if any(path.is_relative_to(folder) for folder in readable):
            return path
        message = f"`{name}` is outside the folders that this file may read: its own, its package and those of packages"
        mend = f"add {path.parent} to `robot.package_roots` or to ROS_PACKAGE_PATH (`init --package-root`)"
        raise self._error("outside-roots", message, mend=mend)

    def _count_file(self) -> None:
        self._files += 1
        if self._files > MAX_FILES:
            raise self._error("xacro", f"more than {MAX_FILES} files are included or loaded")

    # Results and problems.

    def _element(self, node: Any, place: Place, depth: int) -> Element:  # noqa: ANN401
        place = node.getUserData(_PLACE) or place
        if depth > MAX_DEPTH:
            raise bad_input("nesting-too-deep", f"elements are nested deeper than {MAX_DEPTH} levels", place)
        attributes = {name: value for name, value in node.attributes.items() if not name.startswith("xmlns")}
        children = [self._element(child, place, depth + 1) for child in node.childNodes if child.nodeType == 1]
        return Element(node.tagName, attributes, place, children)

    def _error(self, code: str, message: str, mend: str | None = None) -> InputError:
        return InputError(self._with_arguments(Problem(code, message + self._within(), self._at, mend=mend)))

    def _within(self) -> str:
        call = next((call for call in reversed(self._calls) if call.place != self._at), None)
        return f" (in macro `{call.name}`, called at {call.place})" if call else ""

    def _problem(self, error: BaseException) -> Problem:
        """What went wrong, from the innermost of the library's nested errors."""
        expression, nested = "", error
        while True:
            suffix = getattr(nested, "suffix", None)
            expression = suffix.strip().removeprefix("when evaluating expression ") if suffix else expression
            inner = getattr(nested, "exc", None)
            if not isinstance(inner, BaseException):
                break
            nested = inner
        if isinstance(nested, InputError | _MissingError):
            return (nested.error if isinstance(nested, _MissingError) else nested).problems[0]
        if isinstance(nested, RecursionError):
            return Problem("xacro", f"a macro or an expression leads back to itself{self._within()}", self._at)
        message = str(nested) or type(nested).__name__
        if isinstance(nested, self._xacro.XacroException) and message.startswith("unknown macro name: "):
            tag = message.removeprefix("unknown macro name: ")
            message = f"<{tag}> is no known macro; is the file included that defines it?"
        elif isinstance(nested, ArithmeticError | TypeError | ValueError) and expression:
            what = "" if isinstance(nested, RefusedExpressionError) else f"{type(nested).__name__}: "
            message = f"{expression.strip(chr(39))[:100]!r} cannot be evaluated: {what}{message}"
        return self._with_arguments(Problem("xacro", message[:600] + self._within(), self._at))

    def _with_arguments(self, problem: Problem) -> Problem:
        """The problem, with the file's arguments if no other remedy is known: a missing file often follows from one."""
        if problem.mend is not None or not self._asked:
            return problem
        shown = ", ".join(
            name if default is None else f"{name} ({self._arguments.get(name, default)})"
            for name, default in [*self._asked.items()][:12]
        )
        return replace(problem, mend=f"the file's arguments, with their values: {shown}")

    def _check_arguments(self) -> None:
        for name in self._arguments:
            if name not in self._asked:
                message = f"the file takes no argument `{name}`; {expected_names(name, self._asked)}"
                raise bad_input("xacro-argument", message, Place(self._path))


def _how_to_give(name: str) -> str:
    return f"say `args: {{{name}: VALUE}}` beside `xacro:`, or `{name}:=VALUE` after `init`"

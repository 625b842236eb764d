"""Reading and checking PDDL domains."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, TypeAlias

from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names
from sqrp_cli.logic import domain as pddl
from sqrp_cli.logic.source_text import SourceText, character_name, is_unseen
from sqrp_cli.records import dataclass

REQUIREMENTS = (
    ":strips", ":typing", ":equality", ":negative-preconditions", ":disjunctive-preconditions",
    ":existential-preconditions", ":universal-preconditions", ":quantified-preconditions",
)  # fmt: skip
"""The supported requirements; every other one is an error."""

_SECTIONS = (":requirements", ":types", ":constants", ":predicates", ":action")
_ACTION_KEYS = (":parameters", ":precondition", ":effect")
_DEFINE = re.compile(r"\(\s*define\b", re.IGNORECASE)
_WORD = re.compile(r"^[^;\w\n]*\w", re.MULTILINE)
"""Matches a line with a word outside comments."""
_NAME = re.compile(r"[a-z][a-z0-9_-]*")
VARIABLE = "a variable such as `?object`"
_CONNECTIVES = ("and", "or", "not", "imply", "forall", "exists", "=", "when")
_NUMERIC = ("increase", "decrease", "assign", "scale-up", "scale-down", "<", ">", "<=", ">=")


MAX_DEPTH = 50
"""Deepest nesting of lists."""

MAX_LENGTH = 1_000_000
"""Most characters of a file."""

_PART = re.compile(r";[^\n]*|[()]|[^ \t\f\r\n();]+")
"""A comment, a parenthesis or a word.

A word has all but parentheses and what is skipped, which is less than what Python calls space: it shows as part of a
wrong name.
"""

_NOT_PLAIN = re.compile(r";[^\n]*|[^\t\n\f\r -~]")
"""Comments, and characters that are neither printable ASCII nor white space between words."""


@dataclass(frozen=True)
class Word:
    """A word in lower case (PDDL ignores case), with the offset of its first character."""

    text: str
    offset: int


@dataclass(frozen=True)
class WordList:
    """A list."""

    items: tuple[Node, ...]
    offset: int
    """Offset of its opening parenthesis."""

    @property
    def head(self) -> str:
        """The first item if it is a word, else an empty text."""
        first = self.items[0] if self.items else None
        return first.text if isinstance(first, Word) else ""


Node: TypeAlias = Word | WordList


def parse_domain(text: str, path: Path) -> pddl.Domain:
    """The domain that a PDDL file defines, with one or more actions.

    Supported: typing, constants, equality, negative, disjunctive and quantified preconditions, unconditional effects; a
    domain must declare those that it uses among its requirements. Raises InputError with all problems in order of
    place, each with line, column and an excerpt of the text.
    """
    # Any other file may be secret and named to see its content: do not quote it.
    if _WORD.search(text) and not _DEFINE.search(text):
        raise bad_input("pddl-syntax", "this is no PDDL: expected `(define (domain ...`", Place(path, 1, 1))
    reader = _Reader(SourceText(text, Place(path, 1, 1)))
    domain = reader.read(read_list(reader.source))
    reader.stop_at_problems()
    return domain


Scope = dict[str, str]
"""Type of each variable in scope."""

MAX_PROBLEMS = 100
"""Most problems of a file that are reported at once."""


class TypedTerm(NamedTuple):
    """A term with its type."""

    term: pddl.Term
    type: str | None
    """None of an unknown name."""


@dataclass
class _Reader:
    """The state of reading one domain: declarations and problems so far."""

    source: SourceText
    problems: list[Problem] = field(default_factory=list)
    requirements: set[str] = field(default_factory=set)
    types: dict[str, str] = field(default_factory=dict)
    constants: dict[str, str] = field(default_factory=dict)
    predicates: dict[str, pddl.Signature] = field(default_factory=dict)
    actions: dict[str, pddl.Action] = field(default_factory=dict)

    def report(self, code: str, message: str, node: Node, mend: str | None = None) -> None:
        """Records a problem and continues; at most `MAX_PROBLEMS`."""
        if len(self.problems) < MAX_PROBLEMS:
            self.problems.append(self.source.problem(code, message, node.offset, mend))

    def failure(self, message: str, node: Node, code: str = "pddl-syntax") -> InputError:
        """The error for a problem that makes the list around `node` unreadable."""
        return InputError(self.source.problem(code, message, node.offset))

    def stop_at_problems(self) -> None:
        """Raises the problems found so far, if any."""
        if self.problems:
            raise InputError(*sorted(self.problems, key=lambda problem: problem.position))

    def read(self, top: WordList) -> pddl.Domain:
        name_list = top.items[1] if len(top.items) > 1 else None
        if top.head != "define" or not isinstance(name_list, WordList) or name_list.head not in ("domain", "problem"):
            raise self.failure("expected `(define (domain NAME) ...)`", top)
        if name_list.head == "problem":
            raise self.failure("this is a PDDL problem; expected `(define (domain NAME) ...)`", name_list)
        if len(name_list.items) != 2:
            raise self.failure("expected `(domain NAME)`", name_list)
        name = self.name(name_list.items[1], "a domain name")
        sections = self.sections(top.items[2:])
        readers = (self.read_requirements, self.read_types, self.read_constants, self.read_predicates, self.read_action)
        for head, read in zip(_SECTIONS, readers, strict=True):
            if head == ":action":
                self.stop_at_problems()
            for number, section in enumerate(sections[head]):
                if number and head != ":action":
                    self.report("pddl-duplicate", f"a second `{head}` section; expected at most one", section)
                    continue
                try:
                    read(section)
                except InputError as error:
                    self.problems += error.problems
        if not sections[":action"] and not self.problems:
            raise self.failure("the domain has no action; expected `(:action NAME ...)`", top)
        return pddl.Domain(
            name=name.text,
            path=self.source.place.file,
            requirements=frozenset(self.requirements),
            types=self.types,
            constants=self.constants,
            predicates=self.predicates,
            actions=self.actions,
        )

    def sections(self, nodes: Sequence[Node]) -> dict[str, list[WordList]]:
        sections: dict[str, list[WordList]] = {head: [] for head in _SECTIONS}
        for node in nodes:
            if not isinstance(node, WordList) or not node.head:
                found = f"`{node.text}`" if isinstance(node, Word) else "a list without a name"
                raise self.failure(f"expected a section such as `(:action ...)`, found {found}", node)
            if node.head in sections:
                sections[node.head].append(node)
            elif node.head in (":functions", ":derived", ":durative-action", ":constraints", ":event", ":process"):
                self.report("pddl-unsupported", f"`{node.head}` is not supported", node)
            else:
                message = f"unknown section `{node.head}`; {expected_names(node.head, _SECTIONS)}"
                self.report("pddl-syntax", message, node)
        return sections

    def read_requirements(self, section: WordList) -> None:
        for node in section.items[1:]:
            word = self.word(node, "a requirement such as `:typing`")
            if word.text not in REQUIREMENTS:
                message = f"requirement `{word.text}` is not supported; {expected_names(word.text, REQUIREMENTS)}"
                self.report("pddl-unsupported", message, word)
            self.requirements.add(word.text)

    def read_types(self, section: WordList) -> None:
        self.need(section, "`:types`", ":typing")
        declared = self.typed_list(section.items[1:], "a type")
        where = {word.text: word for word, _ in declared}
        for word, parent in declared:
            if word.text in self.types or word.text == pddl.OBJECT:
                self.report("pddl-duplicate", f"type `{word.text}` is declared twice", word)
            elif parent and parent.text not in where and parent.text != pddl.OBJECT:
                self.report("pddl-unknown-type", self.unknown("type", parent.text, [*where, pddl.OBJECT]), parent)
            else:
                self.types[word.text] = parent.text if parent else pddl.OBJECT
        for name in self.types:
            chain = [name]
            while chain[-1] in self.types and len(chain) <= len(self.types):
                chain.append(self.types[chain[-1]])
                if chain[-1] == name:
                    cycle = " - ".join(f"`{link}`" for link in chain)
                    raise self.failure(f"type `{name}` is above itself: {cycle}", where[name], "pddl-cyclic-types")

    def read_constants(self, section: WordList) -> None:
        for word, type_word in self.typed_list(section.items[1:], "a constant"):
            if word.text in self.constants:
                self.report("pddl-duplicate", f"constant `{word.text}` is declared twice", word)
            self.constants[word.text] = self.type_of(type_word)

    def read_predicates(self, section: WordList) -> None:
        for node in section.items[1:]:
            if not isinstance(node, WordList) or not node.items:
                raise self.failure("expected a predicate such as `(hold ?object - movable)`", node)
            word = self.name(node.items[0], "a predicate's name")
            if word.text in _CONNECTIVES:
                self.report("pddl-syntax", f"`{word.text}` cannot be the name of a predicate", word)
            if word.text in self.predicates:
                self.report("pddl-duplicate", f"predicate `{word.text}` is declared twice", word)
            self.predicates[word.text] = pddl.Signature(word.text, self.parameters(node.items[1:], {}))

    def read_action(self, section: WordList) -> None:
        if len(section.items) < 2:
            raise self.failure("expected `(:action NAME :parameters (...) :precondition (...) :effect (...))`", section)
        name = self.name(section.items[1], "an action's name")
        if name.text in self.actions:
            self.report("pddl-duplicate", f"action `{name.text}` is defined twice", name)
        # The lists of an action by their keys, those that it must have among them.
        nodes = section.items[2:]
        parts: dict[str, WordList] = {}
        for key_node, value in zip(nodes[::2], [*nodes[1::2], None], strict=False):
            key = self.word(key_node, expected_names("", _ACTION_KEYS))
            if key.text not in _ACTION_KEYS:
                message = f"unknown key `{key.text}` of an action; {expected_names(key.text, _ACTION_KEYS)}"
                raise self.failure(message, key)
            if not isinstance(value, WordList):
                raise self.failure(f"expected a list in parentheses after `{key.text}`", value or key)
            if key.text in parts:
                self.report("pddl-duplicate", f"a second `{key.text}` of action `{name.text}`", key)
            parts[key.text] = value
        for required in (":parameters", ":effect"):
            if required not in parts:
                raise self.failure(f"action `{name.text}` has no `{required}`", name)
        scope: Scope = {}
        parameters = self.parameters(parts[":parameters"].items, scope)
        precondition: pddl.Condition = pddl.Conjunction()
        if ":precondition" in parts and parts[":precondition"].items:
            precondition = self.condition(parts[":precondition"], scope)
        effect = self.effect(parts[":effect"], scope)
        place = self.source.place_at(name.offset)
        self.actions[name.text] = pddl.Action(
            name=name.text, parameters=parameters, precondition=precondition, effect=effect, place=place
        )

    def parameters(self, nodes: Sequence[Node], scope: Scope) -> tuple[pddl.Parameter, ...]:
        """Reads a typed list of variables and adds them to the scope."""
        found = []
        for word, type_word in self.typed_list(nodes, VARIABLE):
            name = word.text.removeprefix("?")
            if name in scope:
                self.report("pddl-duplicate", f"variable `{word.text}` is declared twice", word)
            scope[name] = self.type_of(type_word)
            found.append(pddl.Parameter(name, scope[name]))
        return tuple(found)

    def typed_list(self, nodes: Sequence[Node], what: str) -> list[tuple[Word, Word | None]]:
        """Words with their types in a list such as `a b - t c`; what: their kind, which decides their syntax."""
        found: list[tuple[Word, Word | None]] = []
        untyped: list[Word] = []
        remaining = iter(nodes)
        for node in remaining:
            if not (isinstance(node, Word) and node.text == "-"):
                untyped.append(self.name(node, what))
                continue
            type_node = next(remaining, node)
            if isinstance(type_node, WordList) and type_node.head == "either":
                raise self.failure("`either` is not supported; expected one type", type_node, "pddl-unsupported")
            if not untyped or type_node is node:
                raise self.failure(f"expected {what} before `-` and a type after it", node)
            self.need(node, "`- type`", ":typing")
            found += [(word, self.name(type_node, "a type")) for word in untyped]
            untyped = []
        return found + [(word, None) for word in untyped]

    def condition(self, node: Node, scope: Scope) -> pddl.Condition:
        if not isinstance(node, WordList) or not node.items:
            raise self.failure("expected a condition such as `(hold ?object)`", node)
        arguments = node.items[1:]
        match node.head:
            case "and":
                return pddl.Conjunction(tuple(self.condition(part, scope) for part in arguments))
            case "or":
                self.need(node, "`or`", ":disjunctive-preconditions")
                return pddl.Disjunction(tuple(self.condition(part, scope) for part in arguments))
            case "imply":
                self.need(node, "`imply`", ":disjunctive-preconditions")
                premise, conclusion = self.exactly(2, node)
                return pddl.Disjunction(
                    (pddl.Negation(self.condition(premise, scope)), self.condition(conclusion, scope))
                )
            case "not":
                (part,) = self.exactly(1, node)
                negated = self.condition(part, scope)
                if isinstance(negated, pddl.Holds | pddl.Equal):
                    self.need(node, "`not` in a precondition", ":negative-preconditions", ":disjunctive-preconditions")
                else:
                    self.need(node, "`not` of more than a predicate", ":disjunctive-preconditions")
                return pddl.Negation(negated)
            case "forall" | "exists" as quantifier:
                own = ":universal-preconditions" if quantifier == "forall" else ":existential-preconditions"
                self.need(node, f"`{quantifier}`", own, ":quantified-preconditions")
                variable_list, body = self.exactly(2, node)
                if not isinstance(variable_list, WordList):
                    raise self.failure(f"expected a list of variables after `{quantifier}`", variable_list)
                inner = dict(scope)
                variables = self.parameters(variable_list.items, inner)
                kind = pddl.ForAll if quantifier == "forall" else pddl.Exists
                return kind(variables, self.condition(body, inner))
            case "=":
                self.need(node, "`=`", ":equality")
                left, right = self.exactly(2, node)
                return pddl.Equal(self.term(left, scope).term, self.term(right, scope).term)
        return self.holds(node, scope)

    def effect(self, node: WordList, scope: Scope) -> pddl.Effect:
        adds: dict[pddl.Holds, None] = {}
        deletes: dict[pddl.Holds, None] = {}
        for part in node.items[1:] if node.head == "and" else (node,) if node.items else ():
            if not isinstance(part, WordList) or not part.items:
                raise self.failure("expected an effect such as `(hold ?object)`", part)
            if part.head in ("when", "forall"):
                message = (
                    f"conditional effects (`{part.head}`) are not supported; expected predicates or their negation"
                )
                raise self.failure(message, part, "pddl-unsupported")
            if part.head in ("and", "or", "imply", "exists", "="):
                raise self.failure(f"`{part.head}` cannot be an effect; expected predicates or `not`", part)
            changed, opposite = (deletes, adds) if part.head == "not" else (adds, deletes)
            (atom,) = self.exactly(1, part) if part.head == "not" else (part,)
            if not isinstance(atom, WordList) or not atom.items or atom.head in _CONNECTIVES:
                raise self.failure("expected a predicate after `not` in an effect", atom)
            change = self.holds(atom, scope)
            if change in opposite:
                self.report("pddl-contradictory-effect", f"the effect makes `{change}` both true and false", part)
            changed[change] = None
        return pddl.Effect(tuple(adds), tuple(deletes))

    def holds(self, node: WordList, scope: Scope) -> pddl.Holds:
        word = self.word(node.items[0], "a predicate's name")
        if word.text in _NUMERIC:
            raise self.failure(f"numbers (`{word.text}`) are not supported", node, "pddl-unsupported")
        if word.text == "when":
            raise self.failure("`when` cannot be part of a condition", node)
        terms = [self.term(item, scope) for item in node.items[1:]]
        signature = self.predicates.get(word.text)
        if signature is None:
            self.report("pddl-unknown-predicate", self.unknown("predicate", word.text, self.predicates), word)
        elif mismatch := signature.mismatch(terms):
            self.report("pddl-arity", mismatch, node)
        else:
            for item, (term, found), parameter in zip(node.items[1:], terms, signature.parameters, strict=True):
                known = found is not None and self.declared(found) and self.declared(parameter.type)
                if found is not None and known and parameter.type not in pddl.with_ancestors(found, self.types):
                    message = f"`{term}` is of type `{found}`, but `{word.text}` expects `{parameter.type}`"
                    self.report("pddl-type", message, item)
        return pddl.Holds(word.text, tuple(term for term, _ in terms))

    def term(self, node: Node, scope: Scope) -> TypedTerm:
        """A term with its type."""
        word = self.word(node, "a variable or a constant")
        if word.text.startswith("?"):
            name = word.text[1:]
            if name not in scope:
                message = self.unknown("variable", word.text, [f"?{variable}" for variable in scope])
                self.report("pddl-unknown-variable", message, word)
            return TypedTerm(pddl.Variable(name), scope.get(name))
        if word.text not in self.constants:
            message = self.unknown("constant", word.text, [*self.constants, *(f"?{variable}" for variable in scope)])
            self.report("pddl-unknown-constant", message, word)
        return TypedTerm(pddl.Constant(word.text), self.constants.get(word.text))

    def type_of(self, word: Word | None) -> str:
        if word is None:
            return pddl.OBJECT
        if not self.declared(word.text):
            self.report("pddl-unknown-type", self.unknown("type", word.text, [*self.types, pddl.OBJECT]), word)
        return word.text

    def declared(self, type_name: str) -> bool:
        """Whether there is such a type."""
        return type_name == pddl.OBJECT or type_name in self.types

    def need(self, node: Node, what: str, *requirements: str) -> None:
        """Records a problem, once per requirement, unless one of the requirements is declared."""
        if self.requirements.isdisjoint(requirements):
            mend = f"add `{requirements[0]}` to `(:requirements ...)`"
            message = f"{what} needs the requirement `{requirements[0]}`, which is not declared"
            self.report("pddl-undeclared-requirement", message, node, mend)
            self.requirements.add(requirements[0])

    def exactly(self, count: int, node: WordList) -> tuple[Node, ...]:
        arguments = node.items[1:]
        if len(arguments) != count:
            found = f"{len(arguments)} argument{'s' * (len(arguments) != 1)}"
            raise self.failure(f"`{node.head}` has {found}; expected {count}", node)
        return arguments

    def word(self, node: Node, what: str) -> Word:
        if isinstance(node, WordList):
            raise self.failure(f"expected {what}, found a list", node)
        return node

    def name(self, node: Node, what: str) -> Word:
        """A name; with a question mark before it if `what` is a variable."""
        word = self.word(node, what)
        mark = "?" if what == VARIABLE else ""
        if not (word.text.startswith(mark) and _NAME.fullmatch(word.text[len(mark) :])):
            missing = f"; is a `)` missing before `({word.text}`?" if word.text in _SECTIONS else ""
            raise self.failure(f"expected {what}, found `{word.text}`{missing}", word)
        return word

    def unknown(self, kind: str, name: str, valid: Iterable[str]) -> str:
        return f"{kind} `{name}` is not declared; {expected_names(name, valid)}"


def read_list(source: SourceText) -> WordList:
    """The only list in the text.

    Raises InputError for invisible characters, unbalanced parentheses and text outside them, with line, column and
    excerpt.
    """
    if len(source.text) > MAX_LENGTH:
        message = f"the file has {len(source.text)} characters; at most {MAX_LENGTH} are read"
        raise bad_input("pddl-too-long", message, source.place)
    for found in _NOT_PLAIN.finditer(source.text):
        if not found[0].startswith(";") and is_unseen(found[0]):
            message = f"found the character {character_name(found[0])}, which no word of PDDL has"
            raise InputError(
                source.problem("pddl-character", message, found.start(), "remove it, or put a blank or an end of line")
            )
    read = _read(source.text)
    if isinstance(read, Word):
        raise InputError(source.problem("pddl-syntax", read.text, read.offset))
    whole, depth = read
    if depth > MAX_DEPTH:
        raise InputError(source.problem("pddl-too-deep", f"lists are nested deeper than {MAX_DEPTH} levels", 0))
    return whole


@lru_cache(maxsize=64)
def _read(text: str) -> tuple[WordList, int] | Word:
    """The list that a text is with its levels of lists, or what is wrong with its parentheses and where.

    Cached: cells often share the texts of skills. Without recursion, so that no input exhausts the stack.
    """
    open_lists: list[tuple[list[Node], int]] = []
    whole, depth, before, suspect = None, 0, "", None
    for found in _PART.finditer(text):
        part, offset = found[0], found.start()
        if part.startswith(";"):
            continue
        if whole is not None:
            message = f"`{part}` follows after the end of the domain; is there a `)` too many before it?"
            return suspect or Word(message, offset)
        if part == "(":
            open_lists.append(([], offset))
            depth = max(depth, len(open_lists))
        elif not open_lists:
            return suspect or Word(f"expected `(define (domain ...`, found `{part}`", offset)
        elif part == ")":
            items, start = open_lists.pop()
            ended = WordList(tuple(items), start)
            if open_lists:
                open_lists[-1][0].append(ended)
            else:
                whole = ended
        else:
            if suspect is None and before == "(" and part.startswith(":") and len(open_lists) > 2:
                line = text.count("\n", 0, open_lists[-2][1]) + 1
                message = f"`{part}` begins inside the list that line {line} opens; is a `)` missing before it?"
                suspect = Word(message, open_lists[-1][1])
            open_lists[-1][0].append(Word(part.lower(), offset))
        before = part
    if whole is not None:
        return whole, depth
    if not open_lists:
        return Word("the file is empty; expected `(define (domain ...`", 0)
    return suspect or Word("this parenthesis is never closed", open_lists[-1][1])

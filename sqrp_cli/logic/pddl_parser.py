"""Reading and checking PDDL domains."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import field
from functools import lru_cache
from pathlib import Path

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
_WORD = re.compile(r"^[^;\w\n]*\w", re.MULTILINE)  # Matches a line with a word outside comments
_NAME = re.compile(r"[a-z][a-z0-9_-]*")
VARIABLE = "a variable such as `?object`"
_CONNECTIVES = ("and", "or", "not", "imply", "forall", "exists", "=", "when")
_NUMERIC = ("increase", "decrease", "assign", "scale-up", "scale-down", "<", ">", "<=", ">=")
MAX_DEPTH = 50  # Deepest nesting of lists
MAX_LENGTH = 1_000_000  # Most characters of a file
_PART = re.compile(r";[^\n]*|[()]|[^ \t\f\r\n();]+")
"""A comment, a parenthesis or a word.

A word has all but parentheses and what is skipped, which is less than what Python calls space: it shows as part of a
wrong name.
"""

_NOT_PLAIN = re.compile(r";[^\n]*|[^\t\n\f\r -~]")
"""Comments, and characters that are neither printable ASCII nor white space between words."""


@dataclass(frozen=True)
class Node:
    """A word or a list, with the offset of its first character."""

    offset: int
    text: str = ""  # The word in lower case (PDDL ignores case); empty of a list
    items: tuple[Node, ...] = ()  # Of the list
    head: str = ""  # The first item of a list if it is a word


def parse_domain(text: str, path: Path) -> pddl.Domain:
    """The domain that a PDDL file defines, with one or more actions.

    Supported: typing, constants, equality, negative, disjunctive and quantified preconditions, unconditional effects; a
    domain must declare those that it uses among its requirements. Raises InputError with all problems in order of
    place, each with line, column and an excerpt of the text.
    """
    # Any other file may be secret and named to see its content: do not quote it.
    if _WORD.search(text) and not _DEFINE.search(text):
        raise bad_input("pddl-syntax", "this is no PDDL: expected `(define (domain ...`", Place(path, 1, 1))
    source = SourceText(text, Place(path, 1, 1))
    if len(text) > MAX_LENGTH:
        message = f"the file has {len(text)} characters; at most {MAX_LENGTH} are read"
        raise bad_input("pddl-too-long", message, source.place)
    for found in _NOT_PLAIN.finditer(text):
        if not found[0].startswith(";") and is_unseen(found[0]):
            message = f"found the character {character_name(found[0])}, which no word of PDDL has"
            mend = "remove it, or put a blank or an end of line"
            raise InputError(source.problem("pddl-character", message, found.start(), mend))
    whole, depth = _read(text)
    if whole.text:
        raise InputError(source.problem("pddl-syntax", whole.text, whole.offset))
    if depth > MAX_DEPTH:
        raise InputError(source.problem("pddl-too-deep", f"lists are nested deeper than {MAX_DEPTH} levels", 0))
    return _Reader(source).read(whole)


Scope = dict[str, str]  # Type of each variable in scope, by its name without question mark
MAX_PROBLEMS = 100  # Most problems of a file that are reported at once


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

    def unknown(self, code: str, word: Node, valid: Iterable[str]) -> None:
        """Records that a name of a kind, the last word of the code, is not declared."""
        kind = code.removeprefix("pddl-unknown-")
        self.report(code, f"{kind} `{word.text}` is not declared; {expected_names(word.text, valid)}", word)

    def read(self, top: Node) -> pddl.Domain:
        named = top.items[1] if len(top.items) > 1 else None
        if top.head != "define" or named is None or named.head not in ("domain", "problem"):
            raise self.failure("expected `(define (domain NAME) ...)`", top)
        if named.head == "problem":
            raise self.failure("this is a PDDL problem; expected `(define (domain NAME) ...)`", named)
        if len(named.items) != 2:
            raise self.failure("expected `(domain NAME)`", named)
        self.word(named.items[1], "a domain name", name=True)
        sections: dict[str, list[Node]] = {head: [] for head in _SECTIONS}
        for node in top.items[2:]:
            if not node.head:
                found = f"`{node.text}`" if node.text else "a list without a name"
                raise self.failure(f"expected a section such as `(:action ...)`, found {found}", node)
            if node.head in sections:
                sections[node.head].append(node)
            elif node.head in (":functions", ":derived", ":durative-action", ":constraints", ":event", ":process"):
                self.report("pddl-unsupported", f"`{node.head}` is not supported", node)
            else:
                message = f"unknown section `{node.head}`; {expected_names(node.head, _SECTIONS)}"
                self.report("pddl-syntax", message, node)
        for head, found_sections in sections.items():
            if head == ":action" and not found_sections and not self.problems:
                raise self.failure("the domain has no action; expected `(:action NAME ...)`", top)
            for number, section in enumerate(found_sections if head != ":action" or not self.problems else ()):
                if number and head != ":action":
                    self.report("pddl-duplicate", f"a second `{head}` section; expected at most one", section)
                    continue
                try:
                    self.read_action(section) if head == ":action" else self.read_declarations(section)
                except InputError as error:
                    self.problems += error.problems
        if self.problems:
            raise InputError(*sorted(self.problems, key=lambda problem: problem.position))
        return pddl.Domain(self.source.place.file, self.types, self.constants, self.predicates, self.actions)

    def read_declarations(self, section: Node) -> None:
        """The requirements, the types, the constants or the predicates."""
        match section.head:
            case ":requirements":
                for node in section.items[1:]:
                    word = self.word(node, "a requirement such as `:typing`")
                    if word.text not in REQUIREMENTS:
                        known = expected_names(word.text, REQUIREMENTS)
                        self.report("pddl-unsupported", f"requirement `{word.text}` is not supported; {known}", word)
                    self.requirements.add(word.text)
            case ":types":
                self.need(section, "`:types`", ":typing")
                declared = self.typed_list(section.items[1:], "a type")
                where = {word.text: word for word, _ in declared}
                for word, parent in declared:
                    if word.text in self.types or word.text == pddl.OBJECT:
                        self.report("pddl-duplicate", f"type `{word.text}` is declared twice", word)
                    else:
                        self.types[word.text] = parent
                for name in self.types:
                    chain = [name]
                    while chain[-1] in self.types and len(chain) <= len(self.types):
                        chain.append(self.types[chain[-1]])
                        if chain[-1] == name:
                            cycle = " - ".join(f"`{link}`" for link in chain)
                            message = f"type `{name}` is above itself: {cycle}"
                            raise self.failure(message, where[name], "pddl-cyclic-types")
            case ":constants":
                for word, type_name in self.typed_list(section.items[1:], "a constant"):
                    if word.text in self.constants:
                        self.report("pddl-duplicate", f"constant `{word.text}` is declared twice", word)
                    self.constants[word.text] = type_name
            case ":predicates":
                for node in section.items[1:]:
                    if not node.items:
                        raise self.failure("expected a predicate such as `(hold ?object - movable)`", node)
                    word = self.word(node.items[0], "a predicate's name", name=True)
                    if word.text in _CONNECTIVES:
                        self.report("pddl-syntax", f"`{word.text}` cannot be the name of a predicate", word)
                    if word.text in self.predicates:
                        self.report("pddl-duplicate", f"predicate `{word.text}` is declared twice", word)
                    self.predicates[word.text] = pddl.Signature(word.text, self.parameters(node.items[1:], {}))

    def read_action(self, section: Node) -> None:
        if len(section.items) < 2:
            raise self.failure("expected `(:action NAME :parameters (...) :precondition (...) :effect (...))`", section)
        name = self.word(section.items[1], "an action's name", name=True)
        if name.text in self.actions:
            self.report("pddl-duplicate", f"action `{name.text}` is defined twice", name)
        # The lists of an action by their keys, those that it must have among them.
        nodes = section.items[2:]
        parts: dict[str, Node] = {}
        for key_node, value in zip(nodes[::2], [*nodes[1::2], None], strict=False):
            key = self.word(key_node, expected_names("", _ACTION_KEYS))
            if key.text not in _ACTION_KEYS:
                message = f"unknown key `{key.text}` of an action; {expected_names(key.text, _ACTION_KEYS)}"
                raise self.failure(message, key)
            if value is None or value.text:
                raise self.failure(f"expected a list in parentheses after `{key.text}`", value or key)
            if key.text in parts:
                self.report("pddl-duplicate", f"a second `{key.text}` of action `{name.text}`", key)
            parts[key.text] = value
        for required in (":parameters", ":effect"):
            if required not in parts:
                raise self.failure(f"action `{name.text}` has no `{required}`", name)
        scope: Scope = {}
        parameters = self.parameters(parts[":parameters"].items, scope)
        precondition: pddl.Condition = pddl.Compound("and")
        if ":precondition" in parts and parts[":precondition"].items:
            precondition = self.condition(parts[":precondition"], scope)
        effect, adds, deletes = parts[":effect"], dict[pddl.Holds, None](), dict[pddl.Holds, None]()
        for part in effect.items[1:] if effect.head == "and" else (effect,) if effect.items else ():
            if not part.items:
                raise self.failure("expected an effect such as `(hold ?object)`", part)
            if part.head in ("when", "forall"):
                expected = "expected predicates or their negation"
                message = f"conditional effects (`{part.head}`) are not supported; {expected}"
                raise self.failure(message, part, "pddl-unsupported")
            if part.head in ("and", "or", "imply", "exists", "="):
                raise self.failure(f"`{part.head}` cannot be an effect; expected predicates or `not`", part)
            changed, opposite = (deletes, adds) if part.head == "not" else (adds, deletes)
            (use,) = self.exactly(1, part) if part.head == "not" else (part,)
            if not use.items or use.head in _CONNECTIVES:
                raise self.failure("expected a predicate after `not` in an effect", use)
            change = self.holds(use, scope)
            if change in opposite:
                self.report("pddl-contradictory-effect", f"the effect makes `{change}` both true and false", part)
            changed[change] = None
        self.actions[name.text] = pddl.Action(
            name=name.text,
            parameters=parameters,
            precondition=precondition,
            adds=tuple(adds),
            deletes=tuple(deletes),
            place=self.source.place_at(name.offset),
        )

    def parameters(self, nodes: Sequence[Node], scope: Scope) -> tuple[pddl.Parameter, ...]:
        """Reads a typed list of variables and adds them to the scope."""
        found = []
        for word, type_name in self.typed_list(nodes, VARIABLE):
            name = word.text.removeprefix("?")
            if name in scope:
                self.report("pddl-duplicate", f"variable `{word.text}` is declared twice", word)
            scope[name] = type_name
            found.append(pddl.Parameter(name, scope[name]))
        return tuple(found)

    def typed_list(self, nodes: Sequence[Node], what: str) -> list[tuple[Node, str]]:
        """Words with their types in a list such as `a b - t c`; what: their kind, which decides their syntax."""
        found: list[tuple[Node, Node | None]] = []
        untyped: list[Node] = []
        remaining = iter(nodes)
        for node in remaining:
            if node.text != "-":
                untyped.append(self.word(node, what, name=True))
                continue
            type_node = next(remaining, node)
            if type_node.head == "either":
                raise self.failure("`either` is not supported; expected one type", type_node, "pddl-unsupported")
            if not untyped or type_node is node:
                raise self.failure(f"expected {what} before `-` and a type after it", node)
            self.need(node, "`- type`", ":typing")
            found += [(word, self.word(type_node, "a type", name=True)) for word in untyped]
            untyped = []
        found += [(word, None) for word in untyped]
        known = [*(word.text for word, _ in found if what == "a type"), *self.types, pddl.OBJECT]
        for type_word in (one for _, one in found if one is not None and one.text not in known):
            self.unknown("pddl-unknown-type", type_word, known)
        return [(word, pddl.OBJECT if type_word is None else type_word.text) for word, type_word in found]

    def condition(self, node: Node, scope: Scope) -> pddl.Condition:
        if not node.items:
            raise self.failure("expected a condition such as `(hold ?object)`", node)
        arguments = node.items[1:]
        match node.head:
            case "and" | "or" as kind:
                if kind == "or":
                    self.need(node, "`or`", ":disjunctive-preconditions")
                return pddl.Compound(kind, tuple(self.condition(part, scope) for part in arguments))
            case "imply":
                self.need(node, "`imply`", ":disjunctive-preconditions")
                premise, conclusion = (self.condition(part, scope) for part in self.exactly(2, node))
                return pddl.Compound("or", (pddl.Compound("not", (premise,)), conclusion))
            case "not":
                (part,) = self.exactly(1, node)
                negated = self.condition(part, scope)
                if isinstance(negated, pddl.Holds):
                    self.need(node, "`not` in a precondition", ":negative-preconditions", ":disjunctive-preconditions")
                else:
                    self.need(node, "`not` of more than a predicate", ":disjunctive-preconditions")
                return pddl.Compound("not", (negated,))
            case "forall" | "exists" as kind:
                own = ":universal-preconditions" if kind == "forall" else ":existential-preconditions"
                self.need(node, f"`{kind}`", own, ":quantified-preconditions")
                variable_list, body = self.exactly(2, node)
                if variable_list.text:
                    raise self.failure(f"expected a list of variables after `{kind}`", variable_list)
                inner = dict(scope)
                variables = self.parameters(variable_list.items, inner)
                return pddl.Compound(kind, (self.condition(body, inner),), variables)
            case "=":
                self.need(node, "`=`", ":equality")
                return pddl.Holds(pddl.EQUAL, tuple(self.term(one, scope)[0] for one in self.exactly(2, node)))
        return self.holds(node, scope)

    def holds(self, node: Node, scope: Scope) -> pddl.Holds:
        word = self.word(node.items[0], "a predicate's name")
        if word.text in _NUMERIC:
            raise self.failure(f"numbers (`{word.text}`) are not supported", node, "pddl-unsupported")
        if word.text == "when":
            raise self.failure("`when` cannot be part of a condition", node)
        terms = [self.term(item, scope) for item in node.items[1:]]
        signature = self.predicates.get(word.text)
        if signature is None:
            self.unknown("pddl-unknown-predicate", word, self.predicates)
        elif mismatch := signature.mismatch(terms):
            self.report("pddl-arity", mismatch, node)
        else:
            declared = {*self.types, pddl.OBJECT}
            for item, (term, found), parameter in zip(node.items[1:], terms, signature.parameters, strict=True):
                above = found if found in declared and parameter.type in declared else parameter.type
                while above != parameter.type and above in self.types:
                    above = self.types[above]
                if parameter.type not in (above, pddl.OBJECT):
                    message = f"`{term}` is of type `{found}`, but `{word.text}` expects `{parameter.type}`"
                    self.report("pddl-type", message, item)
        return pddl.Holds(word.text, tuple(term for term, _ in terms))

    def term(self, node: Node, scope: Scope) -> tuple[str, str | None]:
        """A term with its type; None of an unknown name."""
        word, variables = self.word(node, "a variable or a constant"), {f"?{name}": scope[name] for name in scope}
        if word.text.startswith("?"):
            if word.text not in variables:
                self.unknown("pddl-unknown-variable", word, variables)
        elif word.text not in self.constants:
            self.unknown("pddl-unknown-constant", word, [*self.constants, *variables])
        return word.text, (variables | self.constants).get(word.text)

    def need(self, node: Node, what: str, *requirements: str) -> None:
        """Records a problem, once per requirement, unless one of the requirements is declared."""
        if self.requirements.isdisjoint(requirements):
            mend = f"add `{requirements[0]}` to `(:requirements ...)`"
            message = f"{what} needs the requirement `{requirements[0]}`, which is not declared"
            self.report("pddl-undeclared-requirement", message, node, mend)
            self.requirements.add(requirements[0])

    def exactly(self, count: int, node: Node) -> tuple[Node, ...]:
        arguments = node.items[1:]
        if len(arguments) != count:
            found = f"{len(arguments)} argument{'s' * (len(arguments) != 1)}"
            raise self.failure(f"`{node.head}` has {found}; expected {count}", node)
        return arguments

    def word(self, node: Node, what: str, *, name: bool = False) -> Node:
        """A word; name: whether it has to be a name, with a question mark before it if `what` is a variable."""
        if not node.text:
            raise self.failure(f"expected {what}, found a list", node)
        mark = "?" if what == VARIABLE else ""
        if name and not (node.text.startswith(mark) and _NAME.fullmatch(node.text[len(mark) :])):
            missing = f"; is a `)` missing before `({node.text}`?" if node.text in _SECTIONS else ""
            raise self.failure(f"expected {what}, found `{node.text}`{missing}", node)
        return node


@lru_cache(maxsize=64)
def _read(text: str) -> tuple[Node, int]:
    """The list that a text is with its levels of lists, or as a word what is wrong with its parentheses and where.

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
            return suspect or Node(offset, message), 0
        if part == "(":
            open_lists.append(([], offset))
            depth = max(depth, len(open_lists))
        elif not open_lists:
            return suspect or Node(offset, f"expected `(define (domain ...`, found `{part}`"), 0
        elif part == ")":
            items, start = open_lists.pop()
            ended = Node(start, items=tuple(items), head=items[0].text if items else "")
            if open_lists:
                open_lists[-1][0].append(ended)
            else:
                whole = ended
        else:
            if suspect is None and before == "(" and part.startswith(":") and len(open_lists) > 2:
                line = text.count("\n", 0, open_lists[-2][1]) + 1
                message = f"`{part}` begins inside the list that line {line} opens; is a `)` missing before it?"
                suspect = Node(open_lists[-1][1], message)
            open_lists[-1][0].append(Node(offset, part.lower()))
        before = part
    if whole is not None:
        return whole, depth
    if not open_lists:
        return Node(0, "the file is empty; expected `(define (domain ...`"), 0
    return suspect or Node(open_lists[-1][1], "this parenthesis is never closed"), 0

"""The names in a formula: checking them against a skill, and binding them to objects.

A predicate's arguments may be left out if the skill's action uses the predicate with only one list of arguments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from sqrp_cli.errors import Problem, expected_names
from sqrp_cli.logic import domain as pddl
from sqrp_cli.logic import formula as mtl
from sqrp_cli.logic.source_text import TextOrigin

ArgumentLists = Mapping[str, tuple[tuple[str, ...], ...]]
"""For each predicate in an action, its different lists of arguments: names of parameters and constants, and `?name` for
the variable of a quantifier."""


def argument_lists(action: pddl.Action) -> ArgumentLists:
    """The predicates of the action's precondition and effect with their arguments."""
    parameters = {parameter.name for parameter in action.parameters}
    lists: dict[str, dict[tuple[str, ...], None]] = {}
    conditions = (use for use in pddl.nested(action.precondition) if isinstance(use, pddl.Holds))
    for use in (*conditions, *action.effect.adds, *action.effect.deletes):
        arguments = tuple(
            term.name if isinstance(term, pddl.Constant) or term.name in parameters else str(term) for term in use.terms
        )
        lists.setdefault(use.predicate, {})[arguments] = None
    return {predicate: tuple(found) for predicate, found in lists.items()}


def check_formula(
    formula: mtl.Formula, domain: pddl.Domain, action: pddl.Action, primitives: Sequence[str]
) -> Iterator[Problem]:
    """Problems with the names and intervals of a skill's formula.

    primitives: names of the skill's primitive actions, in order of execution.
    """
    if isinstance(formula, mtl.Predicate):
        for code, message in _check_predicate(formula, domain, action):
            yield _problem(formula.origin, code, message)
    if isinstance(formula, mtl.Temporal):
        yield from _check_interval(formula.interval, primitives)
    for part in mtl.children(formula):
        yield from check_formula(part, domain, action, primitives)


def bind(formula: mtl.Formula, binding: Mapping[str, str], lists: ArgumentLists) -> mtl.Formula:
    """The formula about objects: left-out arguments filled in, and parameters replaced by their objects.

    binding: object name by parameter name; names that are not in it (constants, objects) stay. lists: of the skill's
    action, see `argument_lists`. Raises ValueError for arguments that cannot be filled in; `check_formula` reports such
    formulas to the user.
    """
    if not isinstance(formula, mtl.Predicate):
        return mtl.with_children(formula, tuple(bind(part, binding, lists) for part in mtl.children(formula)))
    arguments = formula.arguments
    if arguments is None:
        if len(lists.get(formula.name, ())) != 1:
            raise ValueError(f"the arguments of `{formula.name}` cannot be left out")
        arguments = lists[formula.name][0]
    return mtl.Predicate(formula.name, tuple(binding.get(name, name) for name in arguments), formula.origin)


def _problem(origin: TextOrigin | None, code: str, message: str) -> Problem:
    return origin.problem(code, message) if origin else Problem(code, message)


def _check_predicate(use: mtl.Predicate, domain: pddl.Domain, action: pddl.Action) -> Iterator[tuple[str, str]]:
    """Codes and messages of what is wrong with a predicate's name and arguments."""
    lists = argument_lists(action)
    if use.name not in lists:
        known = expected_names(use.name, lists)
        yield "mtl-unknown-predicate", f"action `{action.name}` does not use a predicate `{use.name}`; {known}"
    elif use.arguments is None:
        if len(lists[use.name]) > 1 or any(name.startswith("?") for name in lists[use.name][0]):
            uses = ", ".join(f"{use.name}({', '.join(names)})" for names in lists[use.name])
            reason = f"because action `{action.name}` uses it as {uses}"
            yield "mtl-missing-arguments", f"the arguments of `{use.name}` must be given, {reason}"
    elif mismatch := domain.predicates[use.name].mismatch(use.arguments):
        yield "mtl-arity", mismatch
    else:
        types = dict(domain.constants) | {parameter.name: parameter.type for parameter in action.parameters}
        for name, expected in zip(use.arguments, domain.predicates[use.name].parameters, strict=True):
            if name not in types:
                known = expected_names(name, types)
                yield "mtl-unknown-argument", f"`{name}` is no parameter of `{action.name}` and no constant; {known}"
            elif not domain.fits([types[name]], expected.type):
                yield "mtl-type", f"`{name}` is of type `{types[name]}`, but `{use.name}` expects `{expected.type}`"


def _check_interval(interval: mtl.Interval, primitives: Sequence[str]) -> Iterator[Problem]:
    """Unknown primitives, and an interval that ends before it starts whatever the durations of the primitives."""
    start, end = interval.start, interval.end
    unknown = [bound for bound in (start, end) if bound.primitive is not None and bound.primitive not in primitives]
    for bound in unknown:
        known = expected_names(str(bound.primitive), primitives)
        yield _problem(
            bound.origin, "mtl-unknown-primitive", f"there is no primitive action `{bound.primitive}`; {known}"
        )
    if unknown or (start.primitive is None) != (end.primitive is None):
        return
    begun, ended = (primitives.index(b.primitive) + (b.edge == "end") if b.primitive else 0 for b in (start, end))
    if (begun == ended and start.offset > end.offset) or (begun > ended and start.offset >= end.offset):
        yield _problem(start.origin, "mtl-empty-interval", f"the interval {interval} ends before it starts")

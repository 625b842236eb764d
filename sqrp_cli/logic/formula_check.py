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
        lists = argument_lists(action)
        if formula.name not in lists:
            message = f"action `{action.name}` does not use a predicate `{formula.name}`; {expected_names(formula.name, lists)}"
            yield _problem(formula.origin, "mtl-unknown-predicate", message)
        elif formula.arguments is None:
            known = lists[formula.name]
            if len(known) > 1 or any(name.startswith("?") for name in known[0]):
                uses = ", ".join(f"{formula.name}({', '.join(names)})" for names in known)
                message = (
                    f"the arguments of `{formula.name}` must be given, because action `{action.name}` uses it as {uses}"
                )
                yield _problem(formula.origin, "mtl-missing-arguments", message)
        elif mismatch := domain.predicates[formula.name].mismatch(formula.arguments):
            yield _problem(formula.origin, "mtl-arity", mismatch)
        else:
            yield from _check_arguments(formula, formula.arguments, domain, action)
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


def _check_arguments(
    use: mtl.Predicate, arguments: Sequence[str], domain: pddl.Domain, action: pddl.Action
) -> Iterator[Problem]:
    types = dict(domain.constants) | {parameter.name: parameter.type for parameter in action.parameters}
    for name, expected in zip(arguments, domain.predicates[use.name].parameters, strict=True):
        if name not in types:
            message = f"`{name}` is no parameter of `{action.name}` and no constant; {expected_names(name, types)}"
            yield _problem(use.origin, "mtl-unknown-argument", message)
        elif not domain.fits([types[name]], expected.type):
            message = f"`{name}` is of type `{types[name]}`, but `{use.name}` expects `{expected.type}`"
            yield _problem(use.origin, "mtl-type", message)


def _check_interval(interval: mtl.Interval, primitives: Sequence[str]) -> Iterator[Problem]:
    bounds = (interval.start, interval.end)
    unknown = [bound for bound in bounds if bound.primitive is not None and bound.primitive not in primitives]
    for bound in unknown:
        known = expected_names(str(bound.primitive), primitives)
        yield _problem(
            bound.origin, "mtl-unknown-primitive", f"there is no primitive action `{bound.primitive}`; {known}"
        )
    if not unknown and _surely_empty(interval, primitives):
        yield _problem(interval.start.origin, "mtl-empty-interval", f"the interval {interval} ends before it starts")


def _surely_empty(interval: mtl.Interval, primitives: Sequence[str]) -> bool:
    """Whether the interval ends before it starts, whatever the durations of the primitive actions."""
    start, end = interval.start, interval.end
    if start.primitive is None or end.primitive is None:
        return start.primitive is end.primitive and start.offset > end.offset
    start_position, end_position = (primitives.index(str(b.primitive)) + (b.edge == "end") for b in (start, end))
    if start_position == end_position:
        return start.offset > end.offset
    return start_position > end_position and start.offset >= end.offset

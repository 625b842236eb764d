"""PDDL: everything that other packages need of it."""

from __future__ import annotations

from sqrp_cli.logic.conditions import (
    Binding,
    Failure,
    Objects,
    UnmetCondition,
    apply_effect,
    failing_literals,
    failures,
)
from sqrp_cli.logic.domain import (
    Action,
    Condition,
    Conjunction,
    Constant,
    Disjunction,
    Domain,
    Effect,
    Equal,
    Exists,
    ForAll,
    Holds,
    Negation,
    Parameter,
    Signature,
    Term,
    Variable,
    merge_domains,
)
from sqrp_cli.logic.pddl_parser import parse_domain

__all__ = [
    "Action",
    "Binding",
    "Condition",
    "Conjunction",
    "Constant",
    "Disjunction",
    "Domain",
    "Effect",
    "Equal",
    "Exists",
    "Failure",
    "ForAll",
    "Holds",
    "Negation",
    "Objects",
    "Parameter",
    "Signature",
    "Term",
    "UnmetCondition",
    "Variable",
    "apply_effect",
    "failing_literals",
    "failures",
    "merge_domains",
    "parse_domain",
]

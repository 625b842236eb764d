"""Metric Temporal Logic: everything that other packages need of the language.

Grammar, from the loosest to the tightest binding; `and` and `or` join any number of formulas, `->` groups to the right:

    formula     = formula -> formula  |  formula or formula  |  formula and formula
                | not formula  |  always[instant, instant] formula  |  eventually[instant, instant] formula
                | predicate  |  predicate(name, ...)  |  (formula)
    instant     = primitive.start  |  primitive.end  |  either of them + seconds or - seconds  |  seconds

Other spellings: `G` `F` `□` `◇` for the temporal operators, `!` `¬`, `&` `∧`, `|` `∨`, `→`.
"""

from __future__ import annotations

from sqrp_cli.logic.formula import (
    Always,
    And,
    Eventually,
    Formula,
    Implies,
    Instant,
    Interval,
    Not,
    Or,
    Predicate,
    children,
    to_unicode,
)
from sqrp_cli.logic.formula_check import ArgumentLists, argument_lists, bind, check_formula
from sqrp_cli.logic.formula_time import (
    GroundOperator,
    Stretch,
    events_of_interest,
    formula_time,
    ground_operators,
    merge,
    operators,
    operators_outside,
    union_length,
    with_times,
)
from sqrp_cli.logic.mtl_parser import parse_formula

__all__ = [
    "Always",
    "And",
    "ArgumentLists",
    "Eventually",
    "Formula",
    "GroundOperator",
    "Implies",
    "Instant",
    "Interval",
    "Not",
    "Or",
    "Predicate",
    "Stretch",
    "argument_lists",
    "bind",
    "check_formula",
    "children",
    "events_of_interest",
    "formula_time",
    "ground_operators",
    "merge",
    "operators",
    "operators_outside",
    "parse_formula",
    "to_unicode",
    "union_length",
    "with_times",
]

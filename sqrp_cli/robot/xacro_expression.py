"""The Python expressions of xacro files, `${...}` and `$(eval ...)`, of which only harmless ones are evaluated.

Allowed are arithmetic, comparisons, conditions, lists, comprehensions, and calls of what xacro offers. An attribute is
an entry of a dictionary or one of the methods below; of no object can another attribute be read, by which all of Python
could be reached. Work and memory are bounded by the process in which this runs.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from typing import Any

from sqrp_cli.errors import expected_names

MAX_TEXT = 1_000_000  # most characters of a value

_NODES = (
    ast.Expression, ast.Constant, ast.Name, ast.expr_context, ast.BinOp, ast.operator, ast.UnaryOp, ast.unaryop,
    ast.BoolOp, ast.boolop, ast.Compare, ast.cmpop, ast.IfExp, ast.Call, ast.keyword, ast.List, ast.Tuple, ast.Dict,
    ast.Subscript, ast.Slice, ast.Starred, ast.Attribute, ast.ListComp, ast.GeneratorExp, ast.comprehension,
)  # fmt: skip

_METHODS: dict[type, frozenset[str]] = {
    str: frozenset({
        "capitalize", "count", "endswith", "find", "format", "index", "isalpha", "isdigit", "islower", "isnumeric",
        "isupper", "join", "lower", "lstrip", "replace", "rfind", "rsplit", "rstrip", "split", "splitlines",
        "startswith", "strip", "title", "upper",
    }),
    dict: frozenset({"get", "items", "keys", "values"}),
    list: frozenset({"count", "index"}),
    tuple: frozenset({"count", "index"}),
}  # fmt: skip
"""Methods that change nothing; of subclasses, too."""
_REACHING = re.compile(r"__|\{[^{}:!]*[.\[]")  # in a format: an attribute or entry of a value
_GUARD = "attribute of"  # what reads attributes in a compiled expression; no expression can be written with this name
UNOFFERED = ("complex", "hash", "issubclass", "slice", "type", "vars")
"""Functions of xacro by which Python itself could be reached, or that no description needs."""


def evaluate(expression: str, names: Any, _locals: None = None) -> Any:  # noqa: ANN401 - xacro's tables of names
    """The value of an expression; stands in for xacro's `safe_eval`.

    Raises ValueError for an expression that is wrong or asks for more than this module does, and what Python raises for
    a wrong operation.
    """
    try:
        tree = ast.parse(expression.strip(), mode="eval")
    except (SyntaxError, ValueError) as error:
        raise ValueError("not an expression") from error
    for node in ast.walk(tree):
        if not isinstance(node, _NODES) or (isinstance(node, ast.Name) and node.id.startswith("_")):
            shown = ast.unparse(node)[:60] if isinstance(node, ast.expr) else type(node).__name__
            raise ValueError(f"`{shown}` is Python that is not evaluated here")
    # Attributes are read by a call of `_attribute`.
    guard = ast.NodeTransformer()
    guard.visit_Attribute = lambda node: ast.Call(  # type: ignore[method-assign]
        ast.Name(_GUARD, ast.Load()), [guard.visit(node.value), ast.Constant(node.attr)], []
    )
    code = compile(ast.fix_missing_locations(guard.visit(tree)), "<expression>", "eval")
    dict.update(names, {"__builtins__": {_GUARD: _attribute}})
    try:
        value = eval(code, names)  # noqa: S307 - only what is listed above
    except NameError as error:
        known, scope = set[str](), names
        while scope is not None:
            known |= {name for name in scope if name.isidentifier() and name != "__builtins__"}
            scope = getattr(scope, "parent", None)
        message = f"`{error.name}` is not defined; {expected_names(str(error.name), known)}"
        raise ValueError(message) from error
    if isinstance(value, str) and len(value) > MAX_TEXT:
        raise ValueError(f"a text of more than {MAX_TEXT:,} characters")
    return value


def _attribute(owner: object, name: str) -> Any:  # noqa: ANN401
    for kind, methods in _METHODS.items():
        if isinstance(owner, kind) and name in methods and not (isinstance(owner, Mapping) and name in owner):
            if name == "format" and _REACHING.search(str(owner)):
                raise ValueError(f"the format `{str(owner)[:60]}` is not evaluated here")
            return getattr(kind, name).__get__(owner)  # of `kind`, whatever a subclass says
    if isinstance(owner, Mapping) and name in owner:
        return owner[name]
    if isinstance(owner, Mapping):
        raise ValueError(f"`{name}` is not defined there; {expected_names(name, map(str, owner))}")
    raise ValueError(f"`.{name}` of a {type(owner).__name__} is not evaluated here")

"""The Python expressions of xacro files, `${...}` and `$(eval ...)`, evaluated without Python.

Only what is listed here is done: arithmetic, comparisons, conditions, lists, comprehensions, and calls of given
functions and of harmless methods. Nothing else can be reached from an expression: no attribute of an object, no module,
no file, no command. Sizes of all values are bounded, and so is the number of steps.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import yaml

from sqrp_cli.errors import expected_names

MAX_STEPS = 200_000
"""Most steps of all expressions of a file, those of included files too."""

MAX_TEXT = 100_000
"""Most characters and items of a value."""

MAX_BITS = 2048
"""Most bits of a whole number."""

MAX_EXPRESSION = 10_000
"""Most characters of an expression."""

Function = Callable[..., Any]

_BINARY: dict[type[ast.operator], Function] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod, ast.Pow: operator.pow,
}  # fmt: skip

_UNARY: dict[type[ast.unaryop], Function] = {
    ast.UAdd: operator.pos, ast.USub: operator.neg, ast.Not: operator.not_,
}  # fmt: skip

_COMPARE: dict[type[ast.cmpop], Function] = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt,
    ast.GtE: operator.ge, ast.Is: operator.is_, ast.IsNot: operator.is_not,
    ast.In: lambda one, all_of: one in all_of, ast.NotIn: lambda one, all_of: one not in all_of,
}  # fmt: skip

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

_GROWING = frozenset({"format", "join", "replace"})
"""Methods whose result may be as long as the product of what goes in."""

_WILD_FORMAT = re.compile(r"__|\*|\d{4}|\{[^{}]*\{|\.[A-Za-z_]")
"""In a format: attributes, and widths that are huge or taken from a value."""


class RefusedExpressionError(ValueError):
    """An expression that is wrong, or that asks for more than this module does."""


class Functions(dict[str, Any]):
    """A namespace of functions and constants, such as `math`."""


def _range(*bounds: int) -> list[int]:
    numbers = range(*bounds)
    if len(numbers) > MAX_TEXT:
        raise RefusedExpressionError(f"a range of {len(numbers):,} numbers, expected at most {MAX_TEXT:,}")
    return list(numbers)


_MATH = Functions({name: value for name, value in vars(math).items() if not name.startswith("_")})
for _costly in ("factorial", "comb", "perm", "prod", "pow", "ldexp", "lcm", "isqrt"):
    _MATH.pop(_costly, None)
_MATH["pow"] = lambda base, exponent: float(base) ** float(exponent)

_PYTHON = Functions(
    list=list, dict=dict, len=len, str=str, float=float, int=int, bool=bool, min=min, max=max, round=round, abs=abs,
    all=all, any=any, sum=sum, tuple=tuple, range=_range, isinstance=isinstance, divmod=divmod, ord=ord, repr=repr,
    sorted=sorted, reversed=lambda items: [*reversed(items)],
    enumerate=lambda items, start=0: [*enumerate(items, start)],
    zip=lambda *items: [*zip(*items, strict=False)],
    map=lambda function, *items: [*map(function, *items)],
    filter=lambda function, items: [*filter(function, items)],
)  # fmt: skip

GLOBALS: Mapping[str, Any] = {**_PYTHON, **_MATH, "math": _MATH, "python": _PYTHON}
"""What every expression may use; xacro's list, without what could reach Python itself."""


class Evaluator:
    """Evaluates the expressions of one file. `functions`: those that may be called besides `GLOBALS`."""

    def __init__(self, *functions: Function) -> None:
        self._functions = {id(function) for function in (*_PYTHON.values(), *_MATH.values(), *functions)}
        self._steps = 0

    def value(self, expression: str, names: Mapping[str, Any]) -> Any:  # noqa: ANN401 - an expression gives anything
        """The value of an expression. Raises RefusedExpressionError, or what Python raises for a wrong operation."""
        if len(expression) > MAX_EXPRESSION:
            raise RefusedExpressionError(f"an expression of {len(expression):,} characters")
        try:
            tree = ast.parse(expression.strip(), mode="eval")
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise RefusedExpressionError("not an expression") from error
        return self._of(tree.body, names)

    def _of(self, node: ast.expr, names: Mapping[str, Any]) -> Any:  # noqa: ANN401
        self._steps += 1
        if self._steps > MAX_STEPS:
            raise RefusedExpressionError(f"more than {MAX_STEPS:,} steps of expressions")
        return bounded(self._computed(node, names))

    def _computed(self, node: ast.expr, names: Mapping[str, Any]) -> Any:  # noqa: ANN401
        def of(child: ast.expr) -> Any:  # noqa: ANN401
            return self._of(child, names)

        match node:
            case ast.Constant(value=bool() | int() | float() | str() | None as value):
                return value
            case ast.Name(id=name):
                return _named(name, names)
            case ast.BinOp(left, kind, right) if type(kind) in _BINARY:
                return _operated(_BINARY[type(kind)], of(left), of(right))
            case ast.UnaryOp(kind, operand) if type(kind) in _UNARY:
                return _UNARY[type(kind)](of(operand))
            case ast.BoolOp(kind, values):
                return self._joined(isinstance(kind, ast.And), values, names)
            case ast.Compare(left, kinds, others):
                return self._compared(of(left), kinds, others, names)
            case ast.IfExp(test, body, otherwise):
                return of(body) if of(test) else of(otherwise)
            case ast.Call(function, arguments, keywords):
                return self._called(function, arguments, keywords, names)
        return self._composed(node, names)

    def _composed(self, node: ast.expr, names: Mapping[str, Any]) -> Any:  # noqa: ANN401
        """The value of a list, or of something in one."""

        def of(child: ast.expr | None) -> Any:  # noqa: ANN401
            return None if child is None else self._of(child, names)

        match node:
            case ast.List(items):
                return [*self._items(items, names)]
            case ast.Tuple(items):
                return (*self._items(items, names),)
            case ast.Subscript(value, ast.Slice(lower, upper, step)):
                return of(value)[slice(of(lower), of(upper), of(step))]
            case ast.Subscript(value, index):
                return _item(of(value), of(index))
            case ast.Attribute(value, attr):
                return _attribute(of(value), attr)
            case ast.ListComp(element, loops) | ast.GeneratorExp(element, loops):
                return [self._of(element, inner) for inner in self._looped(loops, names)]
        raise RefusedExpressionError(f"`{ast.unparse(node)[:60]}` is Python that is not evaluated here")

    def _items(self, nodes: list[ast.expr], names: Mapping[str, Any]) -> Iterator[Any]:
        for node in nodes:
            if isinstance(node, ast.Starred):
                yield from self._of(node.value, names)
            else:
                yield self._of(node, names)

    def _joined(self, both: bool, nodes: list[ast.expr], names: Mapping[str, Any]) -> Any:  # noqa: ANN401
        value = None
        for node in nodes:
            value = self._of(node, names)
            if bool(value) != both:
                break
        return value

    def _compared(
        self, value: object, kinds: list[ast.cmpop], others: list[ast.expr], names: Mapping[str, Any]
    ) -> bool:
        for kind, node in zip(kinds, others, strict=True):
            other = self._of(node, names)
            if not _COMPARE[type(kind)](value, other):
                return False
            value = other
        return True

    def _called(
        self, function: ast.expr, arguments: list[ast.expr], keywords: list[ast.keyword], names: Mapping[str, Any]
    ) -> Any:  # noqa: ANN401
        callee = self._callee(function, names)
        values = [*self._items(arguments, names)]
        named = {word.arg: self._of(word.value, names) for word in keywords if word.arg is not None}
        if len(named) < len(keywords):
            raise RefusedExpressionError("`**` in a call is not evaluated here")
        if any(callable(value) and id(value) not in self._functions for value in (*values, *named.values())):
            raise RefusedExpressionError("only functions that xacro offers can be handed on")
        owner, method = getattr(callee, "__self__", None), getattr(callee, "__name__", "")
        if isinstance(owner, str) and method in _GROWING:
            _check_growth(method, owner, [*values, *named.values()])
        return callee(*values, **named)

    def _callee(self, node: ast.expr, names: Mapping[str, Any]) -> Function:
        if isinstance(node, ast.Attribute):
            owner = self._of(node.value, names)
            kind = next((kind for kind in _METHODS if isinstance(owner, kind)), None)
            if kind is not None and node.attr in _METHODS[kind] and not isinstance(owner, Functions):
                method: Function = getattr(kind, node.attr).__get__(owner)  # of `kind`, whatever a subclass says
                return method
            callee = _attribute(owner, node.attr)
        else:
            callee = self._of(node, names)
        if id(callee) not in self._functions:
            raise RefusedExpressionError(f"`{ast.unparse(node)[:60]}` is no function that xacro offers")
        function: Function = callee
        return function

    def _looped(self, loops: list[ast.comprehension], names: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
        if not loops:
            yield names
            return
        loop, *rest = loops
        for item in self._of(loop.iter, names):
            inner: Mapping[str, Any] = ChainMap(dict(_bound(loop.target, item)), names)  # type: ignore[arg-type]
            if all(self._of(condition, inner) for condition in loop.ifs):
                yield from self._looped(rest, inner)


def bounded(value: Any) -> Any:  # noqa: ANN401
    """The value, unchanged. Raises RefusedExpressionError if it is larger than any robot needs."""
    waiting, weight = [value], 0
    while waiting:
        item = waiting.pop()
        if isinstance(item, int) and item.bit_length() > MAX_BITS:
            raise RefusedExpressionError(f"a number of more than {MAX_BITS} bits")
        weight += 1 + (len(item) if isinstance(item, str) else 0)
        if weight > MAX_TEXT:
            raise RefusedExpressionError(f"a value of more than {MAX_TEXT:,} characters or items")
        if isinstance(item, dict) and not isinstance(item, Functions):
            waiting += [*item.keys(), *item.values()]
        elif isinstance(item, list | tuple):
            waiting += item
        if len(waiting) > MAX_TEXT:
            raise RefusedExpressionError(f"a value of more than {MAX_TEXT:,} items")
    return value


def _named(name: str, names: Mapping[str, Any]) -> Any:  # noqa: ANN401
    try:
        return names[name]
    except KeyError:
        raise RefusedExpressionError(f"`{name}` is not defined; {expected_names(name, _known(names))}") from None


def _known(names: Mapping[str, Any] | None) -> set[str]:
    """The names that a file itself defines, in this scope and those around it."""
    known: set[str] = set()
    while names is not None:
        known |= {name for name in names if name not in GLOBALS and not name.startswith("*")}
        names = getattr(names, "parent", None)
    return known


def _item(owner: Any, index: Any) -> Any:  # noqa: ANN401
    if isinstance(owner, Mapping) and index not in owner:
        return _attribute(owner, str(index))
    return owner[index]


def _attribute(owner: object, name: str) -> Any:  # noqa: ANN401
    """An entry of a dictionary or a namespace: no attribute of any object can be read."""
    if isinstance(owner, Mapping) and name in owner:
        return owner[name]
    if isinstance(owner, Mapping):
        raise RefusedExpressionError(f"`{name}` is not defined there; {expected_names(name, map(str, owner))}")
    raise RefusedExpressionError(f"`.{name}` of a {type(owner).__name__} is not evaluated here")


def _operated(operation: Function, left: Any, right: Any) -> Any:  # noqa: ANN401
    if operation is operator.mul and any(isinstance(side, str | list | tuple) for side in (left, right)):
        times, what = (left, right) if isinstance(left, int) else (right, left)
        if isinstance(times, int) and times * max(len(what), 1) > MAX_TEXT:
            raise RefusedExpressionError(f"a value of more than {MAX_TEXT:,} characters or items")
    whole = isinstance(left, int) and isinstance(right, int)
    if operation is operator.pow and whole and right * max(left.bit_length(), 1) > MAX_BITS:
        raise RefusedExpressionError(f"a number of more than {MAX_BITS} bits")
    if operation is operator.mod and isinstance(left, str):
        _check_growth("format", left, list(right) if isinstance(right, tuple) else [right])
    return operation(left, right)


def _check_growth(method: str, text: str, values: list[Any]) -> None:
    """Raises RefusedExpressionError if the result could be large, or if a format reaches into its values."""
    if method == "format" and _WILD_FORMAT.search(text):
        raise RefusedExpressionError(f"the format `{text[:60]}` is not evaluated here")
    most = max([len(str(value)) for value in values], default=0)
    if (len(text) + 1) * (most + 1) > 10 * MAX_TEXT:
        raise RefusedExpressionError(f"a value of more than {MAX_TEXT:,} characters")


def _bound(target: ast.expr, item: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    """The names that a loop gives its item to."""
    match target:
        case ast.Name(id=name):
            yield name, item
        case ast.Tuple(targets) | ast.List(targets):
            for part, value in zip(targets, item, strict=True):
                yield from _bound(part, value)
        case _:
            raise RefusedExpressionError(f"`for {ast.unparse(target)[:60]}` is not evaluated here")


UNITS = {"radians": 1.0, "degrees": 3.141592653589793 / 180, "meters": 1.0, "millimeters": 1e-3, "foot": 0.3048,
          "inches": 0.0254}  # fmt: skip
"""Tags of numbers in the YAML files of xacro."""


def unit_loader(evaluator: Evaluator) -> type[yaml.SafeLoader]:
    """A loader that knows the tags of units."""

    class Loader(yaml.SafeLoader):
        pass

    for unit, factor in UNITS.items():

        def convert(loader: yaml.SafeLoader, node: yaml.ScalarNode, factor: float = factor) -> float:
            return float(evaluator.value(str(loader.construct_scalar(node)), GLOBALS)) * factor

        Loader.add_constructor(f"!{unit}", convert)
    return Loader

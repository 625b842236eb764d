"""Data classes that cost little to define: a constructor is compiled when its class is first used, not at import.

A command defines some 300 records, and most of the time of that goes into compiling the text of methods.
"""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Callable
from dataclasses import MISSING
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, eq=True, order=False, repr=True, kw_only=False):  # noqa: A002, ANN001, ANN201
        """As `dataclasses.dataclass`, for classes without slots and without fields that only the constructor takes."""
        if cls is None:
            return lambda one: dataclass(one, frozen=frozen, eq=eq, order=order, repr=repr, kw_only=kw_only)
        own = set(vars(cls))
        cls.__doc__ = cls.__doc__ or cls.__name__  # otherwise one would be made of its signature
        dataclasses.dataclass(cls, init=False, repr=False, eq=False, kw_only=kw_only)

        def __init__(self, *args, **named):  # noqa: ANN001, ANN002, ANN003, ANN202, N807
            cls.__init__ = made = _constructor(cls)
            made(self, *args, **named)

        methods = {"__init__": __init__}
        if repr:
            methods["__repr__"] = _repr
        names = [field.name for field in dataclasses.fields(cls) if field.compare]
        # A tuple in any case, because tuples are equal where their items are the same, such as NAN or arrays.
        several = operator.attrgetter(*names) if len(names) > 1 else None
        key = several or (lambda one: tuple(getattr(one, name) for name in names))
        compares = [operator.eq] if eq else []
        compares += [operator.lt, operator.le, operator.gt, operator.ge] if order else []
        for compare in compares:
            methods[f"__{compare.__name__}__"] = lambda one, other, compare=compare: (
                compare(key(one), key(other)) if other.__class__ is one.__class__ else NotImplemented
            )
        if eq:
            methods["__hash__"] = (lambda one: hash(key(one))) if frozen else None
            own -= {"__hash__"} if "__eq__" in own and cls.__hash__ is None else set()
        if frozen:
            methods |= {"__setattr__": _refuse, "__delattr__": _refuse}
        for name in methods.keys() - own:
            setattr(cls, name, methods[name])
        return cls


def _constructor(cls: type) -> Callable[..., None]:
    names: dict[str, Any] = {"_MISSING": MISSING}
    of_kind: dict[bool, list[str]] = {False: ["self"], True: ["*"]}
    body = [" _own = self.__dict__"]
    for field in dataclasses.fields(cls):
        name, value, default = field.name, field.name, ""
        if field.default is not MISSING:
            names[f"_{name}"], default = field.default, f"=_{name}"
        elif field.default_factory is not MISSING:
            names[f"_{name}"], default = field.default_factory, "=_MISSING"
            value = f"_{name}() if {name} is _MISSING else {name}" if field.init else f"_{name}()"
        if field.init:
            of_kind[bool(field.kw_only)].append(name + default)
        if field.init or field.default_factory is not MISSING:
            body.append(f" _own[{name!r}] = {value}")
    if hasattr(cls, "__post_init__"):
        body.append(" self.__post_init__()")
    arguments = [*of_kind[False], *(of_kind[True] if len(of_kind[True]) > 1 else [])]
    exec(f"def __init__({', '.join(arguments)}):\n" + "\n".join(body), names)  # noqa: S102 - of names of fields alone
    init: Callable[..., None] = names["__init__"]
    init.__qualname__ = f"{cls.__qualname__}.__init__"  # for messages
    return init


def _repr(self: object) -> str:
    parts = (f"{field.name}={getattr(self, field.name)!r}" for field in dataclasses.fields(self) if field.repr)  # type: ignore[arg-type]
    return f"{type(self).__qualname__}({', '.join(parts)})"


def _refuse(self: object, name: str, *_value: object) -> None:
    raise dataclasses.FrozenInstanceError(f"`{name}` of a {type(self).__name__} cannot be changed")

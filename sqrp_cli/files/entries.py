"""Values that several YAML files share, as Pydantic types: names, quantities, vectors, poses, files of robots."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from typing import Annotated, Any, LiteralString, TypeVar, cast

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainSerializer,
    StringConstraints,
    Tag,
    WithJsonSchema,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError
from pydantic_core.core_schema import (
    no_info_before_validator_function,
    no_info_wrap_validator_function,
    plain_serializer_function_ser_schema,
)

from sqrp_cli.errors import expected_names, first_names
from sqrp_cli.files import units
from sqrp_cli.files.source import describe
from sqrp_cli.geometry import Array, look_at, pose, quaternion_to_matrix, read_only, rpy_to_matrix, wrong_length
from sqrp_cli.records import dataclass

Made = TypeVar("Made")
_ONLY_ONE = "expected exactly one of the keys {}"


def _check_only_one(entry: object, *keys: str) -> None:
    """Raises PydanticCustomError unless exactly one of some keys of an entry is stated."""
    if sum(getattr(entry, key) not in (None, "", ()) for key in keys) != 1:
        raise refused("ambiguous-entry", _ONLY_ONE.format(first_names(keys)))


class Entry(BaseModel):
    """A mapping of a YAML file that accepts only the keys it declares."""

    # A validator is built when a file is read with it, and not for every entry within another one.
    model_config = ConfigDict(
        extra="forbid", frozen=True, populate_by_name=False, arbitrary_types_allowed=True, defer_build=True
    )
    check_only_one = _check_only_one

    @model_validator(mode="before")
    @classmethod
    def _only_declared_keys(cls, data: Any) -> Any:  # noqa: ANN401 - runs before validation
        keys = {field.alias or name: field.is_required() for name, field in cls.model_fields.items()}
        return _with_declared_keys(cls, keys, data)


class FileRecord:
    """A frozen dataclass that a file holds as a mapping of its fields, by their aliases, and no other keys.

    Pydantic checks a file by the annotations of the fields, and accepts an existing record unchanged. `FileRecord()`
    marks a field whose type is such a dataclass, but one that knows no files.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", arbitrary_types_allowed=True)
    check_only_one = _check_only_one

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:  # noqa: ANN401
        """Pydantic's schema of the dataclass `source`, behind a check of the keys."""
        schema: Any = {**handler.resolve_ref_schema(handler(source))}
        fields = schema["schema"]["fields"]
        keys = {part.get("validation_alias", part["name"]): part["schema"]["type"] != "default" for part in fields}
        check = partial(_with_declared_keys, source, keys)
        # Pydantic uses the schema with the reference where the record occurs again: it must include the check.
        return no_info_before_validator_function(check, schema, ref=schema.pop("ref"))


def from_fields(record: Callable[..., Made], *known: object, **found: object) -> Made:
    """A new record: each field from `found`, otherwise from the last of the known records that has it or tells it."""
    names = [field.name for field in fields(cast("Any", record)) if field.name not in found]
    told = ((name, getattr(other, name)) for other in known for name in names if hasattr(other, name))
    given = {name: value for name, value in told if not callable(value)}  # a method tells nothing
    return record(**given, **found)


@dataclass(frozen=True)
class SerializedAs:
    """Marks a field of a record that a file writes in another form, such as an array as nested lists.

    form: the type that Pydantic checks. read: from that form to the field, write: from the field to the form; None in
    files that only people write.
    """

    form: Any
    read: Callable[[Any], Any]
    write: Callable[[Any], Any] | None = None

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Pydantic's schema of the form, between `read` and `write`; an existing record is accepted unchanged."""
        made = source if isinstance(source, type) else ()
        return no_info_wrap_validator_function(
            lambda value, in_form: value if isinstance(value, made) else self.read(in_form(value)),
            handler.generate_schema(self.form),
            serialization=plain_serializer_function_ser_schema(self.write) if self.write else None,
        )


Finite = Annotated[float, Field(allow_inf_nan=False)]
_Row = Annotated[tuple[Finite, ...], Field(min_length=4, max_length=4)]
PoseMatrix = Annotated[
    Array, SerializedAs(Annotated[tuple[_Row, ...], Field(min_length=4, max_length=4)], read_only, np.ndarray.tolist)
]
"""A pose, shape (4, 4), which a file writes as nested rows; whether it is one is not checked."""
MOST_DEGREES = 720.0  # Number up to which an angle without unit was probably meant in degrees

_MEANT = {
    **dict.fromkeys(("fps", "framerate", "frame_rate", "frequency", "hz"), ("rate",)),
    **dict.fromkeys(("fov", "hfov", "resolution", "intrinsics"), ("horizontal_fov", "image")),
    **dict.fromkeys(("xyz", "translation", "origin", "location"), ("position", "pose")),
    **dict.fromkeys(("rotation", "euler", "orientation"), ("rpy",)),
    **dict.fromkeys(("parent", "link", "frame_id"), ("frame",)),
    "colour": ("color",),
    "delay": ("latency",),
    "dimensions": ("size",),
    "quat": ("quaternion",),
}
"""Keys as other tools call them, each with those here that may be meant."""


def _with_declared_keys(record: type, keys: Mapping[str, bool], data: object) -> object:
    """The data of a record, or the record. keys: whether each is required.

    Raises PydanticCustomError for data that are no mapping, or have other keys.
    """
    if isinstance(data, record):
        return data
    if not isinstance(data, dict):
        needed = [key for key, required in keys.items() if required]
        raise PydanticCustomError("no-mapping", "no mapping", {"keys": needed or list(keys)})
    unknown = dict[str, str]()
    for key in (str(one) for one in data if one not in keys):
        meant = [name for name in _MEANT.get(key.lower(), ()) if name in keys]
        unknown[key] = f"did you mean `{meant[0]}`?" if meant else expected_names(key, keys)
        stated = [units.read_quantity(data.get(name)) for name in ("width", "height", key)]
        if key.lower() in ("diagonal_fov", "dfov") and "horizontal_fov" in keys and None not in stated:
            width, height, angle = (one.value for one in stated if one is not None)
            half = (angle if stated[2] and stated[2].dimension else np.radians(angle)) / 2
            wide = np.degrees(2 * np.arctan(np.tan(half) * width / np.hypot(width, height)))
            unknown[key] = (
                f"write `horizontal_fov: {wide:.4g} deg`, which this diagonal means" if wide > 0 else "use `fx`"
            )
    if unknown:
        raise PydanticCustomError("unknown-key", "unknown key", {"keys": unknown})
    return data


def foreign(**fields: Any) -> Any:  # noqa: ANN401 - a class made at run time
    """The class of entries of a file that other programs write: unknown keys are ignored.

    fields: each a type, or one with its default or Pydantic's `Field`.
    """
    given: dict[str, Any] = {
        name: stated if isinstance(stated, tuple) else (stated, ...) for name, stated in fields.items()
    }
    config = ConfigDict(extra="ignore", frozen=True, defer_build=True)
    return create_model("ForeignEntry", __config__=config, **given)


def one_of(*keys: str) -> Discriminator:
    """Chooses the entry of a union by its unique key; the entry's tag is that key in `<...>`."""
    return Discriminator(
        lambda data: f"<{found[0]}>" if isinstance(data, dict) and len(found := [*data.keys() & keys]) == 1 else None,
        custom_error_type="ambiguous-entry",
        custom_error_message=_ONLY_ONE.format(first_names(keys)),
    )


_This = TypeVar("_This")
_Else = TypeVar("_Else")

ListOr = Annotated[
    Annotated[_This, Tag("<list>")] | Annotated[_Else, Tag("<else>")],
    Discriminator(lambda data: "<list>" if isinstance(data, list) else "<else>"),
]
"""The first type where a file has a list, else the second."""

MappingOr = Annotated[
    Annotated[_This, Tag("<mapping>")] | Annotated[_Else, Tag("<else>")],
    Discriminator(lambda data: "<mapping>" if isinstance(data, dict) else "<else>"),
]
"""The first type where a file has a mapping, else the second."""
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]
"""A name that logic formulas can use: letters, digits, `_` and `-`, starting with a letter."""
Text = Annotated[str, StringConstraints(min_length=1)]


@dataclass(frozen=True)
class In:
    """Marks a number of a file: its dimension, None for a plain number, and its bounds in SI units.

    Text with a unit of the dimension is accepted too. An angle of more than a turn needs a unit.
    """

    dimension: units.Dimension | None
    least: float
    most: float

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_before_validator_function(self.read, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        number = {"type": "number", "minimum": self.least, "maximum": self.most}
        if self.dimension is None:
            return number
        described = f"A number in SI units and radians, or {units.expected_quantity(self.dimension)}."
        return {"anyOf": [number, {"type": "string"}], "description": described}

    def read(self, value: object) -> float:
        """The number in a file, in SI units. Raises PydanticCustomError for a wrong unit or value."""
        read, found = units.read_quantity(value), f"found {describe(value)}"
        expected = units.expected_quantity(*((self.dimension,) if self.dimension else ()))
        if read is None or read.dimension not in (None, self.dimension):
            raise refused("wrong-unit", f"{found}, expected {expected}")
        if read.dimension is None and self.dimension is units.ANGLE and abs(read.value) > units.TURN:
            likely = f"; did you mean `{read.value:g} deg`?" if abs(read.value) <= MOST_DEGREES else ""
            raise refused("wrong-unit", f"{found}, which would be radians; expected {expected}{likely}")
        if not self.least <= read.value <= self.most:
            word, bound = ("least", self.least) if read.value < self.least else ("most", self.most)
            meant = units.meant_instead(value, self.dimension, self.least, self.most)
            message = f"{found}, expected a value of at {word} {units.in_unit(bound, self.dimension)}"
            raise refused("wrong-value", message + (f"; {meant[0]}" if meant else ""))
        return read.value


def refused(code: LiteralString, message: str) -> PydanticCustomError:
    """An error with a message that may hold any characters."""
    return PydanticCustomError(code, "{message}", {"message": message})


Length = Annotated[float, In(units.LENGTH, -units.LARGEST_LENGTH, units.LARGEST_LENGTH)]
Distance = Annotated[float, In(units.LENGTH, 0.0, units.LARGEST_LENGTH)]
Size = Annotated[float, In(units.LENGTH, units.SMALLEST_SIZE, units.LARGEST_LENGTH)]
Angle = Annotated[float, In(units.ANGLE, -units.LARGEST_ANGLE, units.LARGEST_ANGLE)]
Time = Annotated[float, In(units.TIME, 0.0, units.LONGEST)]
Pixels = Annotated[float, In(units.PIXELS, 0.0, units.LARGEST)]
Share = Annotated[float, In(units.SHARE, 0.0, 1.0)]
Number = Annotated[float, In(None, -units.LARGEST, units.LARGEST)]
_A_NUMBER = {"type": "number", "minimum": -units.LARGEST, "maximum": units.LARGEST}
_JOINT = "a number, or one with a unit such as `30 deg`, `60 deg/s` or `120 deg/s^2`"


def any_quantity(value: object, expected: str = _JOINT) -> units.Quantity:
    """The quantity in a file, of any dimension; raises PydanticCustomError for others. expected: describes it."""
    read = units.read_quantity(value)
    if read is None:
        raise refused("wrong-unit", f"found {describe(value)}, expected {expected}")
    if abs(read.value) > units.LARGEST:
        raise refused("wrong-value", f"found {describe(value)}, expected a number of at most {units.LARGEST:g} in size")
    return read


AnyQuantity = Annotated[
    units.Quantity,
    BeforeValidator(any_quantity),
    PlainSerializer(lambda quantity: quantity.value),
    WithJsonSchema({"anyOf": [_A_NUMBER, {"type": "string"}], "description": "A number, or one with its unit."}),
]
"""A quantity whose dimension is checked later, where it is used."""


def _numbers(count: int, value: object) -> object:
    if not isinstance(value, list) or len(value) != count:
        raise refused("wrong-length", f"found {describe(value)}, expected a list of {count} numbers")
    return value


_TWO, _THREE, _FOUR = (BeforeValidator(partial(_numbers, count)) for count in (2, 3, 4))


def _with_length(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if max(map(abs, vector)) < units.SHORTEST_DIRECTION:
        raise PydanticCustomError("not-a-rotation", "found a vector of length 0, expected a direction")
    return vector


Position = Annotated[tuple[Length, Length, Length], _THREE]
Extents = Annotated[tuple[Size, Size, Size], _THREE]
Direction = Annotated[tuple[Number, Number, Number], _THREE, AfterValidator(_with_length)]
Rotation = Annotated[tuple[Angle, Angle, Angle], _THREE]
Quaternion = Annotated[tuple[Number, Number, Number, Number], _FOUR]
Range = Annotated[tuple[Distance, Distance], _TWO]
_Rate = Annotated[float, In(None, 1e-3, 100.0)]
Rates = Annotated[tuple[_Rate, _Rate], _TWO]
Scale = Annotated[
    tuple[Number, Number, Number],
    _THREE,
    BeforeValidator(lambda value: value if isinstance(value, list) else [value] * 3),
    WithJsonSchema({"anyOf": [_A_NUMBER, {"type": "array", "items": _A_NUMBER}]}),
]


class Pose(Entry):
    """A pose: a position, and an orientation in one of two notations."""

    position: Position = Field(default=(0.0, 0.0, 0.0), description="x, y, z.")
    quaternion: Quaternion | None = Field(default=None, description="Orientation as x, y, z, w; of length 1.")
    rpy: Rotation | None = None
    """Orientation as roll, pitch, yaw about fixed x, y, z, as in URDF."""

    @model_validator(mode="after")
    def _one_orientation(self) -> Pose:
        if self.quaternion is not None and self.rpy is not None:
            raise PydanticCustomError("conflicting-keys", "`quaternion` and `rpy` both give the orientation; keep one")
        if self.quaternion is not None and (why := wrong_length(self.quaternion)):
            raise refused("not-a-rotation", f"`quaternion` {why}")
        return self

    def matrix(self) -> Array:
        """The 4x4 pose."""
        if self.quaternion is not None:
            return pose(quaternion_to_matrix(self.quaternion), self.position)
        return pose(rpy_to_matrix(self.rpy or (0.0, 0.0, 0.0)), self.position)


class CameraPose(Pose):
    """The pose of a camera's optical frame (z forward, x right, y down)."""

    look_at: Position | None = None
    """The point in the middle of the image, instead of an orientation."""
    up: Direction = Field(default=(0.0, 0.0, 1.0), description="With look_at: the direction that is up in the image.")

    @model_validator(mode="after")
    def _one_direction(self) -> CameraPose:
        if self.look_at is None:
            if "up" in self.model_fields_set:
                raise PydanticCustomError("conflicting-keys", "`up` has a meaning only together with `look_at`")
            return self
        if self.quaternion is not None or self.rpy is not None:
            raise PydanticCustomError("conflicting-keys", "`look_at` and an orientation are both given; keep one")
        if max(abs(a - b) for a, b in zip(self.look_at, self.position, strict=True)) < 1e-6:
            raise PydanticCustomError("not-a-rotation", "`look_at` is the position of the camera itself")
        return self

    def matrix(self) -> Array:
        """The 4x4 pose."""
        return super().matrix() if self.look_at is None else look_at(self.position, self.look_at, self.up)


XacroArgument = Annotated[
    str,
    BeforeValidator(
        lambda value: str(value).lower() if isinstance(value, bool)
        else f"{value:.15g}" if isinstance(value, int | float) else value
    ),
    WithJsonSchema({"type": ["string", "number", "boolean"]}),
]  # fmt: skip
"""An argument as xacro takes it: text."""


class XacroEntry(Entry):
    """A xacro file and the values of its arguments."""

    xacro: Text = Field(description="The file; relative to this file, or package://.")
    args: dict[str, XacroArgument] = Field(default={}, description="Values of its arguments, by name.")


DescriptionEntry = MappingOr[XacroEntry, Text]
"""A robot description: the path of a plain file or a xacro, or a xacro with arguments."""

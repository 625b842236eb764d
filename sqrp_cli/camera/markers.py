"""Markers and the dictionaries that they are from, by the names that OpenCV gives these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, NamedTuple

from pydantic import Field, PlainValidator, WithJsonSchema

from sqrp_cli.errors import expected_names
from sqrp_cli.files.entries import FileRecord, MappingOr, Size, refused
from sqrp_cli.records import dataclass


class MarkerDictionary(NamedTuple):
    """A set of markers."""

    modules: int  # Along a side of the black square: those of the code, and its border
    ids: int  # How many: they are called 0 to one less than this

    corrected: int = 0
    """So many bits of the code may be wrong: OpenCV corrects up to 0.6 of what the code's distance allows."""


_CORRECTED = {4: (0, 0, 0, 0), 5: (1, 1, 1, 1), 6: (3, 3, 3, 2), 7: (5, 4, 4, 3)}
"""By the bits along a side, of the dictionaries with 50, 100, 250 and 1000 markers."""
ORIGINAL = "aruco_original"  # the dictionary of markers that do not name one

DICTIONARIES: Mapping[str, MarkerDictionary] = {
    ORIGINAL: MarkerDictionary(7, 1024),
    **{
        f"{bits}x{bits}_{count}": MarkerDictionary(bits + 2, count, wrong)
        for bits, corrected in _CORRECTED.items()
        for count, wrong in zip((50, 100, 250, 1000), corrected, strict=True)
    },
    "apriltag_16h5": MarkerDictionary(6, 30, 1),
    "apriltag_25h9": MarkerDictionary(7, 35, 2),
    "apriltag_36h10": MarkerDictionary(8, 2320, 2),
    "apriltag_36h11": MarkerDictionary(8, 587, 3),
    "aruco_mip_36h12": MarkerDictionary(8, 250, 3),
}
"""By name; `DICT_` before it and capitals, as OpenCV writes it, are accepted too."""


def opencv_name(name: str) -> str:
    """What OpenCV calls a dictionary: `DICT_4X4_50`, but `DICT_APRILTAG_36h11`."""
    return f"DICT_{name.upper()}" if not name.startswith("apriltag") else f"DICT_APRILTAG_{name.split('_')[1]}"


def _dictionary(value: object) -> str:
    name = str(value).lower().removeprefix("dict_")
    if not isinstance(value, str) or name not in DICTIONARIES:
        raise refused("wrong-value", f"found `{value}`, which is no dictionary; {expected_names(name, DICTIONARIES)}")
    return name


_SETS = "Which set it is from: aruco_original, 4x4_50 to 7x7_1000, apriltag_36h11 and others."
DictionaryName = Annotated[str, PlainValidator(_dictionary), WithJsonSchema({"type": "string"})]
MarkerNumber = Annotated[int, Field(strict=True, ge=0, le=max(one.ids for one in DICTIONARIES.values()) - 1)]


@dataclass(frozen=True, kw_only=True)
class ObjectMarker(FileRecord):
    """A printed marker in the middle of the top (+z) of an object."""

    id: Annotated[MarkerNumber, Field(description="Its number in the dictionary.")]
    dictionary: Annotated[DictionaryName, Field(description=_SETS)] = ORIGINAL
    side: Size | None = None
    """Side of the printed black square; by default as large as fits there with a margin."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError for an id that the dictionary does not have."""
        last = DICTIONARIES[self.dictionary].ids - 1
        if self.id > last:
            raise refused("wrong-value", f"found id {self.id}, expected one of `{self.dictionary}`: 0 to {last}")

    def on(self, size: tuple[float, float, float]) -> Marker:
        """The marker on an object of a size [m], with its side."""
        modules = DICTIONARIES[self.dictionary].modules
        side = self.side or min(size[:2]) * modules / (modules + 2)
        return Marker(id=self.id, dictionary=self.dictionary, side=side)


@dataclass(frozen=True, kw_only=True)
class Marker(ObjectMarker):
    """A printed marker: on a link around the origin of the link's frame, facing along its z axis."""

    side: Size = field()
    """Side of the printed black square."""


StatedMarker = MappingOr[ObjectMarker, MarkerNumber]
"""A marker on an object as a file states it: its id alone, or a mapping."""

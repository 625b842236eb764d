"""Calibration files: the text of each syntax as keys and values, and the formats of a camera in it.

Syntaxes are recognised by content: YAML (with OpenCV's header and tags), JSON, OpenCV's XML, the INI files of
`camera_calibration` (`ost.txt`) and COLMAP's `cameras.txt`. A format is a model of one camera, which gives a
`StatedLens`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import AliasChoices, BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from sqrp_cli.camera.camera import PixelCount, PixelSize, check_pixels
from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names
from sqrp_cli.files.entries import ForeignEntry, MappingOr, Number
from sqrp_cli.files.input_file import decoded, read_input
from sqrp_cli.files.json_file import json_document, parse_json
from sqrp_cli.files.source import Data, KeyPath, SourceDocument, not_finite
from sqrp_cli.files.xml_file import Element, parse_xml
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml, top_key
from sqrp_cli.records import dataclass

_INI = re.compile(r"^[ \t]*\[[\w/. -]+\][ \t\r]*$", re.MULTILINE)
_INI_KEYS = re.compile(r"^[ \t]*(camera matrix|distortion)[ \t\r]*$", re.MULTILINE)
_INI_NAME = re.compile(r"(?!nan\b|inf\b)[a-z][a-z_ ]*")
_COLMAP_LINE = re.compile(r"\s*(?:#.*\n\s*)*\d+[ \t]+(?:[A-Z]+_?[A-Z_]+\s|[a-z_]+[ \t]+\d+[ \t]+\d+\s)")


class CalibrationText(NamedTuple):
    """A file as keys and values."""

    document: SourceDocument
    syntax: str
    """YAML, XML, JSON, INI or COLMAP."""


def read_calibration_text(path: Path, keys: Collection[str]) -> CalibrationText:
    """A calibration file. keys: those by which YAML is recognised, so that problems may quote it, see `read_yaml`.

    Raises InputError, with the line, for text that is none of these, or is damaged.
    """
    content = read_input(path, MAX_BYTES)
    text = decoded(path, content)
    start, builder = text.lstrip()[:1], _Builder(path, content)
    if start == "<":
        # OpenCV's FileStorage in XML.
        tags: dict[str, bool] = {}
        for element in parse_xml(path, content, "opencv_storage").inside():
            tags[element.tag] = tags.get(element.tag, True) and not element.children
        root = parse_xml(path, content, "opencv_storage", frozenset(tag for tag, is_leaf in tags.items() if is_leaf))
        for child in root.children:
            builder.put(builder.data, (child.tag,), builder.xml_value(child, (child.tag,)), child.place)
        return builder.text("XML")
    if start == "{" and '"' in text:
        data = parse_json(path, text)
        if isinstance(data, dict):
            return CalibrationText(json_document(path, text, data), "JSON")
    if _INI.search(text) and _INI_KEYS.search(text):
        builder.read_ini(text)
        return builder.text("INI")
    if _COLMAP_LINE.match(text):
        builder.read_colmap(text)
        return builder.text("COLMAP")
    try:
        return CalibrationText(parse_yaml(path, content, frozenset({"!!opencv-matrix"}), keys), "YAML")
    except InputError as error:
        if content.strip() and not top_key(keys).search(text):
            raise InputError(no_calibration(path)) from error
        raise


def no_calibration(path: Path) -> Problem:
    """The problem of a file that is none of those read here."""
    message = (
        "found no camera; expected ROS camera_info or ost.txt, OpenCV FileStorage, a Kalibr camchain, a VINS camera, "
        "or COLMAP's cameras.txt"
    )
    mend = "export it as one of these, or state `image: {width, height, fx, fy, cx, cy, distortion}` in the workspace"
    return Problem("unknown-calibration", message, Place(path), mend=mend)


class _Part(SourceDocument):
    """A part of a file: problems name its keys as the file has them."""

    within: KeyPath = ()

    def name(self, path: KeyPath) -> str:
        return super().name((*self.within, *path))


def part_of(document: SourceDocument, at: KeyPath) -> SourceDocument:
    """The mapping at a path of a file, with its places."""
    keys, values = (
        {path[len(at) :]: place for path, place in places.items() if path[: len(at)] == at}
        for places in (document.keys, document.values)
    )
    part = _Part(document.path, document.content, document.at(at), keys, values)
    object.__setattr__(part, "within", at)
    return part


class _Builder:
    """Collects values with their places."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path, self.content = path, content
        self.data: Data = {}
        self.places: dict[KeyPath, Place] = {}

    def put(self, owner: Data, at: KeyPath, value: object, place: Place) -> None:
        """A value of a mapping at a path. Raises InputError for a second one of its name."""
        key = str(at[-1])
        if key in owner:
            first = self.places[at].line
            raise bad_input("duplicate-key", f"`{key}` is given twice, first in line {first}", place)
        owner[key] = value
        self.places[at] = place

    def text(self, syntax: str) -> CalibrationText:
        document = SourceDocument(self.path, self.content, self.data, self.places, self.places)
        return CalibrationText(document, syntax)

    def xml_value(self, element: Element, at: KeyPath) -> object:
        """What an element of OpenCV's FileStorage holds."""
        if not element.children:
            text = "".join(element.pieces).strip().strip('"')
            return _row(text, element.place) if element.tag == "data" else _scalars(text)
        if all(child.tag == "_" for child in element.children):
            return [self.xml_value(child, (*at, index)) for index, child in enumerate(element.children)]
        found: Data = {}
        for child in element.children:
            self.put(found, (*at, child.tag), self.xml_value(child, (*at, child.tag)), child.place)
        return found

    def read_ini(self, text: str) -> None:
        """`ost.txt`: sections in brackets; each value in the lines below its name. A camera is one with a matrix."""
        size: dict[str, tuple[str, Place]] = {}
        section, name, camera = "", "", None
        for number, line in enumerate(text.splitlines(), 1):
            words, place = line.split("#")[0].strip(), Place(self.path, number, 1)
            if words.startswith("["):
                section, name, camera = words.strip("[] "), "", None
            elif words and section == "image" and name in ("width", "height") and name not in size:
                size[name] = words, place
            elif _INI_NAME.fullmatch(words):
                name = words
                if name == "camera matrix":
                    camera = Data()
                    self.put(self.data, (section,), camera, place)
                    for key, (stated, at) in size.items():  # the image size that was stated before it
                        self.put(camera, (section, f"image_{key}"), _scalars(stated), at)
            elif words and camera is not None and name in ("camera matrix", "distortion"):
                key = "camera_matrix" if name == "camera matrix" else "distortion_coefficients"
                camera.setdefault(key, []).extend(_row(words, place))
                self.places.setdefault((section, key), place)

    def read_colmap(self, text: str) -> None:
        """`cameras.txt`: number, model, width, height and parameters of a camera in a line."""
        for number, line in enumerate(text.splitlines(), 1):
            words, place = line.split("#")[0].split(), Place(self.path, number, 1)
            if words and len(words) < 5:
                message = "expected a camera in a line: its number, model, width, height and parameters"
                raise bad_input("wrong-length", message, place)
            if words:
                camera: Data = {}
                self.put(self.data, (words[0],), camera, place)
                width, height, params = _scalars(words[2]), _scalars(words[3]), _row(" ".join(words[4:]), place)
                for key, value in {"model": words[1], "width": width, "height": height, "params": params}.items():
                    self.put(camera, (words[0], key), value, place)


def _row(text: str, place: Place) -> list[float]:
    """The numbers of a text. Raises InputError for anything else."""
    numbers = []
    for word in text.split():
        try:
            numbers.append(float(word))
        except ValueError:
            raise bad_input("wrong-type", f"found `{word}`, expected a number", place) from None
        if not math.isfinite(numbers[-1]):
            raise InputError(not_finite(place, word))
    return numbers


def _scalars(text: str) -> object:
    """A number, several of them as a list, or text."""
    try:
        numbers = [int(word) if re.fullmatch(r"[-+]?\d{1,18}", word) else float(word) for word in text.split()]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers or text


COLMAP_PIXEL = 0.5
"""COLMAP's coordinates of the centre of the first pixel [pixels], which is at 0 for everyone else here."""


def flat(value: object) -> object:
    """The rows of a matrix as one list; other values unchanged."""
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return [number for row in value for number in row]
    return value


_Numbers = Annotated[list[Number], BeforeValidator(flat)]


class _Matrix(ForeignEntry):
    rows: Annotated[int, Field(strict=True, ge=0)]
    cols: Annotated[int, Field(strict=True, ge=0)]
    data: _Numbers


_MatrixOrNumbers = MappingOr[_Matrix, _Numbers]

K_KEYS = ("camera_matrix", "K", "k", "Camera_Matrix", "cameraMatrix", "intrinsic_matrix", "mtx")
_D_KEYS = (
    "distortion_coefficients", "D", "d", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "dist",
)  # fmt: skip
WIDTHS, HEIGHTS = ("image_width", "width", "image_Width"), ("image_height", "height", "image_Height")
SIZES = ("resolution", "image_size", "imageSize")


@dataclass(frozen=True, kw_only=True)
class StatedLens:
    """What a file says of a camera's lens, with the paths of the keys."""

    K: Sequence[float]
    """The camera matrix [pixels], row by row."""
    K_at: KeyPath
    model: str | None
    """The distortion model as the file calls it; None if it names none."""
    model_at: KeyPath
    D: Sequence[float]
    """The distortion coefficients that the file states."""
    D_at: KeyPath
    models: Sequence[str] = ("plumb_bob", "rational_polynomial", "equidistant")
    """Names of distortion models that files of this format can have, for messages."""


class StatedCamera(ForeignEntry):
    """A camera in a file of some format."""

    image_width: PixelCount | None = Field(default=None, validation_alias=AliasChoices(*WIDTHS))
    image_height: PixelCount | None = Field(default=None, validation_alias=AliasChoices(*HEIGHTS))
    resolution: Annotated[list[PixelCount], Field(min_length=2, max_length=2)] | None = Field(
        default=None, validation_alias=AliasChoices(*SIZES)
    )

    @model_validator(mode="after")
    def _possible_size(self) -> StatedCamera:
        if self.size is not None:
            check_pixels(*self.size)
        return self

    @property
    def size(self) -> PixelSize | None:
        """That of its image."""
        if self.resolution is not None:
            return PixelSize(*self.resolution)
        return PixelSize.of(self.image_width, self.image_height)

    def lens(self, document: SourceDocument) -> StatedLens:
        """Its lens. Raises InputError, with the line, for lists of a wrong length."""
        raise NotImplementedError


class _Region(ForeignEntry):
    """The part of the sensor that is read out [pixels]; all of it where width and height are 0."""

    x_offset: Annotated[int, Field(ge=0)] = 0
    y_offset: Annotated[int, Field(ge=0)] = 0
    width: Annotated[int, Field(ge=0)] = 0
    height: Annotated[int, Field(ge=0)] = 0


class CameraInfo(StatedCamera):
    """ROS `sensor_msgs/CameraInfo`, or matrices in OpenCV's FileStorage.

    Matrix and size of a message are those of the full sensor. The images are cut to `roi` and then binned, as
    `image_geometry` has it.
    """

    camera_matrix: _MatrixOrNumbers = Field(validation_alias=AliasChoices(*K_KEYS))
    distortion_model: str | None = None
    distortion_coefficients: _MatrixOrNumbers = Field(validation_alias=AliasChoices(*_D_KEYS))
    fisheye_model: Any = None
    """Written by OpenCV's calibration sample."""
    binning_x: Annotated[int, Field(ge=0)] = 0
    binning_y: Annotated[int, Field(ge=0)] = 0
    roi: _Region = _Region()

    @property
    def size(self) -> PixelSize | None:
        """That of its image."""
        full = super().size
        if full is None:
            return None
        width, height = self.roi.width or full.width, self.roi.height or full.height
        if self.roi.x_offset + width > full.width or self.roi.y_offset + height > full.height:
            raise PydanticCustomError("wrong-value", f"its `roi` reaches out of the image of {full.short}")
        return PixelSize(max(width // max(self.binning_x, 1), 1), max(height // max(self.binning_y, 1), 1))

    def lens(self, document: SourceDocument) -> StatedLens:
        """Its lens. Raises InputError, with the line, for lists of a wrong length."""
        K_at, K = _numbers(document, K_KEYS, self.camera_matrix, 9)
        D_at, D = _numbers(document, _D_KEYS, self.distortion_coefficients, None)
        x, y = max(self.binning_x, 1), max(self.binning_y, 1)
        cx, cy = K[2] - self.roi.x_offset, K[5] - self.roi.y_offset
        K = [K[0] / x, K[1] / x, cx / x, K[3] / y, K[4] / y, cy / y, *K[6:]]
        model = self.distortion_model
        if model is None and self.fisheye_model is not None and len(D) == 4:
            model = "fisheye" if self.fisheye_model else "radtan"
        return StatedLens(K=K, K_at=K_at, model=model, model_at=("distortion_model",), D=D, D_at=D_at)


class _Kalibr(StatedCamera):
    """A camera of a Kalibr camchain."""

    camera_model: str = "pinhole"
    intrinsics: _Numbers
    distortion_model: str
    distortion_coeffs: _Numbers

    def lens(self, document: SourceDocument) -> StatedLens:
        if self.camera_model != "pinhole":
            message = f"found `{self.camera_model}`, expected `pinhole`, with any distortion model"
            raise document.error("unknown-distortion-model", ("camera_model",), message)
        at: KeyPath = ("intrinsics",)
        K, D_at = _pinhole(document, at, self.intrinsics), ("distortion_coeffs",)
        model, models, D = self.distortion_model, ("radtan", "equidistant", "none"), self.distortion_coeffs
        return StatedLens(K=K, K_at=at, model=model, model_at=("distortion_model",), D=D, D_at=D_at, models=models)


_PINHOLE = ("fx", "fy", "cx", "cy")
_VINS_NAMES: Mapping[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "PINHOLE": ("radtan", _PINHOLE, ("k1", "k2", "p1", "p2")),
    "PINHOLE_FULL": ("pinhole_full", _PINHOLE, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "KANNALA_BRANDT": ("kannala_brandt", ("mu", "mv", "u0", "v0"), ("k2", "k3", "k4", "k5")),
}
"""By camodocal's model: the name of its distortion, and the names of parameters and of coefficients."""


class _Vins(StatedCamera):
    """A camera of camodocal, as VINS-Mono and VINS-Fusion have it."""

    model_type: str = "PINHOLE"
    distortion_parameters: dict[str, Number] = Field(default={})
    projection_parameters: dict[str, Number]

    def lens(self, document: SourceDocument) -> StatedLens:
        if self.model_type not in _VINS_NAMES:
            message = f"found `{self.model_type}`, which is no known camera model; "
            message += expected_names(self.model_type, _VINS_NAMES)
            raise document.error("unknown-distortion-model", ("model_type",), message)
        model, parameters, coefficients = _VINS_NAMES[self.model_type]
        at: KeyPath = ("projection_parameters",)
        values = {**self.distortion_parameters, **self.projection_parameters}  # those of a fisheye lens are in either
        missing = next((name for name in (*parameters, *coefficients) if name not in values), None)
        if missing is not None:
            raise document.error("missing-key", at, f"lacks the parameter `{missing}` of `{self.model_type}`")
        K, D = _pinhole(document, at, [values[name] for name in parameters]), [values[name] for name in coefficients]
        return StatedLens(K=K, K_at=at, model=model, model_at=("model_type",), D=D, D_at=("distortion_parameters",))


_COLMAP: Mapping[str, str] = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
}
"""COLMAP's models with the names of their parameters."""


class _Colmap(StatedCamera):
    """A line of COLMAP's `cameras.txt`."""

    model: str
    params: _Numbers

    def lens(self, document: SourceDocument) -> StatedLens:
        model = self.model.upper()
        if model not in _COLMAP:
            message = f"found `{self.model}`, expected one of {', '.join(f'`{known}`' for known in _COLMAP)}"
            mend = "estimate the camera again with one of these: `colmap feature_extractor --ImageReader.camera_model`"
            raise document.error("unknown-distortion-model", ("model",), message, mend)
        names = _COLMAP[model].split()
        if len(self.params) != len(names):
            message = f"found {len(self.params)} parameters, `{model}` has {len(names)}: {', '.join(names)}"
            raise document.error("wrong-length", ("params",), message)
        fx, fy, cx, cy, *D = self.params if names[0] == "fx" else (self.params[0], *self.params)
        K = [fx, 0.0, cx - COLMAP_PIXEL, 0.0, fy, cy - COLMAP_PIXEL, 0.0, 0.0, 1.0]
        return StatedLens(K=K, K_at=("params",), model=model, model_at=("model",), D=D, D_at=("params",))


class CalibrationFormat(NamedTuple):
    """A format of calibration files."""

    title: str
    model: type[StatedCamera]
    keys: tuple[str, ...]
    """Of these two, or all that there are, give a camera away."""


CAMERA_INFO = CalibrationFormat("ROS camera_info", CameraInfo, (*K_KEYS, *_D_KEYS, *WIDTHS, *HEIGHTS))

_FORMATS = (
    CalibrationFormat("VINS", _Vins, ("projection_parameters",)),
    CalibrationFormat("Kalibr camchain", _Kalibr, ("intrinsics", "distortion_coeffs", "camera_model")),
    CalibrationFormat("COLMAP cameras.txt", _Colmap, ("params",)),
    CAMERA_INFO,
)

TOP_KEYS = (*WIDTHS, *HEIGHTS, *K_KEYS, *_D_KEYS, "projection_parameters", "model_type", "cam0")
"""Keys of which one is at the top of a calibration file in YAML, so that problems may quote it."""


def format_of(data: Mapping[str, Any]) -> CalibrationFormat | None:
    """The format of a mapping if it is a camera: the first that fits."""
    fits = (known for known in _FORMATS if sum(key in data for key in known.keys) >= min(2, len(known.keys)))
    return next(fits, None)


def _numbers(
    document: SourceDocument, keys: tuple[str, ...], entry: _Matrix | list[float], count: int | None
) -> tuple[KeyPath, list[float]]:
    """The numbers of a matrix and their path, checked against its rows and columns and against `count`."""
    key = next(key for key in keys if key in document.data)
    if isinstance(entry, list):
        path: KeyPath = (key,)
        numbers, stated, expected = entry, count, str(count)
    else:
        path = (key, "data")
        numbers, stated = entry.data, entry.rows * entry.cols
        expected = f"`rows` x `cols` = {entry.rows} x {entry.cols} = {stated}"
    if stated is not None and stated != len(numbers):
        raise document.error("wrong-length", path, f"found {len(numbers)} numbers, expected {expected}")
    if count is not None and len(numbers) != count:
        raise document.error("wrong-length", path, f"found {expected} numbers, expected 3 x 3")
    return path, numbers


def _pinhole(document: SourceDocument, at: KeyPath, numbers: Sequence[float]) -> list[float]:
    """The camera matrix of fx, fy, cx, cy, row by row."""
    if len(numbers) != 4:
        message = f"found {len(numbers)} numbers, expected focal lengths and principal point: fx, fy, cx, cy"
        raise document.error("wrong-length", at, message)
    fx, fy, cx, cy = numbers
    return [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]

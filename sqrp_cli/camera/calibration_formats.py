"""Formats of calibration files: their text as keys and values, and what it says of a camera's lens.

Syntaxes are recognised by content: YAML (with OpenCV's header and tags), JSON, OpenCV's XML, the INI files of
`camera_calibration` (`ost.txt`) and COLMAP's `cameras.txt`. A format is a `StatedCamera` that `FORMATS` lists: the keys
of one camera, and the `StatedLens` that they mean.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

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

_INI = re.compile(r"^[ \t]*\[[\w/. -]+\][ \t\r]*$", re.MULTILINE)
_INI_KEYS = {"camera matrix": "camera_matrix", "distortion": "distortion_coefficients"}
_INI_KEY = re.compile(rf"^[ \t]*({'|'.join(_INI_KEYS)})[ \t\r]*$", re.MULTILINE)
_INI_NAME = re.compile(r"(?!nan\b|inf\b)[a-z][a-z_ ]*")
_COLMAP_LINE = re.compile(r"\s*(?:#.*\n\s*)*\d+[ \t]+(?:[A-Z]+_?[A-Z_]+\s|[a-z_]+[ \t]+\d+[ \t]+\d+\s)")


class CalibrationText(NamedTuple):
    """A file as keys and values."""

    document: SourceDocument
    syntax: str
    """YAML, XML, JSON, INI or COLMAP."""


def read_calibration_text(path: Path) -> CalibrationText:
    """A calibration file. Raises InputError, with the line, for text that is none of these, or is damaged."""
    content = read_input(path, MAX_BYTES)
    text = decoded(path, content)
    data, places, start = Data(), dict[KeyPath, Place](), text.lstrip()[:1]
    if start == "{" and '"' in text and isinstance(parsed := parse_json(path, text), dict):
        return CalibrationText(json_document(path, text, parsed), "JSON")
    if start == "<":
        tags: dict[str, bool] = {}
        for element in parse_xml(path, content, "opencv_storage").inside():
            tags[element.tag] = tags.get(element.tag, True) and not element.children
        root = parse_xml(path, content, "opencv_storage", frozenset(tag for tag, is_leaf in tags.items() if is_leaf))
        syntax, data = "XML", _xml_mapping(root, (), places)
    elif _INI.search(text) and _INI_KEY.search(text):
        syntax = "INI"
        _read_ini(path, text, data, places)
    elif _COLMAP_LINE.match(text):
        syntax = "COLMAP"
        for number, line in enumerate(text.splitlines(), 1):
            words, place = line.split("#")[0].split(), Place(path, number, 1)
            if words and len(words) < 5:
                message = "expected a camera in a line: its number, model, width, height and parameters"
                raise bad_input("wrong-length", message, place)
            if words:
                width, height, params = _scalars(words[2]), _scalars(words[3]), _row(" ".join(words[4:]), place)
                camera = {"model": words[1], "width": width, "height": height, "params": params}
                _put(data, (words[0],), camera, place, places)
                places |= {(words[0], key): place for key in camera}
    else:
        try:
            return CalibrationText(parse_yaml(path, content, frozenset({"!!opencv-matrix"}), TOP_KEYS), "YAML")
        except InputError as error:
            if content.strip() and not top_key(TOP_KEYS).search(text):
                raise InputError(no_calibration(path)) from error
            raise
    return CalibrationText(SourceDocument(path, content, data, places, places), syntax)


def no_calibration(path: Path) -> Problem:
    """The problem of a file that is none of those read here."""
    known = ", ".join(row.partition(" | ")[0] for one in FORMATS for row in one.rows())
    mend = "export it as one of these, or state `image: {width, height, fx, fy, cx, cy, distortion}` in the workspace"
    return Problem("unknown-calibration", f"found no camera; expected one of {known}", Place(path), mend=mend)


def _put(owner: Data, at: KeyPath, value: object, place: Place, places: dict[KeyPath, Place]) -> None:
    """Add a value to the mapping that it is in. Raises InputError for a second one of its name."""
    key = str(at[-1])
    if key in owner:
        raise bad_input("duplicate-key", f"`{key}` is given twice, first in line {places[at].line}", place)
    owner[key], places[at] = value, place


def _xml_mapping(element: Element, at: KeyPath, places: dict[KeyPath, Place]) -> Data:
    """What an element of OpenCV's FileStorage holds, by the tags within it; `_` are the items of a list."""

    def value(one: Element, at: KeyPath) -> object:
        if not one.children:
            text = "".join(one.pieces).strip().strip('"')
            return _row(text, one.place) if one.tag == "data" else _scalars(text)
        if all(child.tag == "_" for child in one.children):
            return [value(child, (*at, index)) for index, child in enumerate(one.children)]
        return _xml_mapping(one, at, places)

    found: Data = {}
    for child in element.children:
        _put(found, (*at, child.tag), value(child, (*at, child.tag)), child.place, places)
    return found


def _read_ini(path: Path, text: str, data: Data, places: dict[KeyPath, Place]) -> None:
    """`ost.txt`: sections in brackets; each value in the lines below its name. A camera is one with a matrix."""
    size: dict[str, tuple[object, Place]] = {}
    section, name = "", ""
    camera: Data | None = None
    for number, line in enumerate(text.splitlines(), 1):
        words, place = line.split("#")[0].strip(), Place(path, number, 1)
        if words.startswith("["):
            section, name, camera = words.strip("[] "), "", None
        elif words and section == "image" and name in ("width", "height") and f"image_{name}" not in size:
            size[f"image_{name}"] = _scalars(words), place
        elif _INI_NAME.fullmatch(words):
            name = words
            if name == "camera matrix":  # the image size was stated before it
                camera = {key: value for key, (value, _) in size.items()}
                _put(data, (section,), camera, place, places)
                places |= {(section, key): at for key, (_, at) in size.items()}
        elif words and camera is not None and name in _INI_KEYS:
            camera.setdefault(_INI_KEYS[name], []).extend(_row(words, place))
            places.setdefault((section, _INI_KEYS[name]), place)


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


def _scalars(text: str) -> Any:  # noqa: ANN401
    """A number, several of them as a list, or text."""
    try:
        numbers = [int(word) if re.fullmatch(r"[-+]?\d{1,18}", word) else float(word) for word in text.split()]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers or text


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


K_KEYS = ("camera_matrix", "K", "k", "Camera_Matrix", "cameraMatrix", "intrinsic_matrix", "mtx")
_D_KEYS = (
    "distortion_coefficients", "D", "d", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "dist",
)  # fmt: skip
WIDTHS, HEIGHTS = ("image_width", "width", "image_Width"), ("image_height", "height", "image_Height")
SIZES = ("resolution", "image_size", "imageSize")
_PINHOLE = ("fx", "fy", "cx", "cy")


class StatedLens(NamedTuple):
    """What a file says of a camera's lens, with the paths of the keys."""

    K: Sequence[float]
    """The camera matrix [pixels], row by row."""
    K_at: KeyPath
    D: Sequence[float]
    """The distortion coefficients that the file states."""
    D_at: KeyPath
    model: str | None
    """The distortion model as the file calls it; None if it names none."""
    model_at: KeyPath = ("distortion_model",)
    models: Sequence[str] = ("plumb_bob", "rational_polynomial", "equidistant")
    """Names of distortion models that files of this format can have, for messages."""


class StatedCamera(ForeignEntry):
    """A camera in a file of some format."""

    files: ClassVar[str]
    """Rows of the reference: a name of its files, who writes them, what gives them away, and what is not read."""
    keys: ClassVar[tuple[str, ...]]
    """Of these two, or all that there are, give a camera away."""
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

    @classmethod
    def rows(cls) -> list[str]:
        """The rows of the reference; the first begins with the name of the format."""
        return [" ".join(row.split()) for row in cls.files.split("    - ")[1:]]

    @property
    def size(self) -> PixelSize | None:
        """That of its image."""
        if self.resolution is not None:
            return PixelSize(*self.resolution)
        return PixelSize.of(self.image_width, self.image_height)

    def lens(self, document: SourceDocument) -> StatedLens:
        """Its lens. Raises InputError, with the line, for lists of a wrong length and unknown models."""
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

    files = """
    - ROS camera_info | `camera_calibration`, drivers, `ros2 topic echo`, camera_info managers | two of `camera_matrix`
      (`K`, `k`), `distortion_coefficients` (`D`, `d`), `image_width` (`width`), `image_height` (`height`) | the
      projection matrix
    - ost.txt | `camera_calibration` | sections in brackets, with `camera matrix` and `distortion` | externals
    - OpenCV FileStorage | `cv2.FileStorage` in YAML, XML or JSON | the same keys, also `Camera_Matrix`, `cameraMatrix`,
      `mtx`, `Distortion_Coefficients`, `distCoeffs`, `dist_coeffs`, `dist`; `fisheye_model` of OpenCV's sample | thin
      prisms and tilted sensors, unless they are zero"""
    keys = (*K_KEYS, *_D_KEYS, *WIDTHS, *HEIGHTS)
    camera_matrix: MappingOr[_Matrix, _Numbers] = Field(validation_alias=AliasChoices(*K_KEYS))
    distortion_model: str | None = None
    distortion_coefficients: MappingOr[_Matrix, _Numbers] = Field(validation_alias=AliasChoices(*_D_KEYS))
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

        def listed(keys: Sequence[str], entry: _Matrix | list[float]) -> tuple[list[float], KeyPath]:
            """The numbers of a matrix and their path, checked against its rows and columns."""
            key = next(key for key in keys if key in document.data)
            if isinstance(entry, list):
                return entry, (key,)
            if (stated := entry.rows * entry.cols) != len(entry.data):
                message = f"`rows` x `cols` = {entry.rows} x {entry.cols} = {stated}"
                message = f"found {len(entry.data)} numbers, expected {message}"
                raise document.error("wrong-length", (key, "data"), message)
            return entry.data, (key, "data")

        (K, K_at), (D, D_at) = listed(K_KEYS, self.camera_matrix), listed(_D_KEYS, self.distortion_coefficients)
        if len(K) != 9:
            raise document.error("wrong-length", K_at, f"found {len(K)} numbers, expected 9: 3 x 3")
        x, y = max(self.binning_x, 1), max(self.binning_y, 1)
        cx, cy = K[2] - self.roi.x_offset, K[5] - self.roi.y_offset
        K = [K[0] / x, K[1] / x, cx / x, K[3] / y, K[4] / y, cy / y, *K[6:]]
        model = self.distortion_model
        if model is None and self.fisheye_model is not None and len(D) == 4:
            model = "fisheye" if self.fisheye_model else "radtan"
        return StatedLens(K, K_at, D, D_at, model)


class _Kalibr(StatedCamera):
    """A camera of a Kalibr camchain."""

    keys = ("intrinsics", "distortion_coeffs", "camera_model")
    files = """
    - Kalibr camchain | `kalibr_calibrate_cameras` | `intrinsics`, `distortion_coeffs`, `camera_model: pinhole`
      | omni, ds, eucm; poses between cameras"""
    camera_model: str = "pinhole"
    intrinsics: _Numbers
    distortion_model: str
    distortion_coeffs: _Numbers

    def lens(self, document: SourceDocument) -> StatedLens:
        if self.camera_model != "pinhole":
            message = f"found `{self.camera_model}`, expected `pinhole`, with any distortion model"
            raise document.error("unknown-distortion-model", ("camera_model",), message)
        if len(self.intrinsics) != 4:
            message = (
                f"found {len(self.intrinsics)} numbers, expected focal lengths and principal point: fx, fy, cx, cy"
            )
            raise document.error("wrong-length", ("intrinsics",), message)
        K, D_at = _matrix(self.intrinsics), ("distortion_coeffs",)
        models = ("radtan", "equidistant", "none")
        return StatedLens(K, ("intrinsics",), self.distortion_coeffs, D_at, self.distortion_model, models=models)


class _Vins(StatedCamera):
    """A camera of camodocal, as VINS-Mono and VINS-Fusion have it."""

    keys = ("projection_parameters",)
    files = """
    - VINS | camodocal, VINS-Mono, VINS-Fusion | `projection_parameters`; PINHOLE, PINHOLE_FULL, KANNALA_BRANDT
      | MEI, SCARAMUZZA"""
    model_type: str = "PINHOLE"
    distortion_parameters: dict[str, Number] = Field(default={})
    projection_parameters: dict[str, Number]
    names: ClassVar[Mapping[str, tuple[str, tuple[str, ...], tuple[str, ...]]]] = {
        "PINHOLE": ("radtan", _PINHOLE, ("k1", "k2", "p1", "p2")),
        "PINHOLE_FULL": ("pinhole_full", _PINHOLE, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
        "KANNALA_BRANDT": ("kannala_brandt", ("mu", "mv", "u0", "v0"), ("k2", "k3", "k4", "k5")),
    }
    """By camodocal's model: the name of its distortion, and the names of parameters and of coefficients."""

    def lens(self, document: SourceDocument) -> StatedLens:
        if self.model_type not in self.names:
            expected = expected_names(self.model_type, self.names)
            message = f"found `{self.model_type}`, which is no known camera model; {expected}"
            raise document.error("unknown-distortion-model", ("model_type",), message)
        model, parameters, coefficients = self.names[self.model_type]
        at: KeyPath = ("projection_parameters",)
        values = {**self.distortion_parameters, **self.projection_parameters}  # those of a fisheye lens are in either
        missing = next((name for name in (*parameters, *coefficients) if name not in values), None)
        if missing is not None:
            raise document.error("missing-key", at, f"lacks the parameter `{missing}` of `{self.model_type}`")
        K, D = _matrix([values[name] for name in parameters]), [values[name] for name in coefficients]
        return StatedLens(K, at, D, ("distortion_parameters",), model, ("model_type",))


class _Colmap(StatedCamera):
    """A line of COLMAP's `cameras.txt`, which counts pixels from the corner of the first one, not from its centre."""

    keys = ("params",)
    files = """
    - COLMAP cameras.txt | COLMAP | lines of number, model, width, height and parameters | FOV, THIN_PRISM_FISHEYE"""
    model: str
    params: _Numbers
    names: ClassVar[Mapping[str, str]] = {
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

    def lens(self, document: SourceDocument) -> StatedLens:
        model = self.model.upper()
        if model not in self.names:
            message = f"found `{self.model}`, expected one of {', '.join(f'`{known}`' for known in self.names)}"
            mend = "estimate the camera again with one of these: `colmap feature_extractor --ImageReader.camera_model`"
            raise document.error("unknown-distortion-model", ("model",), message, mend)
        names, at = self.names[model].split(), ("params",)
        if len(self.params) != len(names):
            message = f"found {len(self.params)} parameters, `{model}` has {len(names)}: {', '.join(names)}"
            raise document.error("wrong-length", at, message)
        fx, fy, cx, cy, *D = self.params if names[0] == "fx" else (self.params[0], *self.params)
        return StatedLens(_matrix([fx, fy, cx - 0.5, cy - 0.5]), at, D, at, model, ("model",))


def _matrix(pinhole: Sequence[float]) -> list[float]:
    """The camera matrix of fx, fy, cx, cy, row by row."""
    fx, fy, cx, cy = pinhole
    return [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]


FORMATS: tuple[type[StatedCamera], ...] = (_Vins, _Kalibr, _Colmap, CameraInfo)
"""Of a mapping the first whose keys it has."""

TOP_KEYS = ("cam0", "model_type", *(key for one in FORMATS for key in one.keys if one is not _Colmap))
"""Keys of which one is at the top of a calibration file in YAML, so that problems may quote it."""


def format_of(data: Mapping[str, Any]) -> type[StatedCamera] | None:
    """The format of a mapping if it is a camera."""
    return next((one for one in FORMATS if sum(key in data for key in one.keys) >= min(2, len(one.keys))), None)

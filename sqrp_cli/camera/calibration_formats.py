"""Formats of calibration files: their text as keys and values, and what it says of a camera's lens.

Syntaxes are recognised by content: YAML (with OpenCV's header and tags), JSON, OpenCV's XML, the INI files of
`camera_calibration` (`ost.txt`) and COLMAP's `cameras.txt`. A format is an entry of `FORMATS`, from
`calibration_formats.yaml`, and one of `LENSES`: the keys of a camera, and the lens that they mean.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import AliasChoices, BeforeValidator, Field

from sqrp_cli.camera.camera import PixelCount, PixelSize
from sqrp_cli.errors import InputError, Place, Problem, bad_input, no_such
from sqrp_cli.files.entries import MappingOr, Number, foreign
from sqrp_cli.files.input_file import decoded, read_input
from sqrp_cli.files.json_file import json_document, parse_json
from sqrp_cli.files.source import Data, KeyPath, SourceDocument, not_finite
from sqrp_cli.files.xml_file import Element, parse_xml
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml, read_yaml, top_key

FACTS = read_yaml(Path(__file__).with_suffix(".yaml")).data  # of formats and of distortion models
_INI = re.compile(r"^[ \t]*\[[\w/. -]+\][ \t\r]*$", re.MULTILINE)
_INI_KEYS = {"camera matrix": "camera_matrix", "distortion": "distortion_coefficients"}
_INI_KEY = re.compile(rf"^[ \t]*({'|'.join(_INI_KEYS)})[ \t\r]*$", re.MULTILINE)
_INI_NAME = re.compile(r"(?!nan\b|inf\b)[a-z][a-z_ ]*")
_COLMAP_LINE = re.compile(r"\s*(?:#.*\n\s*)*\d+[ \t]+(?:[A-Z]+_?[A-Z_]+\s|[a-z_]+[ \t]+\d+[ \t]+\d+\s)")


def read_calibration_text(path: Path) -> tuple[SourceDocument, str]:
    """A calibration file as keys and values, and its syntax: YAML, XML, JSON, INI or COLMAP.

    Raises InputError, with the line, for text that is none of these, or is damaged.
    """
    content = read_input(path, MAX_BYTES)
    text = decoded(path, content)
    data, places, start = Data(), dict[KeyPath, Place](), text.lstrip()[:1]
    if start == "{" and '"' in text and isinstance(parsed := parse_json(path, text), dict):
        return json_document(path, text, parsed), "JSON"
    if start == "<":
        tags: dict[str, bool] = {}
        for element in parse_xml(path, content, "opencv_storage").inside():
            tags[element.tag] = tags.get(element.tag, True) and not element.children
        root = parse_xml(path, content, "opencv_storage", frozenset(tag for tag, is_leaf in tags.items() if is_leaf))
        syntax, data = "XML", _xml_value(root, (), places) if root.children else {}
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
            return parse_yaml(path, content, frozenset({"!!opencv-matrix"}), TOP_KEYS), "YAML"
        except InputError as error:
            if content.strip() and not top_key(TOP_KEYS).search(text):
                raise InputError(no_calibration(path)) from error
            raise
    return SourceDocument(path, content, data, places, places), syntax


def no_calibration(path: Path) -> Problem:
    """The problem of a file that is none of those read here."""
    known = ", ".join(row.partition(" | ")[0] for one in FORMATS.values() for row in one["files"])
    mend = "export it as one of these, or state `image: {width, height, fx, fy, cx, cy, distortion}` in the workspace"
    return Problem("unknown-calibration", f"found no camera; expected one of {known}", Place(path), mend=mend)


def _put(owner: Data, at: KeyPath, value: object, place: Place, places: dict[KeyPath, Place]) -> None:
    """Add a value to the mapping that it is in. Raises InputError for a second one of its name."""
    key = str(at[-1])
    if key in owner:
        raise bad_input("duplicate-key", f"`{key}` is given twice, first in line {places[at].line}", place)
    owner[key], places[at] = value, place


def _xml_value(element: Element, at: KeyPath, places: dict[KeyPath, Place]) -> Any:  # noqa: ANN401 - whatever it is
    """What an element of OpenCV's FileStorage holds, by the tags within it; `_` are the items of a list."""
    if not element.children:
        text = "".join(element.pieces).strip().strip('"')
        return _row(text, element.place) if element.tag == "data" else _scalars(text)
    if at and all(child.tag == "_" for child in element.children):
        return [_xml_value(child, (*at, index), places) for index, child in enumerate(element.children)]
    found: Data = {}
    for child in element.children:
        _put(found, (*at, child.tag), _xml_value(child, (*at, child.tag), places), child.place, places)
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


def flat(value: Any) -> Any:  # noqa: ANN401 - whatever a file has
    """The rows of a matrix as one list; other values unchanged."""
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return [number for row in value for number in row]
    return value


class StatedLens(NamedTuple):
    """What a file says of a camera's lens, with the paths of the keys."""

    K: Sequence[float]
    """The camera matrix [pixels], row by row; or fx, fy, cx, cy."""
    K_at: KeyPath
    D: Sequence[float]
    """The distortion coefficients that the file states."""
    D_at: KeyPath
    model: str | None
    """The distortion model as the file calls it; None if it names none."""
    model_at: KeyPath = ("distortion_model",)
    models: Sequence[str] = ("plumb_bob", "rational_polynomial", "equidistant")
    """Names of distortion models that files of this format can have, for messages."""
    size: PixelSize | None = None
    """Of the image, where it is not that of the camera's entry."""


FORMATS: Mapping[str, Any] = FACTS["formats"]
"""By name. `files`: rows of the reference, a name of its files, who writes them, what gives them away, and what is not
read. `keys`: of these two, or all that there are, give a camera away."""
K_KEYS, _D_KEYS, WIDTHS, HEIGHTS = FORMATS["camera_info"]["keys"]
SIZES = ("resolution", "image_size", "imageSize")
_Numbers = Annotated[list[Number], BeforeValidator(flat)]
_Count = Annotated[int, Field(strict=True, ge=0)]
_Matrix = foreign(rows=_Count, cols=_Count, data=_Numbers)
_Matrices: Any = MappingOr[_Matrix, _Numbers]  # type: ignore[misc, valid-type]
_Natural = (Annotated[int, Field(ge=0)], 0)
_Region = foreign(x_offset=_Natural, y_offset=_Natural, width=_Natural, height=_Natural)
_Length = PixelCount | None
_Sides = Annotated[list[PixelCount], Field(min_length=2, max_length=2)] | None

_CAMERA: Data = {
    "image_width": (_Length, Field(default=None, validation_alias=AliasChoices(*WIDTHS))),
    "image_height": (_Length, Field(default=None, validation_alias=AliasChoices(*HEIGHTS))),
    "resolution": (_Sides, Field(default=None, validation_alias=AliasChoices(*SIZES))),
}
"""What every format may say of a camera: the size of its image."""


def _camera_info(camera: Any, document: SourceDocument) -> StatedLens:  # noqa: ANN401 - its entry
    """ROS `sensor_msgs/CameraInfo`, or matrices in OpenCV's FileStorage.

    Matrix and size of a message are those of the full sensor. The images are cut to `roi` (all of it where that has no
    size) and then binned, as `image_geometry` has it.
    """
    roi, x, y = camera.roi, max(camera.binning_x, 1), max(camera.binning_y, 1)
    size = PixelSize.of(*(camera.resolution or (camera.image_width, camera.image_height)))
    if size is not None:
        width, height = roi.width or size.width, roi.height or size.height
        if roi.x_offset + width > size.width or roi.y_offset + height > size.height:
            raise document.error("wrong-value", ("roi",), f"reaches out of the image of {size.short}")
        size = PixelSize(max(width // x, 1), max(height // y, 1))
    found = list[tuple[list[float], KeyPath]]()  # numbers of both matrices, and their paths
    for keys, entry in ((K_KEYS, camera.camera_matrix), (_D_KEYS, camera.distortion_coefficients)):
        at: KeyPath = (next(key for key in keys if key in document.data),)
        if not isinstance(entry, list):
            at, rows, columns, entry = (*at, "data"), entry.rows, entry.cols, entry.data
            if rows * columns != len(entry):
                expected = f"`rows` x `cols` = {rows} x {columns} = {rows * columns}"
                raise document.error("wrong-length", at, f"found {len(entry)} numbers, expected {expected}")
        found.append((entry, at))
    (K, K_at), (D, D_at) = found
    if len(K) != 9:
        raise document.error("wrong-length", K_at, f"found {len(K)} numbers, expected 9: 3 x 3")
    K = [K[0] / x, K[1] / x, (K[2] - roi.x_offset) / x, K[3] / y, K[4] / y, (K[5] - roi.y_offset) / y, *K[6:]]
    model = camera.distortion_model
    if model is None and camera.fisheye_model is not None and len(D) == 4:
        model = "fisheye" if camera.fisheye_model else "radtan"
    return StatedLens(K, K_at, D, D_at, model, size=size)


def _kalibr(camera: Any, document: SourceDocument) -> StatedLens:  # noqa: ANN401 - its entry
    """A camera of a Kalibr camchain."""
    if camera.camera_model != "pinhole":
        message = f"found `{camera.camera_model}`, expected `pinhole`, with any distortion model"
        raise document.error("unknown-distortion-model", ("camera_model",), message)
    if len(camera.intrinsics) != 4:
        message = f"found {len(camera.intrinsics)} numbers, expected focal lengths and principal point: fx, fy, cx, cy"
        raise document.error("wrong-length", ("intrinsics",), message)
    D, D_at, models = camera.distortion_coeffs, ("distortion_coeffs",), ("radtan", "equidistant", "none")
    return StatedLens(camera.intrinsics, ("intrinsics",), D, D_at, camera.distortion_model, models=models)


def _vins(camera: Any, document: SourceDocument) -> StatedLens:  # noqa: ANN401 - its entry
    """A camera of camodocal, as VINS-Mono and VINS-Fusion have it."""
    models = FORMATS["vins"]["models"]
    if camera.model_type not in models:
        message = no_such(camera.model_type, "known camera model", models)
        raise document.error("unknown-distortion-model", ("model_type",), message)
    model, parameters, coefficients = models[camera.model_type]
    at: KeyPath = ("projection_parameters",)
    values = {**camera.distortion_parameters, **camera.projection_parameters}  # those of a fisheye lens are in either
    missing = next((name for name in f"{parameters} {coefficients}".split() if name not in values), None)
    if missing is not None:
        raise document.error("missing-key", at, f"lacks the parameter `{missing}` of `{camera.model_type}`")
    K, D = ([values[name] for name in names.split()] for names in (parameters, coefficients))
    return StatedLens(K, at, D, ("distortion_parameters",), model, ("model_type",))


def _colmap(camera: Any, document: SourceDocument) -> StatedLens:  # noqa: ANN401 - its entry
    """A line of COLMAP's `cameras.txt`, which counts pixels from the corner of the first one, not from its centre."""
    model, models, at = camera.model.upper(), FORMATS["colmap"]["models"], ("params",)
    if model not in models:
        message = f"found `{camera.model}`, expected one of {', '.join(f'`{known}`' for known in models)}"
        mend = "estimate the camera again with one of these: `colmap feature_extractor --ImageReader.camera_model`"
        raise document.error("unknown-distortion-model", ("model",), message, mend)
    names = models[model].split()
    if len(camera.params) != len(names):
        message = f"found {len(camera.params)} parameters, `{model}` has {len(names)}: {', '.join(names)}"
        raise document.error("wrong-length", at, message)
    fx, fy, cx, cy, *D = camera.params if names[0] == "fx" else (camera.params[0], *camera.params)
    return StatedLens((fx, fy, cx - 0.5, cy - 0.5), at, D, at, model, ("model",))


_FIELDS: dict[str, tuple[Callable[[Any, SourceDocument], StatedLens], Data]] = {
    "vins": (_vins, {
        "model_type": (str, "PINHOLE"),
        "distortion_parameters": (dict[str, Number], {}),
        "projection_parameters": dict[str, Number],
    }),
    "kalibr": (_kalibr, {
        "camera_model": (str, "pinhole"),
        "intrinsics": _Numbers,
        "distortion_model": str,
        "distortion_coeffs": _Numbers,
    }),
    "colmap": (_colmap, {"model": str, "params": _Numbers}),
    "camera_info": (_camera_info, {
        "camera_matrix": (_Matrices, Field(validation_alias=AliasChoices(*K_KEYS))),
        "distortion_model": (str | None, None),
        "distortion_coefficients": (_Matrices, Field(validation_alias=AliasChoices(*_D_KEYS))),
        "fisheye_model": (Any, None),
        "binning_x": _Natural,
        "binning_y": _Natural,
        "roi": (_Region, Field(default_factory=_Region)),
    }),
}  # fmt: skip
"""By format what reads the lens, and the keys of a camera besides the size of its image."""

LENSES = {name: (foreign(**_CAMERA, **fields), lens_of) for name, (lens_of, fields) in _FIELDS.items()}
"""By format the entry of a camera, and what gives the lens of such an entry: it raises InputError, with the line, for
lists of a wrong length and unknown models."""
CAMERA_KEYS: Mapping[str, Sequence[str]] = {name: flat(row["keys"]) for name, row in FORMATS.items()}
"""Keys of a camera by format; a mapping is of the first whose keys it has."""
TOP_KEYS = ("cam0", "model_type", *(key for name, keys in CAMERA_KEYS.items() for key in keys if name != "colmap"))
"""Keys of which one is at the top of a calibration file in YAML, so that problems may quote it."""

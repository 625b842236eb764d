"""Camera intrinsics from ROS camera calibration files.

Supported: the files of `camera_calibration` and of the drivers' camera info managers, OpenCV's FileStorage with the
same keys, and a printed `sensor_msgs/CameraInfo` message (K and D, or k and d).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import AliasChoices, BeforeValidator, Field, Tag, model_validator

from sqrp_cli.errors import InputError, Problem, expected_names
from sqrp_cli.geometry import Array, read_only
from sqrp_cli.knowledge.camera.camera import DISTORTION_LENGTHS, DistortionModel, Intrinsics, PixelCount, check_pixels
from sqrp_cli.knowledge.text.entries import ForeignEntry, Number, mapping_or_else
from sqrp_cli.knowledge.text.source import KeyPath, SourceDocument
from sqrp_cli.knowledge.text.validation import validate
from sqrp_cli.knowledge.text.yaml_file import read_yaml

_OPENCV_MODELS: dict[int, DistortionModel] = {5: "plumb_bob", 8: "rational_polynomial"}
"""Default model by number of coefficients, for files that name no model."""


MOST_SCALED = 5.0
"""Largest factor by which rectification scales the focal lengths."""

MOST_MOVED = 0.2
"""Largest shift of the principal point by rectification, as a share of the image."""


def _flat(value: object) -> object:
    """The rows of a matrix as one list; other values unchanged."""
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return [number for row in value for number in row]
    return value


_Numbers = Annotated[list[Number], BeforeValidator(_flat)]


class _Matrix(ForeignEntry):
    rows: Annotated[int, Field(strict=True, ge=0)]
    cols: Annotated[int, Field(strict=True, ge=0)]
    data: _Numbers


_MatrixOrNumbers = Annotated[
    Annotated[_Matrix, Tag("<mapping>")] | Annotated[_Numbers, Tag("<else>")], mapping_or_else()
]

_P_KEYS = ("projection_matrix", "P", "p")
_K_KEYS = ("camera_matrix", "K", "k")
_D_KEYS = ("distortion_coefficients", "D", "d")


class _CalibrationFile(ForeignEntry):
    image_width: PixelCount = Field(validation_alias=AliasChoices("image_width", "width"))
    image_height: PixelCount = Field(validation_alias=AliasChoices("image_height", "height"))
    camera_matrix: _MatrixOrNumbers = Field(validation_alias=AliasChoices(*_K_KEYS))
    distortion_model: str | None = None
    distortion_coefficients: _MatrixOrNumbers = Field(validation_alias=AliasChoices(*_D_KEYS))
    projection_matrix: Any = Field(default=None, validation_alias=AliasChoices(*_P_KEYS))

    @model_validator(mode="after")
    def _size(self) -> _CalibrationFile:
        check_pixels(self.image_width, self.image_height)
        return self


class CameraCalibration(NamedTuple):
    """What a camera calibration file says of a camera."""

    intrinsics: Intrinsics
    document: SourceDocument


def read_calibration(path: Path) -> CameraCalibration:
    """Intrinsics from a camera calibration file in one of the formats that this module reads.

    The projection matrix, if any, belongs to the rectified image and is not used: cameras see through their lens.
    Raises InputError, with the line, for missing keys, unknown models, wrong lengths and impossible matrices.
    """
    document = read_yaml(path, frozenset({"!!opencv-matrix"}), ("image_width", "width", *_K_KEYS))
    file = validate(document, _CalibrationFile)
    K_path, K_numbers = _numbers(document, _K_KEYS, file.camera_matrix, 9)
    D_path, coefficients = _numbers(document, _D_KEYS, file.distortion_coefficients, None)
    matrix = _camera_matrix(document, K_path, K_numbers)
    model = _model(document, file.distortion_model, D_path, len(coefficients))
    check_distortion(document, D_path, model, coefficients)
    intrinsics = Intrinsics(
        width=file.image_width,
        height=file.image_height,
        matrix=matrix,
        distortion_model=model,
        distortion=read_only(coefficients),
    )
    return CameraCalibration(intrinsics, document)


def doubtful_projection(intrinsics: Intrinsics, document: SourceDocument) -> Iterator[Problem]:
    """A warning about a projection matrix that does not fit the camera matrix in the same calibration file.

    The projection matrix describes the rectified image, which has the same size: `camera_calibration` scales the focal
    lengths to keep more or less of the image, and hardly moves its centre.
    """
    key = next((key for key in _P_KEYS if key in document.data), None)
    P = _projection(document.data[key]) if key is not None else None
    if key is None or P is None:
        return
    why = _why_another(P, intrinsics)
    if why is not None:
        message = f"{why}; expected that of the rectified image of this camera. It is not used, `camera_matrix` is"
        problem = document.problem("doubtful-projection", (key,), message, "is the file put together from two cameras?")
        yield replace(problem, severity="warning")


def _projection(entry: object) -> Array | None:
    """A projection matrix, shape (3, 4); None if malformed or all zeros, which is how drivers write unknown ones."""
    numbers = _flat(entry.get("data") if isinstance(entry, dict) else entry)
    if not isinstance(numbers, list) or len(numbers) != 12 or not all(isinstance(n, int | float) for n in numbers):
        return None
    return np.array(numbers, dtype=float).reshape(3, 4) if any(numbers) else None


def _why_another(P: Array, intrinsics: Intrinsics) -> str | None:
    K = intrinsics.matrix
    focal, known = P[[0, 1], [0, 1]], K[[0, 1], [0, 1]]
    if (focal <= 0).any():
        return f"found focal lengths {focal[0]:g} and {focal[1]:g}, expected positive ones"
    if not ((focal / known < MOST_SCALED) & (known / focal < MOST_SCALED)).all():
        return f"found focal lengths {focal[0]:g} and {focal[1]:g}, `camera_matrix` has {known[0]:g} and {known[1]:g}"
    size = np.array([intrinsics.width, intrinsics.height])
    if (np.abs(P[:2, 2] - K[:2, 2]) > MOST_MOVED * size).any():
        return (
            f"found the principal point ({P[0, 2]:g}, {P[1, 2]:g}), `camera_matrix` has ({K[0, 2]:g}, {K[1, 2]:g}) "
            f"in an image of {size[0]} x {size[1]} pixels"
        )
    return None


def check_distortion(
    document: SourceDocument, path: KeyPath, model: DistortionModel, coefficients: Sequence[float]
) -> None:
    """Raises InputError unless the number of distortion coefficients at `path` fits the model."""
    expected = DISTORTION_LENGTHS[model]
    if len(coefficients) != expected:
        message = f"found {len(coefficients)} distortion coefficients, expected {expected} for `{model}`"
        raise InputError(document.problem("wrong-length", path, message))


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
        raise InputError(document.problem("wrong-length", path, f"found {len(numbers)} numbers, expected {expected}"))
    if count is not None and len(numbers) != count:
        raise InputError(document.problem("wrong-length", path, f"found {expected} numbers, expected 3 x 3"))
    return path, numbers


def _camera_matrix(document: SourceDocument, path: KeyPath, numbers: list[float]) -> Array:
    K = np.array(numbers).reshape(3, 3)
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        message = (
            f"found focal lengths {K[0, 0]:g} and {K[1, 1]:g}, expected positive ones: [fx, 0, cx, 0, fy, cy, 0, 0, 1]"
        )
        raise InputError(document.problem("wrong-value", path, message))
    if np.abs([K[0, 1], K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1.0]).max() > 1e-6:
        message = "found skew or a last row that is not 0, 0, 1; expected [fx, 0, cx, 0, fy, cy, 0, 0, 1]"
        raise InputError(document.problem("wrong-value", path, message))
    return read_only(K)


def _model(document: SourceDocument, name: str | None, path: KeyPath, count: int) -> DistortionModel:
    if name is not None:
        for model in DISTORTION_LENGTHS:
            if name == model and model != "none":
                return model
        expected = expected_names(name, [model for model in DISTORTION_LENGTHS if model != "none"])
        message = f"found `{name}`, which is no known distortion model; {expected}"
        raise InputError(document.problem("unknown-distortion-model", ("distortion_model",), message))
    if count not in _OPENCV_MODELS:
        message = f"with {count} distortion coefficients the file must say `distortion_model`"
        raise InputError(document.problem("missing-key", path, message))
    return _OPENCV_MODELS[count]

"""Camera intrinsics from ROS camera calibration files and from the image entry of a workspace."""

from __future__ import annotations

from dataclasses import dataclass
from math import tan
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from sqrp_cli.errors import InputError, expected_names
from sqrp_cli.geometry import Array, read_only
from sqrp_cli.knowledge.camera import DISTORTION_LENGTHS, DistortionModel
from sqrp_cli.knowledge.entries import Number
from sqrp_cli.knowledge.source import Document, KeyPath, read_document
from sqrp_cli.knowledge.validation import validate
from sqrp_cli.knowledge.workspace_file import DistortionEntry, ImageEntry, PixelCount

_OPENCV_MODELS: dict[int, DistortionModel] = {5: "plumb_bob", 8: "rational_polynomial"}
"""The model that a number of coefficients means in a file that names none."""


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """What a calibration says of the camera itself; fields as in `Camera`."""

    width: int
    height: int
    matrix: Array
    distortion_model: DistortionModel
    distortion: Array


class _Lenient(BaseModel):
    """An entry of a file that other programs write: keys that it does not need are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class _Matrix(_Lenient):
    rows: Annotated[int, Field(strict=True, ge=0)]
    cols: Annotated[int, Field(strict=True, ge=0)]
    data: list[Number]


class _CalibrationFile(_Lenient):
    image_width: PixelCount
    image_height: PixelCount
    camera_matrix: _Matrix
    distortion_model: str | None = None
    distortion_coefficients: _Matrix


def read_calibration(path: Path) -> tuple[Intrinsics, Document]:
    """Intrinsics from a ROS camera calibration file (`camera_info` YAML, or OpenCV's FileStorage with the same keys).

    The projection matrix, if any, is that of the rectified image and is not used: cameras see through their lens.
    Raises InputError, with the line, for missing keys, unknown models, wrong lengths and matrices that no camera has.
    """
    document = read_document(path, tags=frozenset({"!!opencv-matrix"}))
    file = validate(document, _CalibrationFile)
    for name, entry in (
        ("camera_matrix", file.camera_matrix),
        ("distortion_coefficients", file.distortion_coefficients),
    ):
        if entry.rows * entry.cols != len(entry.data):
            expected = f"{entry.rows} x {entry.cols} = {entry.rows * entry.cols}"
            message = f"found {len(entry.data)} numbers, expected {expected}"
            raise InputError(document.problem("wrong-length", (name, "data"), message))
    matrix = _camera_matrix(document, file.camera_matrix)
    coefficients = file.distortion_coefficients.data
    model = _model(document, file.distortion_model, len(coefficients))
    distortion = _distortion(document, ("distortion_coefficients", "data"), model, coefficients)
    return Intrinsics(file.image_width, file.image_height, matrix, model, distortion), document


def image_intrinsics(document: Document, path: KeyPath, image: ImageEntry) -> Intrinsics:
    """Intrinsics from the `image` entry at `path`: pixels are square unless `fy` is given.

    Raises InputError for a wrong number of distortion coefficients.
    """
    fx = image.fx if image.fx is not None else 0.5 * image.width / tan(0.5 * (image.horizontal_fov or 0.0))
    fy = image.fy if image.fy is not None else fx
    cx = image.cx if image.cx is not None else 0.5 * (image.width - 1)
    cy = image.cy if image.cy is not None else 0.5 * (image.height - 1)
    lens = image.distortion or DistortionEntry(model="none", coefficients=[])
    distortion = _distortion(document, (*path, "distortion", "coefficients"), lens.model, lens.coefficients)
    matrix = read_only([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Intrinsics(image.width, image.height, matrix, lens.model, distortion)


def _camera_matrix(document: Document, entry: _Matrix) -> Array:
    path = ("camera_matrix", "data")
    if (entry.rows, entry.cols) != (3, 3):
        message = f"found {entry.rows} x {entry.cols}, expected 3 x 3"
        raise InputError(document.problem("wrong-length", path, message))
    K = np.array(entry.data).reshape(3, 3)
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        message = (
            f"found focal lengths {K[0, 0]:g} and {K[1, 1]:g}, expected positive ones: [fx, 0, cx, 0, fy, cy, 0, 0, 1]"
        )
        raise InputError(document.problem("wrong-value", path, message))
    if np.abs([K[0, 1], K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1.0]).max() > 1e-6:
        message = "found skew or a last row that is not 0, 0, 1; expected [fx, 0, cx, 0, fy, cy, 0, 0, 1]"
        raise InputError(document.problem("wrong-value", path, message))
    return read_only(K)


def _model(document: Document, name: str | None, count: int) -> DistortionModel:
    if name is not None:
        for model in DISTORTION_LENGTHS:
            if name == model and model != "none":
                return model
        expected = expected_names(name, [model for model in DISTORTION_LENGTHS if model != "none"])
        message = f"found `{name}`, which is no known distortion model; {expected}"
        raise InputError(document.problem("unknown-distortion-model", ("distortion_model",), message))
    if count not in _OPENCV_MODELS:
        message = f"with {count} distortion coefficients the file must say `distortion_model`"
        raise InputError(document.problem("missing-key", ("distortion_coefficients",), message))
    return _OPENCV_MODELS[count]


def _distortion(document: Document, path: KeyPath, model: DistortionModel, coefficients: list[float]) -> Array:
    expected = DISTORTION_LENGTHS[model]
    if len(coefficients) != expected:
        message = f"found {len(coefficients)} distortion coefficients, expected {expected} for `{model}`"
        raise InputError(document.problem("wrong-length", path, message))
    return read_only(coefficients)

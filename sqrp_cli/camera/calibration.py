"""Camera intrinsics from the calibration files that people have.

Recognised by content: ROS camera_info (files of `camera_calibration` and of drivers, printed messages, `ost.txt`),
OpenCV FileStorage (YAML, XML, JSON), Kalibr camchains, VINS (camodocal), COLMAP `cameras.txt`, and files with several.
What a format says of a camera is a `StatedLens`; all the rest is common to them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_core import PydanticCustomError

from sqrp_cli.camera import calibration_formats as formats
from sqrp_cli.camera.camera import (
    DISTORTION_LENGTHS,
    CalibrationFile,
    DistortionModel,
    Intrinsics,
    PixelSize,
    check_count,
    check_image,
    check_pixels,
)
from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names, nearest
from sqrp_cli.files.source import KeyPath, SourceDocument
from sqrp_cli.files.validation import misspelt, validate
from sqrp_cli.geometry import read_only

_OPENCV_MODELS: dict[int, DistortionModel] = {0: "none", 5: "plumb_bob", 8: "rational_polynomial"}
"""Default model by number of coefficients, for files that name no model."""
MOST_SCALED = 5.0  # largest factor by which rectification scales the focal lengths
MOST_MOVED = 0.2  # largest shift of the principal point by rectification, as a share of the image
MOST_CAMERAS_NESTED = 3  # levels of a file in which cameras are looked for


def read_calibration(
    path: Path, wanted: CalibrationFile | None = None, asked: str = "calibration"
) -> tuple[Intrinsics, SourceDocument, SourceDocument]:
    """Intrinsics from a camera calibration file in one of the formats that this module reads.

    With the document of the whole file, and that of what is about this camera.

    wanted: which camera of the file, and the size of its image if the file lacks it; asked: the key of the workspace
    that says so. The projection matrix, if any, belongs to the rectified image and is not used: cameras see through
    their lens. Raises InputError, with the line, for missing keys, unknown models, wrong lengths, impossible matrices,
    and where file and workspace contradict each other.
    """
    wanted = wanted or CalibrationFile(file=str(path))
    document, syntax = formats.read_calibration_text(path)
    part, format_name, name = _chosen(document, wanted, asked)
    entry, lens_of = formats.LENSES[format_name]
    camera: Any = validate(part, entry)
    stated = lens_of(camera, part)
    size = PixelSize.of(*(camera.resolution or (camera.image_width, camera.image_height)))
    width, height = _size(stated.size or size, part, wanted, asked)
    numbers, rows = stated.K, "[fx, 0, cx, 0, fy, cy, 0, 0, 1]"
    if len(numbers) == 4:
        fx, fy, cx, cy = numbers
        numbers = (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    K = np.array(numbers).reshape(3, 3)
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        message = f"found focal lengths {K[0, 0]:g} and {K[1, 1]:g}, expected positive ones: {rows}"
        raise part.error("wrong-value", stated.K_at, message)
    if np.abs([K[0, 1], K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1.0]).max() > 1e-6:
        message = f"found skew or a last row that is not 0, 0, 1; expected {rows}"
        raise part.error("wrong-value", stated.K_at, message)
    title = formats.FORMATS[format_name]["files"][0].partition(" | ")[0]
    if format_name == "camera_info":  # which is said in several syntaxes, by OpenCV too
        matrix = next(part.data[key] for key in formats.K_KEYS if key in part.data)
        of_opencv = syntax in ("XML", "JSON") or (isinstance(matrix, dict) and "dt" in matrix)
        title = f"{'OpenCV FileStorage' if of_opencv else title} ({syntax})"
    distortion_model, coefficients = _distortion(part, stated)
    intrinsics = Intrinsics(
        width=width,
        height=height,
        matrix=read_only(K),
        distortion_model=distortion_model,
        distortion=read_only(coefficients),
        lens_file=title if name is None else f"{title}: {name}",
    )
    check_image(part, stated.K_at, intrinsics)
    return intrinsics, document, part


def _chosen(document: SourceDocument, wanted: CalibrationFile, asked: str) -> tuple[SourceDocument, str, str | None]:
    """The wanted camera of a file, the name of its format, and its own if the file has several."""
    found, names = dict[KeyPath, str](), dict[str, KeyPath]()
    waiting: list[tuple[KeyPath, object]] = [((), document.data)]
    while waiting:  # depth first
        at, data = waiting.pop()
        has = {name: sum(key in data for key in keys) >= min(2, len(keys))
               for name, keys in formats.CAMERA_KEYS.items() if isinstance(data, dict)}  # fmt: skip
        if any(has.values()):
            found[at] = next(name for name in has if has[name])
        elif len(at) < MOST_CAMERAS_NESTED and isinstance(data, dict | list):
            inside = data.items() if isinstance(data, dict) else enumerate(data)
            waiting += [((*at, key), value) for key, value in inside][::-1]
    is_one = () in found or not found
    if not found and not any(key in document.data for key in formats.TOP_KEYS):
        raise InputError(formats.no_calibration(document.path))
    for at in [()] if is_one else found:  # a camera alone or of a list is called by its own name, others by their keys
        camera, own_keys = document.at(at), ("camera_name", "name", "id") if not at or isinstance(at[-1], int) else ()
        own = next((str(camera[key]) for key in own_keys if isinstance(camera.get(key), str | int)), None)
        if own or at:
            names[own or str(at[-1])] = at
    if wanted.camera is not None and wanted.camera not in names:
        held = f"the file has {', '.join(f'`{one}`' for one in names)}" if names else "the file has one camera, unnamed"
        close = nearest(wanted.camera, names)
        hint = f"; did you mean `{close}`?" if close else ""
        mend = "leave `camera` out, or name the file of that camera" if len(names) < 2 else None
        message = f"`{asked}.camera`: found `{wanted.camera}`, but {held}{hint}"
        raise bad_input("unknown-camera", message, Place(document.path), mend=mend)
    if is_one:
        return document, found.get((), "camera_info"), None
    if wanted.camera is None and len(names) > 1:
        message = f"the file has the cameras {', '.join(f'`{name}`' for name in names)}"
        mend = f"say which: `{asked}: {{file: {wanted.file}, camera: {next(iter(names))}}}`"
        raise bad_input("ambiguous-entry", message, Place(document.path), mend=mend)
    name = wanted.camera or next(iter(names))
    return document.part(names[name]), found[names[name]], name


def _size(size: PixelSize | None, part: SourceDocument, wanted: CalibrationFile, asked: str) -> PixelSize:
    """That of the image, from the file or the workspace, which must not contradict each other."""
    stated = PixelSize.of(wanted.width, wanted.height)
    at = next(((key,) for key in (*formats.SIZES, *formats.WIDTHS, *formats.HEIGHTS) if key in part.data), ())
    if size is None and at:
        missing = "image_height" if at[0] in formats.WIDTHS else "image_width"
        message = f"the file lacks the key `{missing}`{misspelt(missing, part.data)}"
        raise bad_input("missing-key", message, part.key_place(at))
    size = size or stated
    if size is None:
        message = "the file does not say how large the image is"
        mend = f"say it: `{asked}: {{file: {wanted.file}, width: 640, height: 480}}`"
        raise bad_input("missing-key", message, Place(part.path), mend=mend)
    if stated not in (None, size):
        message = f"the file is of an image of {size} pixels, `{asked}` of {stated}"
        mend = "leave `width` and `height` out, or name the calibration of that image size"
        raise part.error("image-size", at, message, mend)
    try:
        check_pixels(*size)
    except PydanticCustomError as error:
        raise part.error("image-too-large", at, error.message()) from None
    return size


def doubtful_projection(intrinsics: Intrinsics, document: SourceDocument) -> Iterator[Problem]:
    """A warning about a projection matrix that does not fit the camera matrix in the same calibration file.

    The projection matrix describes the rectified image, which has the same size: `camera_calibration` scales the focal
    lengths to keep more or less of the image, and hardly moves its centre. document: what is about this camera.
    """
    K = intrinsics.matrix
    key = next((key for key in ("projection_matrix", "P", "p") if key in document.data), "")
    entry = document.data.get(key)
    numbers = formats.flat(entry.get("data") if isinstance(entry, dict) else entry)
    if not isinstance(numbers, list) or len(numbers) != 12 or not all(isinstance(n, int | float) for n in numbers):
        return
    if not any(numbers):  # as drivers write an unknown one
        return
    P = np.array(numbers, dtype=float).reshape(3, 4)
    size = np.array([intrinsics.width, intrinsics.height])
    focal, known, why = P[[0, 1], [0, 1]], K[[0, 1], [0, 1]], ""
    lengths = f"found focal lengths {focal[0]:g} and {focal[1]:g}"
    if (focal <= 0).any():
        why = f"{lengths}, expected positive ones"
    elif not ((focal / known < MOST_SCALED) & (known / focal < MOST_SCALED)).all():
        why = f"{lengths}, `camera_matrix` has {known[0]:g} and {known[1]:g}"
    elif (np.abs(P[:2, 2] - K[:2, 2]) > MOST_MOVED * size).any():
        why = (
            f"found the principal point ({P[0, 2]:g}, {P[1, 2]:g}), `camera_matrix` has ({K[0, 2]:g}, {K[1, 2]:g}) "
            f"in an image of {size[0]} x {size[1]} pixels"
        )
    if why:
        message = f"{why}; expected that of the rectified image of this camera. It is not used, `camera_matrix` is"
        mend = "is the file put together from two cameras?"
        yield replace(document.problem("doubtful-projection", (key,), message, mend), severity="warning")


def _distortion(document: SourceDocument, stated: formats.StatedLens) -> tuple[DistortionModel, list[float]]:
    """The distortion model and all of its coefficients."""
    known = formats.FACTS["distortions"]
    model, *counts = known.get((stated.model or "").lower(), ("none", 8))
    count = len(stated.D)
    while count > max(counts) and not stated.D[count - 1]:  # OpenCV writes zeros of models with 12 and 14
        count -= 1
    if not stated.model and count == 4:
        message = "with 4 distortion coefficients the file must say `distortion_model`"
        how = "add `distortion_model: radtan` (k1, k2, p1, p2) or `distortion_model: fisheye` (k1, k2, k3, k4)"
        raise document.error("missing-key", stated.D_at, message, how)
    if not stated.model and count not in _OPENCV_MODELS:
        message, mend = f"found {len(stated.D)} distortion coefficients, expected 4, 5 or 8", None
        if count > 8:
            message += f", with zeros after them; number {count} is {stated.D[count - 1]:g}"
            mend = "calibrate without OpenCV's flags `CALIB_THIN_PRISM_MODEL` and `CALIB_TILTED_MODEL`"
        raise document.error("wrong-length", stated.D_at, message, mend)
    if not stated.model:
        return _OPENCV_MODELS[count], list(stated.D[:count])
    if stated.model.lower() not in known:
        expected = expected_names(stated.model, stated.models)
        message = f"found `{stated.model}`, which is no known distortion model; {expected}"
        raise document.error("unknown-distortion-model", stated.model_at, message)
    check_count(document, stated.D_at, stated.model, count, counts)
    return model, [*stated.D[:count], *[0.0] * (DISTORTION_LENGTHS[model] - count)]

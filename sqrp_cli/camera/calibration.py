"""Camera intrinsics from the calibration files that people have.

They are recognised by content, as `calibration_formats.py` says. What a format says of a camera is a `StatedLens`; all
the rest is common to them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

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
from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names, first_names, nearest
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.validation import misspelt
from sqrp_cli.geometry import Array, read_only

_OPENCV_MODELS: dict[int, DistortionModel] = {0: "none", 5: "plumb_bob", 8: "rational_polynomial"}
"""Default model by number of coefficients, for files that name no model."""
MOST_SCALED = 5.0  # largest factor by which rectification scales the focal lengths
MOST_MOVED = 0.2  # largest shift of the principal point by rectification, as a share of the image
MOST_OFF = 0.2  # how far a principal point is usually from the middle, as a share of the image
_OWN_NAMES = ("camera_name", "name", "id", "serial", "Purpose")  # keys by which a camera of a list is called


def read_calibration(
    path: Path, wanted: CalibrationFile | None = None, asked: str = "calibration", told: DistortionModel | None = None
) -> tuple[Intrinsics, SourceDocument, SourceDocument]:
    """Intrinsics from a camera calibration file in one of the formats that this module reads.

    With the document of the whole file, and that of what is about this camera.

    wanted: which camera of the file, and the size of its image if the file lacks it; asked: the key of the workspace
    that says so; told: the distortion model by the workspace, of a file that names none. The projection matrix, if any,
    belongs to the rectified image and is not used: cameras see through their lens. Raises InputError, with the line,
    for missing keys, unknown models, wrong lengths, impossible matrices, and where file and workspace contradict each
    other.
    """
    wanted = wanted or CalibrationFile(file=str(path))
    document, syntax = formats.read_calibration_text(path)
    camera, name = _chosen(document, wanted, asked)
    part = document.part(camera.at) if camera.at else document
    stated = formats.read_lens(camera, part, syntax, PixelSize.of(wanted.width, wanted.height))
    size, K, why, mend = _size(stated, part, wanted, asked), np.array(stated.K).reshape(3, 3), "", None
    if K[0, 0] <= 0 or K[1, 1] <= 0:
        why = f"found focal lengths {K[0, 0]:g} and {K[1, 1]:g}, expected positive ones:"
    elif np.abs([K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1.0]).max() > 1e-6:
        why = "found a last row that is not 0, 0, 1, or a second one that does not begin with 0; expected"
    elif abs(K[0, 1]) > 1e-6:
        # A pixel moves by the skew times its height in the plane z = 1.
        moved = abs(K[0, 1]) * max(K[1, 2] + 0.5, size.height - 0.5 - K[1, 2]) / K[1, 1]
        mend = f"set it to 0: pixels move by at most {moved:.2g}, in the rows that are farthest from the middle"
        why = f"found the skew {K[0, 1]:g}, expected 0:"
    if why:
        raise part.error("wrong-value", stated.at["K"], f"{why} [fx, 0, cx, 0, fy, cy, 0, 0, 1]", mend)

    title = formats.FORMATS[stated.format_name]["files"][0].partition(" | ")[0]
    if stated.format_name == "camera_info":  # which is said in several syntaxes, by OpenCV and by programs, too
        matrix = part.at(camera.words.get("matrix", ("",)))
        of_opencv = syntax == "XML" or (isinstance(matrix, dict) and "dt" in matrix)
        of_ros = syntax == "INI" or (syntax == "YAML" and {"width", "height", "matrix"} <= camera.words.keys())
        title = f"{'OpenCV FileStorage' if of_opencv else title if of_ros else 'keys and values'} ({syntax})"
    model, D = _distortion(part, stated, K, size, told, asked)
    intrinsics = Intrinsics(
        width=size.width, height=size.height, matrix=read_only(K), distortion_model=model, distortion=read_only(D),
        lens_file=title if name is None else f"{title}: {name}",
    )  # fmt: skip
    check_image(part, stated.at["K"], intrinsics)
    return intrinsics, document, part


def _chosen(document: SourceDocument, wanted: CalibrationFile, asked: str) -> tuple[formats.CameraInFile, str | None]:
    """The wanted camera of a file, and its name if the file has several."""
    found = formats.cameras_in(document.data)
    if not found and not any((key,) in document.keys for key in formats.TOP_KEYS):
        raise InputError(formats.no_calibration(document.path))
    found = found or [formats.CameraInFile((), {}, "")]
    names: dict[str, formats.CameraInFile] = {}
    for one in found:  # a camera alone or of a list is called by its own name, others by their keys
        camera, listed = document.at(one.at), not one.at or isinstance(one.at[-1], int)
        own = [str(camera[key]) for key in (_OWN_NAMES if listed else ()) if isinstance(camera.get(key), str | int)]
        short = one.mark or next(iter(own), str(one.at[-1]) if one.at else "")
        name = ".".join(map(str, (*one.at, one.mark))) if short in names else short
        if name or one.at or len(found) > 1:
            names[name or "main"] = one
    if wanted.camera is not None and wanted.camera not in names:
        held = f"the file has {first_names(names)}" if names else "the file has one camera, unnamed"
        hint = f"; did you mean `{close}`?" if (close := nearest(wanted.camera, names)) else ""
        mend = "leave `camera` out, or name the file of that camera" if len(names) < 2 else None
        message = f"`{asked}.camera`: found `{wanted.camera}`, but {held}{hint}"
        raise bad_input("unknown-camera", message, Place(document.path), mend=mend)
    if len(found) == 1 and not found[0].at and not found[0].mark:
        return found[0], None

    stated = {name: {word: document.at((*one.at, *path)) for word, path in one.words.items()}
              for name, one in names.items() if wanted.camera in (None, name)}  # fmt: skip
    fitting, size = list(stated), [wanted.width, wanted.height]
    if wanted.width is not None:  # which chooses among the sections of a ZED
        sides = {name: one.get("size", [one.get("width"), one.get("height")]) for name, one in stated.items()}
        fitting = [name for name in fitting if sides[name] == size] or fitting
    if all(stated[name] == stated[fitting[0]] for name in fitting):  # frames of a scene
        return names[fitting[0]], fitting[0] if len(fitting) == 1 else None
    mend = f"say which: `{asked}: {{file: {wanted.file}, camera: {fitting[0]}}}`"
    message = f"the file has the cameras {first_names(fitting)}"
    raise bad_input("ambiguous-entry", message, Place(document.path), mend=mend)


def _size(stated: formats.StatedLens, part: SourceDocument, wanted: CalibrationFile, asked: str) -> PixelSize:
    """That of the image, from the file or the workspace, which must not contradict each other."""
    told, at = PixelSize.of(wanted.width, wanted.height), stated.at["size"]
    if stated.size is None and at and told is None:
        missing = "image_height" if formats.squashed(str(at[-1])).endswith(("width", "w", "cols")) else "image_width"
        message = f"the file lacks the key `{missing}`{misspelt(missing, part.data)}"
        raise bad_input("missing-key", message, part.key_place(at))
    size = stated.size or told
    if size is not None and isinstance(part.at(at), list):  # as `image.shape` of NumPy has it
        turned, middle = PixelSize(size.height, size.width), np.array([stated.K[2], stated.K[5]])
        off, less = (np.abs(middle / np.array(one) - 0.5).max() for one in (size, turned))
        size = turned if told == turned else size
        if off > MOST_OFF > less and told is None:
            message = f"found {part.at(at)}, but the principal point is in the middle of {turned} pixels"
            mend = f"say `{asked}: {{file: {wanted.file}, width: {turned.width}, height: {turned.height}}}`"
            raise part.error("image-size", at, message, mend)
    if size is None:
        message = "the file does not say how large the image is"
        mend = f"say it: `{asked}: {{file: {wanted.file}, width: 640, height: 480}}`"
        raise bad_input("missing-key", message, Place(part.path), mend=mend)
    if told not in (None, size):
        message = f"the file is of an image of {size} pixels, `{asked}` of {told}"
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
    is_matrix = isinstance(numbers, list) and len(numbers) == 12 and all(isinstance(n, int | float) for n in numbers)
    if not is_matrix or not any(numbers):  # drivers write an unknown one as zeros
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
        has = f"`camera_matrix` has ({K[0, 2]:g}, {K[1, 2]:g}) in an image of {size[0]} x {size[1]} pixels"
        why = f"found the principal point ({P[0, 2]:g}, {P[1, 2]:g}), {has}"
    if why:
        message = f"{why}; expected that of the rectified image of this camera. It is not used, `camera_matrix` is"
        mend = "is the file put together from two cameras?"
        yield replace(document.problem("doubtful-projection", (key,), message, mend), severity="warning")


def _distortion(
    document: SourceDocument, stated: formats.StatedLens, K: Array, size: PixelSize,
    told: DistortionModel | None, asked: str,
) -> tuple[DistortionModel, list[float]]:  # fmt: skip
    """The distortion model and all of its coefficients. told: the model by the workspace."""
    key, known = f"{asked.removesuffix('calibration')}distortion", formats.FACTS["distortions"]
    if stated.D is None and told != "none":
        near = [f"; `{name}` is not read" for name in document.data if re.search("dist|coef", str(name), re.IGNORECASE)]
        message = f"the file says nothing of the distortion of the lens{next(iter(near), '')}"
        mend = f"say `{key}: none` beside `calibration` if its images are straight, or name a file that has it"
        raise bad_input("missing-key", message, Place(document.path), mend=mend)
    D, model, at = list(stated.D or ()), stated.model or "", stated.at["model"]
    if told is not None and any(D) != (told != "none"):
        message = f"the coefficients are {', '.join(f'{number:g}' for number in D)}, but `{key}` is `{told}`"
        raise document.error("wrong-value", stated.at["D"], message, f"leave `{key}` out")
    if formats.shortened(model) in formats.FACTS["late"] and told is None:
        if (moved := _moved_by_order(D, K, size)) > 1e-9:
            message = f"`{model}` of librealsense with p1 and p2 is no known distortion model of ROS or OpenCV"
            how = (
                f"say `{key}: plumb_bob` beside `calibration`, as its ROS driver has it: that is {moved:.2g} pixels off"
            )
            raise document.error("unknown-distortion-model", at, message, how)
        told = "plumb_bob" if any(D) else "none"
    model, at = (told, stated.at["D"]) if told is not None else (model, at)
    short, count = formats.shortened(model), len(D)
    if short and short not in known:
        usual = formats.FORMATS[stated.format_name].get("named", ("plumb_bob", "rational_polynomial", "equidistant"))
        message = f"found `{model}`, which is no known distortion model; {expected_names(model, usual)}"
        raise document.error("unknown-distortion-model", at, message)
    ours, names, least = (*known.get(short, ("none", "k1 k2 p1 p2 k3 k4 k5 k6")), None)[:3]
    most = len(names.split())
    while count > most and not D[count - 1]:  # OpenCV writes zeros of models with 12 and 14
        count -= 1
    if short:
        fewest = 4 if told == "plumb_bob" else least or most
        check_count(document, stated.at["D"], model, 0 if told == "none" else count, range(fewest, most + 1))
        return ours, [*D[:count], *[0.0] * (DISTORTION_LENGTHS[ours] - count)][: DISTORTION_LENGTHS[ours]]
    if count in _OPENCV_MODELS or not any(D):
        return _OPENCV_MODELS.get(count, "none"), D[:count] if count in _OPENCV_MODELS else []
    message, how = f"found {len(D)} distortion coefficients, expected 4, 5 or 8", ""
    if count == 4:
        message = "with 4 distortion coefficients the file must say `distortion_model`"
        how = ("add `distortion_model: radtan` (k1, k2, p1, p2) or `distortion_model: fisheye` (k1, k2, k3, k4), "
               f"or say `{key}: plumb_bob` or `{key}: equidistant` beside `calibration`")  # fmt: skip
    elif count > 8:
        message += f", with zeros after them; number {count} is {D[count - 1]:g}"
        how = "calibrate without OpenCV's flags `CALIB_THIN_PRISM_MODEL` and `CALIB_TILTED_MODEL`"
    raise document.error("missing-key" if count == 4 else "wrong-length", stated.at["D"], message, how or None)


def _moved_by_order(D: Sequence[float], K: Array, size: PixelSize) -> float:
    """How far from plumb_bob librealsense shows a corner [pixels]: it moves by p1 and p2 after the radial terms."""
    corners = np.array([(u, v, 1.0) for u in (-0.5, size.width - 0.5) for v in (-0.5, size.height - 0.5)])
    x, y, _ = np.linalg.inv(K) @ corners.T
    k1, k2, p1, p2, k3 = (*D, *[0.0] * 5)[:5]
    s = x * x + y * y
    more = (1 + s * (k1 + s * (k2 + s * k3))) ** 2 - 1  # of the squares of x and y
    across, down = 2 * (p1 * x * y + p2 * x * x), 2 * (p1 * y * y + p2 * x * y)  # it leaves p2 s and p1 s as they are
    return float(np.hypot(K[0, 0] * more * across, K[1, 1] * more * down).max())

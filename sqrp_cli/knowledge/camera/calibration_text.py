"""The text of calibration files as keys and values with their places, whatever its syntax.

Recognised by content: YAML (with OpenCV's header and tags), JSON, OpenCV's XML, the INI files of `camera_calibration`
(`ost.txt`) and COLMAP's `cameras.txt`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.knowledge.text.input_file import decoded, read_input
from sqrp_cli.knowledge.text.json_file import json_document, parse_json
from sqrp_cli.knowledge.text.source import Data, KeyPath, SourceDocument, not_finite
from sqrp_cli.knowledge.text.xml_file import Element, parse_xml
from sqrp_cli.knowledge.text.yaml_file import MAX_BYTES, parse_yaml, top_key

_INI = re.compile(r"^[ \t]*\[[\w/. -]+\][ \t\r]*$", re.MULTILINE)
_INI_KEYS = re.compile(r"^[ \t]*(camera matrix|distortion)[ \t\r]*$", re.MULTILINE)
_INI_NAME = re.compile(r"(?!nan\b|inf\b)[a-z][a-z_ ]*")
_COLMAP = re.compile(r"\s*(?:#.*\n\s*)*\d+[ \t]+(?:[A-Z]+_?[A-Z_]+\s|[a-z_]+[ \t]+\d+[ \t]+\d+\s)")


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
    start = text.lstrip()[:1]
    if start == "<":
        # OpenCV's FileStorage in XML.
        tags: dict[str, bool] = {}
        for element in parse_xml(path, content, "opencv_storage").inside():
            tags[element.tag] = tags.get(element.tag, True) and not element.children
        root = parse_xml(path, content, "opencv_storage", frozenset(tag for tag, is_leaf in tags.items() if is_leaf))
        builder = _Builder(path, content)
        for child in root.children:
            builder.put(builder.data, (child.tag,), _xml_value(builder, child, (child.tag,)), child.place)
        return CalibrationText(builder.document(), "XML")
    if start == "{" and '"' in text:
        data = parse_json(path, text)
        if isinstance(data, dict):
            return CalibrationText(json_document(path, text, data), "JSON")
    if _INI.search(text) and _INI_KEYS.search(text):
        return CalibrationText(_ini(path, content, text), "INI")
    if _COLMAP.match(text):
        return CalibrationText(_colmap(path, content, text), "COLMAP")
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

    def document(self) -> SourceDocument:
        return SourceDocument(self.path, self.content, self.data, self.places, self.places)


def _numbers(text: str, place: Place) -> list[float]:
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


def _xml_value(builder: _Builder, element: Element, at: KeyPath) -> object:
    if not element.children:
        text = "".join(element.pieces).strip().strip('"')
        in_matrix = element.tag == "data"
        return _numbers(text, element.place) if in_matrix else _scalars(text)
    if all(child.tag == "_" for child in element.children):
        return [_xml_value(builder, child, (*at, index)) for index, child in enumerate(element.children)]
    found: Data = {}
    for child in element.children:
        builder.put(found, (*at, child.tag), _xml_value(builder, child, (*at, child.tag)), child.place)
    return found


def _scalars(text: str) -> object:
    """A number, several of them as a list, or text."""
    try:
        numbers = [int(word) if re.fullmatch(r"[-+]?\d{1,18}", word) else float(word) for word in text.split()]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else numbers or text


def _ini(path: Path, content: bytes, text: str) -> SourceDocument:
    """`ost.txt`: sections in brackets; each value in the lines below its name. A camera is a section with a matrix."""
    builder = _Builder(path, content)
    size: dict[str, tuple[str, Place]] = {}
    section, name, camera = "", "", None
    for number, line in enumerate(text.splitlines(), 1):
        words, place = line.split("#")[0].strip(), Place(path, number, 1)
        if words.startswith("["):
            section, name, camera = words.strip("[] "), "", None
        elif words and section == "image" and name in ("width", "height") and name not in size:
            size[name] = words, place
        elif _INI_NAME.fullmatch(words):
            name = words
            if name == "camera matrix":
                camera = _ini_camera(builder, section, size, place)
        elif words and camera is not None and name in ("camera matrix", "distortion"):
            key = "camera_matrix" if name == "camera matrix" else "distortion_coefficients"
            camera.setdefault(key, []).extend(_numbers(words, place))
            builder.places.setdefault((section, key), place)
    return builder.document()


def _ini_camera(builder: _Builder, name: str, size: dict[str, tuple[str, Place]], place: Place) -> Data:
    """A new camera, with the image size that was stated before it."""
    camera: Data = {}
    builder.put(builder.data, (name,), camera, place)
    for key, (words, at) in size.items():
        builder.put(camera, (name, f"image_{key}"), _scalars(words), at)
    return camera


def _colmap(path: Path, content: bytes, text: str) -> SourceDocument:
    """`cameras.txt`: number, model, width, height and parameters of a camera in a line."""
    builder = _Builder(path, content)
    for number, line in enumerate(text.splitlines(), 1):
        words, place = line.split("#")[0].split(), Place(path, number, 1)
        if not words:
            continue
        if len(words) < 5:
            message = "expected a camera in a line: its number, model, width, height and parameters"
            raise bad_input("wrong-length", message, place)
        camera: Data = {}
        builder.put(builder.data, (words[0],), camera, place)
        values = zip(("model", "width", "height"), (words[1], *map(_scalars, words[2:4])), strict=True)
        for key, value in (*values, ("params", _numbers(" ".join(words[4:]), place))):
            builder.put(camera, (words[0], key), value, place)
    return builder.document()

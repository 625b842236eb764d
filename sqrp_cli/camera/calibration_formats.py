"""Formats of calibration files: their text as keys and values, and what it says of a camera's lens.

Syntaxes are recognised by content: YAML (with OpenCV's header and tags), JSON, OpenCV's XML, sections with names and
values (`ost.txt` of `camera_calibration`, ZED's `.conf`, TOML), COLMAP's `cameras.txt`, arrays of NumPy, and numbers
alone. `calibration_formats.yaml` is the table of formats: the keys of a camera, and what gives each format away.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import AliasPath, BeforeValidator, Field

from sqrp_cli.camera.camera import PixelCount, PixelSize
from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.files.entries import MappingOr, Number, foreign
from sqrp_cli.files.input_file import decoded, read_input
from sqrp_cli.files.json_file import json_document, parse_json
from sqrp_cli.files.source import Data, KeyPath, SourceDocument, describe, not_finite
from sqrp_cli.files.units import as_number
from sqrp_cli.files.validation import misspelt, validate
from sqrp_cli.files.xml_file import Element, parse_xml
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml, read_yaml, top_key

FACTS = read_yaml(Path(__file__).with_suffix(".yaml")).data  # of formats and of distortion models
_INI = re.compile(r"^[ \t]*\[[\w/. -]+\][ \t\r]*$", re.MULTILINE)
_INI_KEYS = {"camera matrix": "camera_matrix", "distortion": "distortion_coefficients"}
_INI_KEY = re.compile(rf"^[ \t]*({'|'.join(_INI_KEYS)})[ \t\r]*$", re.MULTILINE)
_INI_NAME = re.compile(r"(?!nan\b|inf\b)[a-z][a-z_ ]*")
_INI_VALUE = re.compile(r"^[ \t]*([A-Za-z_][\w.]*)[ \t]*=[ \t]*([^#;\n\r]*)", re.MULTILINE)
Entries = Iterator[tuple[KeyPath, Any, Place]]  # of a file: each value, or a mapping or list to be filled, in its order
NUMPY = (b"PK\x03\x04", b"\x93NUMPY")  # how npz and npy files begin
_ZED = re.compile(r"\w*CAM_(\w+)")
_COLMAP_LINE = re.compile(r"\s*(?:#.*\n\s*)*\d+[ \t]+(?:[A-Z]+_?[A-Z_]+\s|[a-z_]+[ \t]+\d+[ \t]+\d+\s)")
_NUMBERS = re.compile(r"[-+\d.eEnaif\s]+\Z")


def read_calibration_text(path: Path, keys: Collection[str] = ()) -> tuple[SourceDocument, str]:
    """A calibration file as keys and values, and its syntax: YAML, XML, JSON, INI, conf, COLMAP, NumPy or text.

    keys: of another kind of file, of which one is at its top. Raises InputError, with the line, for text that is none
    of these, or is damaged.
    """
    content = read_input(path, MAX_BYTES)
    if content.startswith(NUMPY):
        return SourceDocument(path, content, read_arrays(path, content), {}, {}), "NumPy"
    if not keys:
        refuse_unread(path, content)
    text = decoded(path, content)
    plain = re.sub(r"#.*|[\[\],;]", " ", text)
    if re.match(r"\s*(?:\{|\[\s*[\[{])", text) and '"' in text:
        return json_document(path, text, parse_json(path, text)), "JSON"
    if text.lstrip().startswith("<"):
        elements = [*parse_xml(path, content, "opencv_storage").inside()]
        texts = frozenset(one.tag for one in elements) - {one.tag for one in elements if one.children}
        syntax, entries = "XML", _xml_entries(parse_xml(path, content, "opencv_storage", texts), ())
    elif _INI.search(text) and (_INI_KEY.search(text) or _INI_VALUE.search(text)):
        syntax, entries = "INI" if _INI_KEY.search(text) else "conf", _section_entries(path, text)
    elif _COLMAP_LINE.match(text):
        syntax, entries = "COLMAP", _colmap_entries(path, text)
    elif len(plain.split()) in (6, 7, 9, 12, 16) and _NUMBERS.match(plain):
        syntax, entries = "text", iter([(("K",), _row(plain, Place(path, 1, 1)), Place(path, 1, 1))])
    else:
        try:
            return parse_yaml(path, content, frozenset({"!!opencv-matrix"}), keys or TOP_KEYS, lists=True), "YAML"
        except InputError as error:
            if not keys and content.strip() and not top_key(TOP_KEYS).search(text):
                raise InputError(no_calibration(path)) from error
            raise

    data, places = Data(), dict[KeyPath, Place]()
    for at, value, place in entries:
        owner: Any = data
        for key in at[:-1]:
            owner = owner[key]
        if isinstance(owner, list):
            owner.append(value)
        elif at[-1] in owner:
            raise bad_input("duplicate-key", f"`{at[-1]}` is given twice, first in line {places[at].line}", place)
        else:
            owner[at[-1]] = value
        places[at] = place
    return SourceDocument(path, content, data, places, places), syntax


def read_arrays(path: Path, content: bytes) -> Data:
    """The arrays of an npy or npz file by name, as lists; that of an npy file is `array`. Objects are not read."""
    try:
        found = np.load(io.BytesIO(content), allow_pickle=False)
        arrays = {"array": found} if isinstance(found, np.ndarray) else {name: found[name] for name in found.files}
    except (ValueError, OSError, EOFError, KeyError, NotImplementedError, RuntimeError) as error:
        why = "it holds objects of Python" if "pickle" in str(error) else "it is damaged, or of something else"
        message, mend = f"cannot be read as arrays of NumPy: {why}", "`numpy.savez(FILE, K=K, dist=D)`"
        raise bad_input("unknown-calibration", message, Place(path), mend=f"save numbers alone: {mend}") from None
    numbers = {name: array for name, array in arrays.items() if array.dtype.kind in "iuf" and array.size <= 10_000}
    for name, array in numbers.items():
        if not np.isfinite(array).all():
            raise InputError(not_finite(Place(path), "nan", name))
    return {name: array.tolist() for name, array in numbers.items()}


def refuse_unread(path: Path, content: bytes, asked: str = "calibration") -> None:
    """Raises InputError for a file of a format that is known and not read, or of one that belongs to another key."""
    for pattern, what, mend in FACTS["unread"]:
        if f"at `{asked}`" not in mend and re.search(pattern, content[:20_000].decode("latin1"), re.MULTILINE):
            raise bad_input("unknown-calibration", f"this is {what}, which is not read here", Place(path), mend=mend)


def no_calibration(path: Path) -> Problem:
    """The problem of a file that is none of those read here."""
    known = ", ".join(row.partition(" | ")[0] for one in FORMATS.values() for row in one["files"])
    mend = "export it as one of these, or state `image: {width, height, fx, fy, cx, cy, distortion}` in the workspace"
    return Problem("unknown-calibration", f"found no camera; expected one of {known}", Place(path), mend=mend)


def _xml_entries(element: Element, at: KeyPath) -> Entries:
    """What is within an element, by the tags; `_` are the items of a list."""
    is_list = at and all(child.tag == "_" for child in element.children)
    for index, child in enumerate(element.children):
        path, text = (*at, index if is_list else child.tag), "".join(child.pieces).strip().strip('"')
        if child.children:
            yield path, [] if all(one.tag == "_" for one in child.children) else Data(), child.place
            yield from _xml_entries(child, path)
        else:
            yield path, _row(text, child.place) if child.tag == "data" else _scalars(text), child.place


def _colmap_entries(path: Path, text: str) -> Entries:
    """The cameras of COLMAP by their numbers."""
    for number, line in enumerate(text.splitlines(), 1):
        words, place = line.split("#")[0].split(), Place(path, number, 1)
        if words and len(words) < 5:
            message = "expected a camera in a line: its number, model, width, height and parameters"
            raise bad_input("wrong-length", message, place)
        if words:
            yield (words[0],), Data(), place
            values = (words[1], _scalars(words[2]), _scalars(words[3]), _row(" ".join(words[4:]), place))
            for key, value in zip(("model", "width", "height", "params"), values, strict=True):
                yield (words[0], key), value, place


def _section_entries(path: Path, text: str) -> Entries:
    """Sections in brackets, as in `ost.txt`, with values in the lines below a name, and as in ZED's `.conf`.

    The section `image` of the first has the size of the cameras after it; ZED names sections by the size.
    """
    section, name, sizes, rows = KeyPath(), "", dict[str, tuple[object, Place]](), dict[KeyPath, list[float]]()
    for number, line in enumerate(text.splitlines(), 1):
        words, place = line.split("#")[0].strip(), Place(path, number, 1)
        in_image = section == ("image",)
        if words.startswith("["):
            section, name = (words.split("]")[0].strip("[ \t"),), ""
            size = FORMATS["zed"]["sizes"].get(found[1]) if (found := _ZED.fullmatch(str(section[0]))) else None
            if section != ("image",):
                yield section, Data(), place
                own = {"image_width": (size[0], place), "image_height": (size[1], place)} if size else sizes
                yield from (((*section, key), *stated) for key, stated in own.items())
        elif in_image and words and name in ("width", "height") and f"image_{name}" not in sizes:
            sizes[f"image_{name}"] = _scalars(words), place
        elif (match := _INI_VALUE.match(line)) and not in_image:
            yield (*section, match[1]), _scalars(re.sub(r"[\[\],\"]", " ", match[2]).strip()), place
        elif _INI_NAME.fullmatch(words):
            name = words
        elif words and name in _INI_KEYS and not in_image:
            if (at := (*section, _INI_KEYS[name])) not in rows:
                yield at, rows.setdefault(at, []), place
            rows[at] += _row(words, place)


def _row(text: str, place: Place) -> list[float]:
    """The numbers of a text. Raises InputError for anything else."""
    for word in text.split():
        if math.isnan(number := as_number(word)) and word.lower().strip("+-") != "nan":
            raise bad_input("wrong-type", f"found `{word}`, expected a number", place)
        if not math.isfinite(number):
            raise InputError(not_finite(place, word))
    return [float(word) for word in text.split()]


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
    """What a file says of a camera's lens; None where it says nothing of distortion, names no model, or has no size."""

    K: Sequence[float]  # The camera matrix, row by row [pixels]
    D: Sequence[float] | None
    model: str | None
    size: PixelSize | None
    at: Mapping[str, KeyPath]  # Where each of these is
    format_name: str


class CameraInFile(NamedTuple):
    """A camera of a file, by its keys."""

    at: KeyPath  # The mapping that has it
    words: Mapping[str, KeyPath]  # Of each word that the table knows, the path in that mapping
    mark: str  # Which of the cameras of that mapping; empty for the only one


FORMATS: Mapping[str, Any] = FACTS["formats"]
"""By name, as `calibration_formats.yaml` says. `files`: rows of the reference."""
_Numbers = Annotated[list[Number], BeforeValidator(lambda value: flat(flat(value)))]
_Count = Annotated[int, Field(strict=True, ge=0)]
_Matrix = foreign(rows=(_Count | None, None), cols=(_Count | None, None), data=_Numbers)
_Matrices: Any = MappingOr[_Matrix, _Numbers]  # type: ignore[misc, valid-type]
_Natural = (Annotated[int, Field(ge=0)], 0)
_Region = foreign(x_offset=_Natural, y_offset=_Natural, width=_Natural, height=_Natural)
# A list is OpenCV's, of the undistorted images that `getOptimalNewCameraMatrix` is for: it cuts nothing here.
_Cut = Annotated[_Region, BeforeValidator(lambda roi: {} if isinstance(roi, list) else roi)]  # type: ignore[valid-type]
_CUT = foreign(binning_x=_Natural, binning_y=_Natural, roi=(_Cut, Field(default_factory=_Region)))
_SHARED = ("size", "width", "height", "model", "kind")  # words that cameras of one mapping may have in common
_PINHOLE = ("fx", "fy", "cx", "cy")
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_Length = Annotated[PixelCount, BeforeValidator(lambda n: int(n) if isinstance(n, float) and n.is_integer() else n)]
_LISTS: dict[str, Any] = dict.fromkeys(("matrix", "D", "params", "projection"), _Matrices)
_LISTS["size"] = Annotated[list[_Length], Field(min_length=2, max_length=2)]
_TYPES = {**_LISTS, "width": _Length | None, "height": _Length | None, "model": str | None, "kind": Any}
"""Of the words of a camera; those of the others are numbers."""


def squashed(name: str) -> str:
    """A name as names are compared: `Camera_Matrix`, `cameraMatrix` and `camera-matrix` are the same."""
    return re.sub(r"[\s_.-]", "", name).lower()


def shortened(model: str) -> str:
    """The name of a model as names are compared, without what stands before a point."""
    return squashed(model.rsplit(".", 1)[-1])


_WORDS = {squashed(key): word for word, keys in FACTS["words"].items() for key in keys}
_MARKS = "|".join(FACTS["marks"])
_MARKED = (
    re.compile(rf"(?P<base>\w+?)_?(?P<mark>{_MARKS}|cam(?:era)?\d*|[lr\d])"),
    re.compile(rf"(?P<mark>{_MARKS}|cam(?:era)?\d*)(?P<base>\w+)"),
)
_TOP_WORDS = ("matrix", *_PINHOLE, "D", *_SHARED)
TOP_KEYS = (*FACTS["lens_keys"], *(key for word in _TOP_WORDS for key in FACTS["words"][word]))
"""Keys of which one is at the top of a calibration file in YAML, so that problems may quote it."""


def _words(data: Data, at: KeyPath = (), mark: str = "") -> Iterator[tuple[str, str, KeyPath]]:
    """The words that keys of a mapping, and of mappings under words for lists, stand for: mark, word and path."""
    for key, value in data.items():
        name = squashed(str(key))
        is_list = isinstance(value, list) and not (value and isinstance(value[0], dict))
        marked = [match.group("mark", "base") for one in _MARKED if (match := one.fullmatch(name))]
        for own, base in [("", name), *marked]:
            word = _WORDS.get(base)
            if word is None or (base == "m" and not own) or (word in _LISTS) != (is_list or isinstance(value, dict)):
                continue
            own = mark if own in ("", "cam", "camera") else own
            if isinstance(value, dict) and "data" not in value:
                yield from _words(value, (*at, str(key)), own)
            else:
                yield own, word, (*at, str(key))
            break


def cameras_in(data: object) -> list[CameraInFile]:
    """The cameras of a file, in its order; where none has a matrix or focal lengths, what lacks only these."""
    found, doubtful = list[CameraInFile](), list[CameraInFile]()
    waiting: list[tuple[KeyPath, object]] = [((), data)]
    while waiting:  # depth first
        at, held = waiting.pop()
        inside = held.items() if isinstance(held, dict) else enumerate(held) if isinstance(held, list) else ()
        by_mark: dict[str, dict[str, KeyPath]] = {"": {}}
        for mark, word, path in _words(held) if isinstance(held, dict) else ():
            by_mark.setdefault(mark, {}).setdefault(word, path)
        shared = by_mark[""]
        whole = [(mark, words) for mark, words in by_mark.items()
                 if words.keys() & {"matrix", "params", "projection", "fov"}
                 or len(words.keys() & {*_PINHOLE}) > 1]  # fmt: skip
        if whole:
            common = {word: path for word, path in shared.items() if word in _SHARED}
            found += [CameraInFile(at, {**common, **words}, mark) for mark, words in whole]
            continue
        is_within = any(at[: len(one.at)] == one.at for one in doubtful)
        if len(shared.keys() & {"D", "width", "height", "size"}) > 1 and not is_within:
            doubtful.append(CameraInFile(at, shared, ""))
        if len(at) < MOST_NESTED:
            waiting += [((*at, key), value) for key, value in inside][::-1]
    return found or doubtful


MOST_NESTED = 4  # levels of a file in which cameras are looked for


def format_of(camera: CameraInFile, part: SourceDocument, syntax: str) -> str:
    """The name of a camera's format."""
    if syntax == "COLMAP":
        return "colmap"
    if syntax == "conf" and part.within and _ZED.fullmatch(str(part.within[-1])):
        return "zed"
    keys = {squashed(str(key)) for path in [(), *camera.words.values()] for key in
            [*path, *(part.at(path[:-1]) if isinstance(part.at(path[:-1]), dict) else ())]}  # fmt: skip
    for name, row in FORMATS.items():
        if any(all(squashed(word) in keys for word in group.split()) for group in row.get("keys", ())):
            rows = part.at(camera.words.get("matrix", ("",)))
            return "camera_info" if name == "open3d" and isinstance(rows, list) and flat(rows) != rows else name
    return "camera_info"


def read_lens(camera: CameraInFile, part: SourceDocument, syntax: str, wanted: PixelSize | None) -> StatedLens:
    """What the file says of a camera. Raises InputError, with the line, for values of a wrong kind, count or model.

    part: the mapping that has it; wanted: the size of its image by the workspace.
    """
    at, name = dict(camera.words), format_of(camera, part, syntax)
    row = FORMATS[name]
    fields = {word: (_TYPES.get(word, Number), Field(validation_alias=AliasPath(*map(str, path))))
              for word, path in at.items()}  # fmt: skip
    values: dict[str, Any] = vars(validate(part, foreign(**fields)))
    for word in ("matrix", "D", "params", "projection"):
        if word in values and not isinstance(values[word], list):
            matrix, at[word] = values[word], (*at[word], "data")
            values[word], (rows, cols) = matrix.data, (matrix.rows, matrix.cols)
            if None not in (rows, cols) and rows * cols != len(matrix.data):
                expected = f"expected `rows` x `cols` = {rows} x {cols} = {rows * cols}"
                raise part.error("wrong-length", at[word], f"found {len(matrix.data)} numbers, {expected}")

    size = PixelSize.of(*(values.get("size") or (values.get("width"), values.get("height"))))
    at["size"] = next((at[word] for word in ("size", "width", "height") if word in at), ())
    model = _model(values, at, part, name)
    if "params" in values and "models" in row:
        size = _unfold(values, at, part, name, size, wanted)
    _derive(values, at, part, name, size or wanted or PixelSize(1, 1))  # an unknown size is asked for later
    K, size = _cut(_matrix(values, at, part), size, part, name)
    if row.get("corner"):
        K[2], K[5] = K[2] - 0.5, K[5] - 0.5
    D, model = _coefficients(values, at, part, name, model)
    if D is None and (row.get("pinhole") or model == "none"):
        D, model = [], None
    return StatedLens(K, D, model, size, at, name)


def _model(values: Mapping[str, Any], at: dict[str, KeyPath], part: SourceDocument, name: str) -> str | None:
    """The distortion model as the file calls it. Raises InputError for projections that are not read."""
    kind, row, where = values.get("kind"), FORMATS[name], at.get("kind", ())
    numbered = FACTS["numbered"].get(squashed(str(where[-1])) if where and name != "realsense" else name, ())
    kind = numbered[kind] if type(kind) is int and 0 <= kind < len(numbered) else kind
    short = "" if kind is None else shortened(str(kind))
    is_known = short in ("", *FACTS["plain"], *FACTS["distortions"])
    title = "" if name == "camera_info" else f" of {row['files'][0].partition(' | ')[0]}"
    if "models" in row and "params" in values and str(kind).upper() not in row["models"]:
        message = f"found `{kind}`, expected one of {', '.join(f'`{one}`' for one in row['models'])}"
        raise part.error("unknown-distortion-model", where or at["params"], message, row.get("mend"))
    if name != "colmap" and (short in FACTS["other"] or (row.get("strict") and not is_known)):
        message = (f"this is a camera{title} with the projection `{kind}`, which is not read; expected `pinhole`, "
                   "`fisheye` or `KANNALA_BRANDT`")  # fmt: skip
        mend = "calibrate it again with a pinhole or a fisheye (equidistant) model"
        raise part.error("unknown-distortion-model", where, message, mend)
    if values.get("model"):
        return str(values["model"])
    at["model"] = where
    if where and where[-1] in ("fisheye", "fisheye_model", "is_fisheye") and len(values.get("D", ())) == 4:
        return "fisheye" if short in ("1", "true", "yes", "on") else "radtan"
    is_told = short in FACTS["late"] or (is_known and short not in ("", *FACTS["plain"]))
    return str(kind) if is_told else None


def _unfold(
    values: dict[str, Any], at: dict[str, KeyPath], part: SourceDocument, name: str, *sizes: PixelSize | None
) -> PixelSize | None:
    """Give the parameters of COLMAP and of the Azure Kinect their names; returns the size of the image.

    sizes: by the file, and by the workspace.
    """
    model, (size, wanted) = str(values.get("kind")).upper(), sizes
    names = FORMATS[name]["models"][model].split()
    if len(values["params"]) != len(names):
        message = f"found {len(values['params'])} parameters, `{model}` has {len(names)}: {', '.join(names)}"
        raise part.error("wrong-length", at["params"], message)
    values |= zip(names, values["params"], strict=True)
    at |= dict.fromkeys((*_PINHOLE, *COEFFICIENTS), at["params"])
    if name == "colmap":
        values |= dict.fromkeys(("fx", "fy"), values["f"]) if "f" in values else {}
        return size
    mode = FORMATS[name]["modes"].get(str(wanted))
    if mode is None or size is None or size.width * mode[1] != size.height * mode[0]:
        message = f"which image of this sensor is it? Expected `width` and `height` of a mode, found {wanted or 'none'}"
        mend = f"say them, such as `width: 1280, height: 720`: one of {', '.join(FORMATS[name]['modes'])}"
        raise part.error("missing-key", at["params"], message, mend)
    for focal, centre, side, cut in zip(("fx", "fy"), ("cx", "cy"), mode[:2], mode[2:], strict=True):
        values[focal], values[centre] = values[focal] * side, values[centre] * side - cut - 0.5
    return wanted


def _derive(values: dict[str, Any], at: dict[str, KeyPath], part: SourceDocument, name: str, image: PixelSize) -> None:
    """Focal lengths and principal point where a file states them in another way, or leaves them out."""
    middle = [0.5 * side - (0.0 if FORMATS[name].get("corner") else 0.5) for side in image]
    if "projection" in values:  # of OpenGL, rows of points times matrix; the middle is 0
        P = values["projection"]
        if len(P) != 16 or abs(P[8]) > 1e-9 or abs(P[9]) > 1e-9:
            message = f"found {len(P)} numbers, expected 16, with the image in the middle of the aperture"
            raise part.error("wrong-value", at["projection"], message)
        values |= zip(_PINHOLE, (0.5 * P[0] * image.width, 0.5 * P[5] * image.height, *middle), strict=True)
        at |= dict.fromkeys(_PINHOLE, at["projection"])
    if "fov" in values and "fx" not in values:
        values["fx"], at["fx"] = 0.5 * image.width / math.tan(0.5 * values["fov"]), at["fov"]
    if name == "nerfstudio":  # what it leaves out is in the middle, and square
        for word, value in zip(_PINHOLE[1:], (values.get("fx", 0.0), *middle), strict=True):
            values.setdefault(word, value)
            at.setdefault(word, at.get("fx", ()))


def _matrix(values: Mapping[str, Any], at: dict[str, KeyPath], part: SourceDocument) -> list[float]:
    """The camera matrix, row by row."""
    numbers, path = values.get("matrix"), at.get("matrix", at.get("fx", ()))
    stated, at["K"] = [word for word in _PINHOLE if word in values], path
    if numbers is None and len(stated) < len(_PINHOLE):
        missing = next(word for word in _PINHOLE if word not in values) if len(stated) > 1 else "camera_matrix"
        held = at[stated[0]][:-1] if len(stated) > 1 else ()
        owner = f"`{part.name(held)}`" if held or part.within else "the file"
        if missing in part.data:
            raise part.error("wrong-type", (missing,), f"found {describe(part.data[missing])}, expected 3 x 3 numbers")
        message = f"{owner} lacks the key `{missing}`{misspelt(missing, part.data)}"
        raise bad_input("missing-key", message, part.value_place(held) if held else part.key_place(()))
    if numbers is None or len(numbers) == 4:
        fx, fy, cx, cy = numbers or [values[word] for word in _PINHOLE]
        return [fx, values.get("skew", 0.0), cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    if len(numbers) not in (9, 12, 16):
        expected = "focal lengths and principal point: fx, fy, cx, cy" if path[-1] == "intrinsics" else "9: 3 x 3"
        raise part.error("wrong-length", path, f"found {len(numbers)} numbers, expected {expected}")
    K = np.array(numbers).reshape(-1, 3 if len(numbers) == 9 else 4)
    if K[0, 2] == 0 and K[1, 2] == 0 and (K[2, 0] or K[2, 1]):
        K = K.T  # column by column, as Open3D and MATLAB have it
    if K.shape[1] == 4 and (K[:3, 3].any() or K[3:, :3].any()):
        message = "found a projection matrix, expected the camera matrix alone: 3 x 3"
        raise part.error("wrong-length", path, message)
    return list(K[:3, :3].ravel().tolist())


def _cut(
    K: list[float], size: PixelSize | None, part: SourceDocument, name: str
) -> tuple[list[float], PixelSize | None]:
    """Matrix and size of the images of ROS, which are cut to `roi` and then binned, as `image_geometry` has it.

    Those of a message are of the full sensor; a `roi` without a size is all of it.
    """
    if name != "camera_info" or not {"roi", "binning_x", "binning_y"} & part.data.keys():
        return K, size
    cut: Any = validate(part, _CUT)
    roi, x, y = cut.roi, max(cut.binning_x, 1), max(cut.binning_y, 1)
    if size is not None:
        width, height = roi.width or size.width, roi.height or size.height
        if roi.x_offset + width > size.width or roi.y_offset + height > size.height:
            raise part.error("wrong-value", ("roi",), f"reaches out of the image of {size.short}")
        size = PixelSize(max(width // x, 1), max(height // y, 1))
    return [K[0] / x, K[1] / x, (K[2] - roi.x_offset) / x, K[3] / y, K[4] / y, (K[5] - roi.y_offset) / y, *K[6:]], size


def _coefficients(
    values: Mapping[str, Any], at: dict[str, KeyPath], part: SourceDocument, name: str, model: str | None
) -> tuple[list[float] | None, str | None]:
    """The distortion coefficients in the order of their model, and the model."""
    stated, known = [word for word in COEFFICIENTS if word in values], FACTS["distortions"]
    at.setdefault("D", at[stated[0]] if stated else ())
    if "D" in values or not stated:
        return values.get("D"), model
    ours, told, *_ = known.get(shortened(model or ""), ("", ""))
    if name == "nerfstudio" and ours not in ("equidistant", "rational_polynomial"):
        # Whatever the model, it has these, and a k4 for the eighth power of the radius, which OpenCV's is not.
        (ours, told, *_), model = known["opencv"], model or "OPENCV"
    if told:
        names = ["k2", "k3", "k4", "k5"] if "k5" in stated and "k1" not in stated else told.split()  # of camodocal
        missing = next((word for word in names[:4] if word not in values and word[0] == "k"), None)
        if missing and "projection_parameters" in part.data:
            raise part.error("missing-key", ("projection_parameters",), f"lacks the parameter `{missing}` of `{model}`")
        more = next((word for word in stated if word not in names and values[word]), None)
        if more is None:
            return [values.get(word, 0.0) for word in names], model
        if ours == "equidistant" or name == "nerfstudio":
            mend = "estimate it without: k4 is of the eighth power of the radius there" if ours == "plumb_bob" else None
            raise part.error("wrong-length", at[more], f"found {values[more]:g}, but `{model}` has only {told}", mend)
    if "k4" in stated and "p1" not in stated and "k5" not in stated:
        return [values.get(word, 0.0) for word in ("k1", "k2", "k3", "k4")], None
    D = [values.get(word, 0.0) for word in COEFFICIENTS]
    return D if any(D[5:]) else D[:5], None

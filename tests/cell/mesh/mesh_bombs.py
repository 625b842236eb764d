"""Small mesh files that are sound, and others that are not: what loaders take for gigabytes, hours or another mesh."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from random import Random

import numpy as np

CORNERS = [(x, y, z) for x in (0.0, 0.1) for y in (0.0, 0.1) for z in (0.0, 0.1)]
TRIANGLES = [
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
]  # fmt: skip
"""A cube of 10 cm."""

FINITE = r"finite numbers up to 3\.4e38"


@dataclass(frozen=True)
class Bomb:
    """A file that must be refused; says: what the refusal must contain, as a regular expression."""

    suffix: str
    content: bytes
    says: str


def binary_stl(count: int | None = None) -> bytes:
    """The cube; count: what the header says instead of 12."""
    facets = b"".join(
        struct.pack("<12fH", 0, 0, 0, *(number for corner in triangle for number in CORNERS[corner]), 0)
        for triangle in TRIANGLES
    )
    return bytes(80) + struct.pack("<I", len(TRIANGLES) if count is None else count) + facets


def text_stl() -> bytes:
    """The cube."""
    lines = ["solid cube"]
    for triangle in TRIANGLES:
        vertices = [f"      vertex {' '.join(map(str, CORNERS[corner]))}" for corner in triangle]
        lines += ["  facet normal 0 0 0", "    outer loop", *vertices, "    endloop", "  endfacet"]
    return "\n".join([*lines, "endsolid cube", ""]).encode()


def obj(more: str = "") -> bytes:
    """The cube, and more lines."""
    lines = [f"v {' '.join(map(str, corner))}" for corner in CORNERS]
    lines += [f"f {' '.join(str(corner + 1) for corner in triangle)}" for triangle in TRIANGLES]
    return ("\n".join(lines) + "\n" + more).encode()


def dae(nodes: str = '<node><instance_geometry url="#g"/></node>', library: str = "", declaration: str = "") -> bytes:
    """The cube with normals; nodes: of the scene. library: further libraries."""
    places = " ".join(str(number) for corner in CORNERS for number in corner)
    axes = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    corners = " ".join(f"{corner} 0" for triangle in TRIANGLES for corner in triangle)
    return f"""<?xml version="1.0" encoding="utf-8"?>
{declaration}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="places"><float_array id="places-array" count="24">{places}</float_array>
<technique_common><accessor source="#places-array" count="8" stride="3">
{axes}</accessor></technique_common></source>
<source id="normals"><float_array id="normals-array" count="3">0 0 1</float_array>
<technique_common><accessor source="#normals-array" count="1" stride="3">
{axes}</accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#places"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="NORMAL" source="#normals" offset="1"/>
<p>{corners}</p></triangles>
</mesh></geometry></library_geometries>
{library}<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
""".encode()


def sound_meshes() -> dict[str, bytes]:
    """The cube in every format and way of writing, by ending."""
    polygon = "f 1 2 4 3\nf -8 -7 -5\nl 1 2\np 1\no a\ng b\nusemtl c\ns off\n"
    return {
        "binary.stl": binary_stl(),
        "text.stl": text_stl(),
        "plain.obj": obj(),
        "polygon.obj": obj(polygon),
        "continued.obj": obj("vn 0 0 1\nf 1//1 2//1 \\\n  4//1\n"),
        "plain.dae": dae(),
        "doubled.dae": dae(
            '<node><instance_node url="#n"/><instance_node url="#n"/></node>',
            '<library_nodes><node id="n"><instance_geometry url="#g"/></node></library_nodes>',
        ),
    }


def _changed(content: bytes, old: bytes, new: bytes) -> bytes:
    if old not in content:
        raise AssertionError(f"{old!r} is not in the file")
    return content.replace(old, new, 1)


def _doubling(levels: int, first: str) -> str:
    """Nodes of which each places the one before it twice."""
    nodes = f'<node id="n0">{first}</node>' + "".join(
        f'<node id="n{level}">' + f'<instance_node url="#n{level - 1}"/>' * 2 + "</node>" for level in range(1, levels)
    )
    return f"<library_nodes>{nodes}</library_nodes>"


def dae_bombs() -> dict[str, Bomb]:
    """COLLADA files."""
    cube, edits = dae(), _DAE_EDITS
    bombs = {name: Bomb(".dae", _changed(cube, old, new), says) for name, (old, new, says) in edits.items()}
    place = '<node><instance_node url="#n{}"/></node>'
    geometry = '<instance_geometry url="#g"/>'
    deep = "<node>" * 500 + "</node>" * 500
    ring = '<library_nodes><node id="n0"><instance_node url="#n0"/></node></library_nodes>'
    chain = "".join(f'<node id="n{i}"><instance_node url="#n{i + 1}"/></node>' for i in range(1000))
    chain = f'<library_nodes>{chain}<node id="n1000">{geometry}</node></library_nodes>'
    laughs = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10 if i else "lol"}">' for i in range(10))
    corner = b'<input semantic="VERTEX" source="#v" offset="0"/>'
    numbers = b"<p>" + b"0 " * 100_000 + b"</p>"
    huge = b'<polygons count="1">' + corner + numbers + b"</polygons>"
    listed = b'<polylist count="1">' + corner + b"<vcount>100000</vcount>" + numbers + b"</polylist>"
    scenes = {
        "triangles without end": Bomb(".dae", b"<COLLADA>" + b"<triangles " * 100_000, "not well-formed"),
        "elements without end": Bomb(".dae", b"<COLLADA>" + b"<a/>" * 3_000_000, "more than 200,000 elements"),
        "instances of instances": Bomb(".dae", dae(place.format(29), _doubling(30, geometry)), "limit is 10,000"),
        "instances of nothing": Bomb(".dae", dae(place.format(29), _doubling(30, "")), "limit is 10,000"),
        "many instances": Bomb(".dae", dae(f"<node>{geometry}</node>" * 50_000), "limit is 10,000"),
        "node in itself": Bomb(".dae", dae(place.format(0), ring), "64 levels, or themselves"),
        "two nodes of one name": Bomb(".dae", dae(place.format(2), _doubling(3, geometry) * 2), "as 2 are called"),
        "nodes in a chain": Bomb(".dae", dae(place.format(0), chain), "64 levels"),
        "nodes in nodes": Bomb(".dae", dae(deep), "64 levels"),
        "entities": Bomb(".dae", dae(declaration=f"<!DOCTYPE c [{laughs}]>"), "entity"),
        "skin": Bomb(".dae", dae('<node><instance_controller url="#c"/></node>'), "skins"),
        "unknown geometry": Bomb(".dae", dae('<node><instance_geometry url="#h"/></node>'), "`#h`, which is not there"),
        "nothing placed": Bomb(".dae", dae("<node/>"), "no triangles"),
        "huge polygon": Bomb(".dae", _changed(cube, b"</mesh>", huge + b"</mesh>"), "100,000 corners"),
        "polylist of one": Bomb(".dae", _changed(cube, b"</mesh>", listed + b"</mesh>"), "100,000 corners"),
    }  # fmt: skip
    return bombs | scenes


_P = b"0 0 1 0 3 0 "
_DAE_EDITS: dict[str, tuple[bytes, bytes, str]] = {
    "huge index": (_P, b"0 0 1 0 399999999 0 ", "corner 3 .* VERTEX 399,999,999, expected one from 0"),
    "index one too large": (_P, b"0 0 1 0 8 0 ", "VERTEX 8, expected one from 0 to 7"),
    "index that wraps": (_P, b"0 0 1 0 18446744073709551616 0 ", "expected"),
    "negative index": (_P, b"0 0 1 0 -3 0 ", "corner 3 .* VERTEX -3, expected one from 0 to 7"),
    "word for an index": (_P, b"0 0 1 0 x 0 ", "number 5 is `x`"),
    "digits without end": (_P, b"0 0 1 0 " + b"9" * 5000 + b" 0 ", "expected"),
    "index too many": (_P, b"0 0 0 1 0 3 0 ", "multiple of 2"),
    "triangle missing": (b"<p>0 0 1 0 3 0", b"<p>", "`count` is 12"),
    "count of billions": (b'<triangles count="12"', b'<triangles count="4000000000"', "`count`"),
    "count of 5,000 digits": (b'<triangles count="12"', b'<triangles count="' + b"9" * 5000 + b'"', "`count`"),
    "count missing": (b'<triangles count="12"', b"<triangles", "no `count`"),
    "count negative": (b'<triangles count="12"', b'<triangles count="-12"', "`count`"),
    "array of billions": (b'count="24"', b'count="900000000"', "found 24 numbers, expected 900,000,000"),
    "array too short": (b'count="24"', b'count="25"', "found 24 numbers, expected 25"),
    "array too long": (b'count="24"', b'count="23"', "found 24 numbers, expected 23"),
    "array of 5,000 digits": (b'count="24"', b'count="' + b"9" * 5000 + b'"', "`count`"),
    "array not finite": (b"0.0 0.0 0.1", b"0.0 nan 0.1", "point 2 is `nan nan nan`, expected " + FINITE),
    "array too large": (b"0.0 0.0 0.1", b"0.0 1e39 0.1", r"point 2 is `0 1e\+39 0.1`, expected " + FINITE),
    "array with a word": (b"0.0 0.0 0.1", b"0.0 O.0 0.1", "number 5 is `O.0`"),
    "accessor beyond": (b'count="8" stride="3"', b'count="9" stride="3"', "9 x 3 numbers, .* of 24"),
    "accessor of billions": (b'count="8" stride="3"', b'count="800000000" stride="3"', "800,000,000 x 3 numbers"),
    "accessor negative": (b'count="8" stride="3"', b'count="-8" stride="3"', "`count`"),
    "stride too large": (b'count="8" stride="3"', b'count="8" stride="4"', "8 x 4 numbers, .* of 24"),
    "stride too small": (b'count="8" stride="3"', b'count="8" stride="1"', "8 x 1 numbers"),
    "stride zero": (b'count="8" stride="3"', b'count="8" stride="0"', "8 x 0 numbers"),
    "offset in the array": (b'count="8" stride="3"', b'count="8" stride="3" offset="4"', "4 . 8 x 3 numbers"),
    "offset of an input": (b'"#normals" offset="1"', b'"#normals" offset="99999999"', "multiple of 100,000,000"),
    "offset too large": (b'source="#normals" offset="1"', b'source="#normals" offset="3"', "its <p> has 18"),
    "no positions": (b'semantic="POSITION"', b'semantic="NORMAL"', "POSITION"),
    "no vertices": (b'semantic="VERTEX"', b'semantic="TEXCOORD"', "no input of the semantic `VERTEX`"),
    "indices in a comment": (b"<p>0 0 1", b"<p>0 0<!-- --> 1", "interrupted"),
    "indices in pieces": (b"<p>0 0 1", b"<p>0 0<a/> 1", "interrupted"),
    "list before its inputs": (b'<input semantic="NORMAL" source="#normals" offset="1"/>', b"<p/>", "its <p> has 72"),
    "transformation": (b"<node><instance", b"<node><matrix>1 0 0</matrix><instance", "expected 16"),
}  # fmt: skip


def obj_bombs() -> dict[str, Bomb]:
    """OBJ files; the cube has 20 lines."""
    lines = {
        "face of 100,000 corners": (
            "f" + " 1" * 100_000,
            "21: found a polygon with 100,000 corners, expected 3 to 1,000",
        ),
        "corner 0": ("f 0 1 2", "21: found the vertex 0"),
        "corner too large": ("f 1 2 9", "21: found the vertex 9, of 8"),
        "corner too negative": ("f -9 1 2", "21: found the vertex -9, of 8"),
        "corner of 5,000 digits": ("f 1 2 " + "9" * 5000, "21: found the face `1 2 9999"),
        "corner of a word": ("f 1 2 x", "21: found the face `1 2 x`"),
        "face of two": ("f 1 2", "21: found a polygon with 2 corners"),
        "vertex of two": ("v 1 2", "21: found the vertex `1 2`, expected three numbers"),
        "vertex not finite": ("v 1 2 1e999", "21: point 9 is `1 2 inf`, expected " + FINITE),
        "vertex too far": ("v 1 2 -1e39", r"21: point 9 is `1 2 -1e\+39`"),
        "vertex of words": ("v a b c", "21: found the vertex `a b c`"),
        "keyword": ("vv 1 2 3", "21: found `vv`, which is no keyword"),
        "a line without end": ("f 1 2" + " \\\n 3" * 100_000, "21: found a polygon with 100,002 corners"),
        "lines without end": ("\n" * 6_000_000, "more than 5,000,000 lines"),
    }
    return {name: Bomb(".obj", obj(line + "\n"), says) for name, (line, says) in lines.items()} | {
        "no face": Bomb(".obj", b"v 0 0 0\n", "no triangles"),
        "nothing": Bomb(".obj", b"", "no triangles"),
    }


def stl_bombs() -> dict[str, Bomb]:
    """STL files; a triangle in text has 7 lines."""
    text, binary = text_stl(), binary_stl()
    return {
        "count of billions": Bomb(".stl", binary_stl(4_000_000_000), "header promises 4,000,000,000 triangles"),
        "cut off": Bomb(".stl", binary[:-50], "header promises 12 triangles"),
        "no triangle": Bomb(".stl", bytes(84), "no triangles"),
        "less than a header": Bomb(".stl", bytes(10), "10 bytes"),
        "not finite": Bomb(
            ".stl", binary[:96] + struct.pack("<f", np.nan) + binary[100:], f"point 1 is `nan 0 0`, expected {FINITE}"
        ),
        "text cut off": Bomb(".stl", text[:-200], "cut off"),
        "text without end": Bomb(".stl", _changed(text, b"endsolid cube", b""), "cut off"),
        "word": Bomb(".stl", _changed(text, b"vertex", b"vertx"), "2: expected `endsolid`, or a triangle"),
        "vertex missing": Bomb(
            ".stl", _changed(text, b"      vertex 0.0 0.0 0.0\n", b""), "2: expected `endsolid`, or a triangle"
        ),
        "number": Bomb(".stl", _changed(text, b"0.1", b"O.1"), "2: a corner of this triangle is not three numbers"),
        "number not finite": Bomb(
            ".stl", _changed(text, b"0.1", b"1e999"), "2: point 2 is `0 0 inf`, expected " + FINITE
        ),
        "number too large": Bomb(
            ".stl", _changed(text, b"0.1", b"1e39"), r"2: point 2 is `0 0 1e\+39`, expected " + FINITE
        ),
        "facets without end": Bomb(".stl", b"solid x\n" + b"facet normal " * 100_000, "no triangles"),
        "blanks without end": Bomb(".stl", b"solid x\n" + b" " * 1_000_000 + b"endfacet", "2: expected `endsolid`"),
    }


def bombs() -> dict[str, Bomb]:
    """All of them, by what is wrong with them."""
    named = {"dae": dae_bombs(), "obj": obj_bombs(), "stl": stl_bombs()}
    return {f"{kind}: {name}": bomb for kind, group in named.items() for name, bomb in group.items()}


_NUMBER = re.compile(rb"(?<![\w.#-])-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_VALUES = (b"-1", b"0", b"1", b"3", b"7", b"8", b"255", b"65536", b"2147483647", b"4294967295", b"99999999999999999999")
_VALUES += (b"1e38", b"1e300", b"nan", b"x", b"")


def mutated(content: bytes, random: Random) -> bytes:
    """A mesh file with one damage: a number, a byte, or a piece that is lost, doubled or moved."""
    at, length = random.randrange(len(content)), random.choice([1, 2, 5, 20, 100, 1000])
    piece = content[at : at + length]
    match random.randrange(7):
        case 0 | 1 | 2:
            begin = random.randrange(len(content))
            number = _NUMBER.search(content, begin) or _NUMBER.search(content)
            if number is not None:
                return content[: number.start()] + random.choice(_VALUES) + content[number.end() :]
            return content[:at] + bytes([random.randrange(256)]) + content[at + 1 :]
        case 3:
            return content[:at] + bytes([content[at] ^ (1 << random.randrange(8))]) + content[at + 1 :]
        case 4:
            return content[:at] + content[at + length :]
        case 5:
            return content[:at] + piece + content[at:]
        case _:
            return content[:at]

"""Small mesh files that are sound, and others that are not: what loaders take for gigabytes, hours or another mesh."""

from __future__ import annotations

import re
import struct

import numpy as np

from tests.cells import FILES

Bomb = tuple[bytes, str]
"""A file that must be refused, and what the refusal must contain, as a regular expression."""


def binary_stl(count: int | None = None) -> bytes:
    """The cube; count: what the header says instead of 12."""
    numbers = np.array(re.findall(rb"vertex (\S+) (\S+) (\S+)", text_stl()), dtype="<f4").reshape(12, 9)
    facets = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in numbers)
    return bytes(80) + struct.pack("<I", 12 if count is None else count) + facets


def text_stl() -> bytes:
    """The cube."""
    return (FILES / "cube.stl").read_bytes()


def obj(more: str = "") -> bytes:
    """The cube, and more lines."""
    return (FILES / "cube.obj").read_bytes() + more.encode()


PLACED = '<node><instance_geometry url="#g"/></node>'


def dae(nodes: str = PLACED, library: str = "", declaration: str = "") -> bytes:
    """The cube with normals; nodes: of the scene. library: further libraries."""
    scenes = "<library_visual_scenes>"
    text = (FILES / "cube.dae").read_text().replace(scenes, library + scenes).replace(PLACED, nodes)
    return text.replace("<COLLADA", declaration + "<COLLADA").encode()


def sound_meshes() -> dict[str, bytes]:
    """The cube in every format and way of writing, by ending."""
    polygon = "f 1 2 4 3\nf -8 -7 -5\nl 1 2\np 1\no a\ng b\nusemtl c\ns off\n"
    twice = '<node><instance_node url="#n"/><instance_node url="#n"/></node>'
    library = '<library_nodes><node id="n"><instance_geometry url="#g"/></node></library_nodes>'
    return {
        "binary.stl": binary_stl(), "text.stl": text_stl(), "plain.obj": obj(), "polygon.obj": obj(polygon),
        "continued.obj": obj("vn 0 0 1\nf 1//1 2//1 \\\n  4//1\n"), "plain.dae": dae(),
        "doubled.dae": dae(twice, library),
    }  # fmt: skip


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
    """COLLADA files that are large, or place their parts in odd ways."""
    cube = dae()
    place = '<node><instance_node url="#n{}"/></node>'
    geometry = '<instance_geometry url="#g"/>'
    deep = "<node>" * 500 + "</node>" * 500
    ring = '<library_nodes><node id="n0"><instance_node url="#n0"/></node></library_nodes>'
    chain = "".join(f'<node id="n{i}"><instance_node url="#n{i + 1}"/></node>' for i in range(1000))
    chain = f'<library_nodes>{chain}<node id="n1000">{geometry}</node></library_nodes>'
    laughs = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10 if i else "lol"}">' for i in range(10))
    triangles = re.findall(rb"<p>(.*)</p>", cube)[0]
    many = cube.replace(triangles, (triangles + b" ") * 65_536)
    corner = b'<input semantic="VERTEX" source="#v" offset="0"/>'
    numbers = b"<p>" + b"0 " * 100_000 + b"</p>"
    huge = b'<polygons count="1">' + corner + numbers + b"</polygons>"
    listed = b'<polylist count="1">' + corner + b"<vcount>100000</vcount>" + numbers + b"</polylist>"
    return {
        "triangles without end": (b"<COLLADA>" + b"<triangles " * 100_000, "not well-formed"),
        "elements without end": (b"<COLLADA>" + b"<a/>" * 201_000, "more than 200,000 elements"),
        "instances of instances": (dae(place.format(29), _doubling(30, geometry)), "limit is 10,000"),
        "instances of nothing": (dae(place.format(29), _doubling(30, "")), "limit is 10,000"),
        "many instances": (dae(f"<node>{geometry}</node>" * 12_000), "limit is 10,000"),
        "node in itself": (dae(place.format(0), ring), "64 levels, or themselves"),
        "two nodes of one name": (dae(place.format(2), _doubling(3, geometry) * 2), "as 2 are called"),
        "nodes in a chain": (dae(place.format(0), chain), "64 levels"),
        "nodes in nodes": (dae(deep), "64 levels"),
        "entities": (dae(declaration=f"<!DOCTYPE c [{laughs}]>"), "entity"),
        "skin": (dae('<node><instance_controller url="#c"/></node>'), "skins"),
        "unknown geometry": (dae('<node><instance_geometry url="#h"/></node>'), "`#h`, which is not there"),
        "nothing placed": (dae("<node/>"), "no triangles"),
        "huge polygon": (_changed(cube, b"</mesh>", huge + b"</mesh>"), "100,000 corners"),
        "many triangles": (many.replace(b'count="12"', b'count="786432"'), "786,432 triangles, the limit is 500,000"),
        "polylist of one": (_changed(cube, b"</mesh>", listed + b"</mesh>"), "100,000 corners"),
    }  # fmt: skip


def obj_bombs() -> dict[str, Bomb]:
    """OBJ files; the cube has 20 lines."""
    corners = "21: found a polygon with 100,00{} corners"
    return {
        "face of 100,000 corners": (obj("f" + " 1" * 100_000), corners.format("0") + ", expected 3 to 1,000"),
        "a line without end": (obj("f 1 2" + " \\\n 3" * 100_000), corners.format("2")),
        "lines without end": (obj("\n" * 6_000_000), "more than 5,000,000 lines"),
        "many faces": (obj("f 1 2 3\n" * 600_000), "600,012 triangles, the limit is 500,000"),
        "no face": (b"v 0 0 0\n", "no triangles"),
        "nothing": (b"", "no triangles"),
    }


def stl_bombs() -> dict[str, Bomb]:
    """STL files."""
    text, binary = text_stl(), binary_stl()
    nan, says = struct.pack("<f", np.nan), r"point 1 is `nan 0 0`, expected finite numbers up to 3\.4e38"
    return {
        "count of billions": (binary_stl(4_000_000_000), "header promises 4,000,000,000 triangles"),
        "cut off": (binary[:-50], "header promises 12 triangles"),
        "no triangle": (bytes(84), "no triangles"),
        "less than a header": (bytes(10), "10 bytes"),
        "not finite": (binary[:96] + nan + binary[100:], says),
        "text cut off": (text[:-200], "cut off"),
        "facets without end": (b"solid x\n" + b"facet normal " * 100_000, "no triangles"),
        "blanks without end": (b"solid x\n" + b" " * 1_000_000 + b"endfacet", "2: expected `endsolid`"),
    }


def bombs() -> dict[str, Bomb]:
    """All of them, by what is wrong with them."""
    named = {"dae": dae_bombs(), "obj": obj_bombs(), "stl": stl_bombs()}
    return {f"{kind}: {name}": bomb for kind, group in named.items() for name, bomb in group.items()}

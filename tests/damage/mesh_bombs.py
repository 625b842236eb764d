"""Meshes that say more than they hold, or hold more than they say: STL, OBJ and COLLADA."""

from __future__ import annotations

import struct
from collections.abc import Callable
from random import Random

from tests.cell.mesh.mesh_bombs import TRIANGLES
from tests.damage.bombs import TEXT, Bomb, edited, replaced, whole

CORNERS = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
"""A cube with sides of 1."""


def binary_stl(stated: int | None = None, corner: tuple[float, float, float] | None = None) -> bytes:
    """The cube as a binary STL; stated: triangles by its header. corner: in place of the first."""
    corners = [corner or CORNERS[0], *CORNERS[1:]]
    facets = (struct.pack("<12fH", 0, 0, 0, *(x for k in face for x in corners[k]), 0) for face in TRIANGLES)
    return bytes(80) + struct.pack("<I", len(TRIANGLES) if stated is None else stated) + b"".join(facets)


def obj() -> str:
    """The cube as an OBJ."""
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
    return "# a cube\n" + vertices + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in TRIANGLES)


def collada() -> str:
    """The cube as a COLLADA file."""
    positions = " ".join(str(x) for corner in CORNERS for x in corner)
    indices = " ".join(str(k) for face in TRIANGLES for k in face)
    return f"""\
<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset>
    <created>2026-01-01T00:00:00Z</created>
    <modified>2026-01-01T00:00:00Z</modified>
    <unit name="meter" meter="1"/>
    <up_axis>Z_UP</up_axis>
  </asset>
  <library_geometries>
    <geometry id="cube" name="cube">
      <mesh>
        <source id="positions">
          <float_array id="numbers" count="24">{positions}</float_array>
          <technique_common>
            <accessor source="#numbers" count="8" stride="3">
              <param name="X" type="float"/>
              <param name="Y" type="float"/>
              <param name="Z" type="float"/>
            </accessor>
          </technique_common>
        </source>
        <vertices id="corners"><input semantic="POSITION" source="#positions"/></vertices>
        <triangles count="12">
          <input semantic="VERTEX" source="#corners" offset="0"/>
          <p>{indices}</p>
        </triangles>
      </mesh>
    </geometry>
  </library_geometries>
  <library_visual_scenes>
    <visual_scene id="scene">
      <node id="node"><instance_geometry url="#cube"/></node>
    </visual_scene>
  </library_visual_scenes>
  <scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>
"""


def _appended(name: str, text: str | Callable[[], str]) -> Bomb:
    return edited(name, lambda content, _: content + (text if isinstance(text, str) else text()).encode())


BINARY_STL = (
    *(whole(f"header-of-{count}", lambda count=count: binary_stl(count)) for count in (0, 11, 13, 2**31, 2**32 - 1)),
    *(whole(f"corner-at-{x:g}", lambda x=x: binary_stl(corner=(x, 0.0, 0.0)))
      for x in (float("nan"), float("inf"), 1e38, -1e20, 1e9, 1e-38)),
    whole("flat", lambda: bytes(80) + struct.pack("<I", 10_000) + bytes(500_000)),
    whole("only-a-header", bytes(80)),
    whole("begins-as-text", lambda: b"solid " + binary_stl()[6:]),
    whole("text-of-one-line", b"solid " + b"x" * 5_000_000),
    whole("many", lambda: bytes(80) + struct.pack("<I", 1_900_000) + bytes(50 * 1_900_000)),
)  # fmt: skip

_FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"

TEXT_STL = (
    *TEXT,
    replaced("vertex-of-400-digits", "vertex -0.5", "vertex " + "9" * 400),
    replaced("vertex-of-100000-numbers", "vertex -0.5", "vertex " + "1 " * 100_000),
    replaced("loop-of-100000-vertices", "endloop", lambda: "vertex 0 0 0\n" * 100_000 + "endloop"),
    replaced("facets-without-vertices", "outer loop", lambda: "facet normal 0 0 1\n" * 100_000),
    replaced("facets-in-facets", "facet normal", lambda: "facet normal 0 0 1\nouter loop\n" * 50_000 + "facet normal"),
    replaced("solids", "solid cube", lambda: "solid x\nendsolid x\n" * 50_000 + "solid cube"),
    replaced("100000-facets", "endsolid", lambda: _FACET * 100_000 + "endsolid"),
    replaced("huge", "vertex -0.5", "vertex 1e30"),
    replaced("hexadecimal", "vertex -0.5", "vertex 0x1p3"),
    replaced("underscore", "vertex -0.5", "vertex 1_0"),
)

OBJ = (
    *TEXT,
    *(_appended(f"index-{index}", f"f 1 2 {index}\n") for index in ("99999999", "0", "-99999999", "2147483648",
        "9" * 5000)),
    _appended("index-1e9", "f 1 2 1e9\n"),
    _appended("face-of-100000-corners", "f" + " 1 2 3" * 33_000 + "\n"),
    _appended("100-faces-of-10000-corners", lambda: ("f" + " 1 2 3" * 3300 + "\n") * 100),
    _appended("face-of-one-corner", "f 1\n"),
    _appended("face-of-slashes", "f ///// ///// /////\n"),
    _appended("texture-indices", "f 1/99999999/99999999 2/1/1 3/1/1\n"),
    _appended("continued-lines", "f 1 2 \\\n" * 100_000),
    _appended("materials", "mtllib /dev/zero\nusemtl x\nmtllib ../../../../etc/passwd\n"),
    _appended("groups", lambda: "".join(f"g part{i}\nf 1 2 3\n" for i in range(20_000))),
    _appended("objects", lambda: "".join(f"o part{i}\nf 1 2 3\n" for i in range(20_000))),
    _appended("materials-used", lambda: "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(20_000))),
    _appended("vertices", "v 0 0 0\n" * 500_000),
    _appended("vertex-of-many-numbers", "v" + " 1" * 100_000 + "\n"),
    _appended("curves", "cstype bezier\ndeg 3\ncurv 0 1 1 2 3 4\nend\n"),
    whole("no-faces", "v 0 0 0\n" * 10),
    whole("no-vertices", "f 1 2 3\n" * 10),
    replaced("nan", "v -0.5", "v nan"),
    replaced("inf", "v -0.5", "v inf"),
    replaced("huge", "v -0.5", "v 1e30"),
)  # fmt: skip

_P = "<p>0 1 3"


def _instances(levels: int) -> str:
    """Nodes each of which has the one before twice: 2 ** levels cubes."""
    nodes = '<node id="n0"><instance_geometry url="#cube"/></node>'
    nodes += "".join(
        f'<node id="n{k}">{f"""<instance_node url="#n{k - 1}"/>""" * 2}</node>' for k in range(1, levels + 1)
    )
    return f"<library_nodes>{nodes}</library_nodes>"


def _nested(levels: int) -> Bomb:
    def edit(content: bytes, _random: Random) -> bytes:
        text = content.decode().replace("<library_visual_scenes>", _instances(levels) + "<library_visual_scenes>")
        return text.replace(
            '<instance_geometry url="#cube"/></node>\n    </visual',
            f'<instance_node url="#n{levels}"/></node>\n    </visual',
        ).encode()

    return edited(f"instances-2^{levels}", edit)


_ENTITIES = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">' + "".join(
    f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(10)
)

COLLADA = (
    *TEXT,
    *(replaced(f"index-{name}", _P, f"<p>0 1 {index}") for name, index in (
        ("99999999", "99999999"), ("-1", "-1"), ("2^31", "2147483648"), ("2^64", "18446744073709551616"),
        ("of-5000-digits", "9" * 5000), ("1e9", "1e9"), ("nan", "nan"))),
    *(replaced(f"count-{name}", 'triangles count="12"', f'triangles count="{count}"') for name, count in (
        ("of-5000-digits", "9" * 5000), ("-1", "-1"), ("2^32", str(2**32)), ("0", "0"), ("empty", ""), ("word",
            "many"))),
    replaced("numbers-of-5000-digits", 'id="numbers" count="24"', f'id="numbers" count="{"9" * 5000}"'),
    replaced("stride-2^31", 'stride="3"', 'stride="2147483647"'),
    replaced("stride-0", 'stride="3"', 'stride="0"'),
    replaced("offset-2^31", 'offset="0"', 'offset="2147483647"'),
    replaced("offset-word", 'offset="0"', 'offset="none"'),
    replaced("no-such-source", 'source="#corners"', 'source="#nowhere"'),
    replaced("source-of-itself", 'source="#positions"', 'source="#corners"'),
    replaced("triangles-without-end", '<triangles count="12">', lambda: "<triangles " * 100_000),
    replaced("100000-lists", "<vertices id", lambda: '<triangles count="0"/>' * 100_000 + "<vertices id"),
    replaced("indices", _P, lambda: "<p>" + "0 1 2 " * 300_000 + "0 1 3"),
    replaced("polygon-of-100000-corners", '<triangles count="12">', lambda: (
        '<polylist count="1"><input semantic="VERTEX" source="#corners" offset="0"/><vcount>100000</vcount><p>'
        + "0 1 2 3 " * 25_000 + '</p></polylist><triangles count="12">')),
    replaced("corners-of-5000-digits", '<triangles count="12">', lambda: (
        '<polylist count="1"><input semantic="VERTEX" source="#corners" offset="0"/><vcount>' + "9" * 5000
        + '</vcount><p>0 1 2</p></polylist><triangles count="12">')),
    replaced("negative-corners", '<triangles count="12">', (
        '<polylist count="2"><input semantic="VERTEX" source="#corners" offset="0"/><vcount>-3 3</vcount>'
        '<p>0 1 2</p></polylist><triangles count="12">')),
    replaced("unit-1e300", 'meter="1"', 'meter="1e300"'),
    replaced("unit-0", 'meter="1"', 'meter="0"'),
    replaced("unit-nan", 'meter="1"', 'meter="nan"'),
    replaced("nested-nodes", '<node id="node">', lambda: "<node>" * 50_000 + '<node id="node">'),
    replaced("nodes-in-nodes", '<node id="node"><instance_geometry url="#cube"/></node>', lambda: (
        "<node>" * 60 + '<instance_geometry url="#cube"/>' + "</node>" * 60)),
    replaced("100000-instances", '<instance_geometry url="#cube"/>', '<instance_geometry url="#cube"/>' * 100_000),
    replaced("node-of-itself", '<instance_geometry url="#cube"/>', '<instance_node url="#node"/>'),
    replaced("scale-1e300", "<instance_geometry", "<scale>1e300 1e300 1e300</scale><instance_geometry"),
    replaced("matrix-of-nan", "<instance_geometry", f"<matrix>{'nan ' * 16}</matrix><instance_geometry"),
    replaced("entities", "<COLLADA", _ENTITIES + "]><COLLADA"),
    replaced("entity-of-a-file", "<COLLADA", '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><COLLADA'),
    replaced("attributes", "<COLLADA", lambda: "<COLLADA " + " ".join(f'a{k}="1"' for k in range(100_000))),
    replaced("images", "<library_geometries>", (
        '<library_images><image id="i"><init_from>/dev/zero</init_from></image></library_images><library_geometries>')),
    _nested(10), _nested(22), _nested(40), _nested(1000),
)  # fmt: skip

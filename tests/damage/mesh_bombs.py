"""Meshes that say more than they hold, or hold more than they say: STL, OBJ and COLLADA."""

from __future__ import annotations

import struct
from random import Random

from tests.cell.mesh.mesh_bombs import binary_stl
from tests.damage.bombs import TEXT, Bomb, edited, listed, whole


def _with_corner(x: float) -> bytes:
    """The cube as a binary STL whose first corner is elsewhere."""
    return binary_stl()[:96] + struct.pack("<f", x) + binary_stl()[100:]


BINARY_STL = (
    *(whole(f"header-of-{count}", lambda count=count: binary_stl(count)) for count in (0, 11, 13, 2**31, 2**32 - 1)),
    *(whole(f"corner-at-{x:g}", lambda x=x: _with_corner(x))
      for x in (float("nan"), float("inf"), 1e38, -1e20, 1e9, 1e-38)),
    whole("flat", lambda: bytes(80) + struct.pack("<I", 10_000) + bytes(500_000)),
    whole("only-a-header", bytes(80)),
    whole("begins-as-text", lambda: b"solid " + binary_stl()[6:]),
    whole("text-of-one-line", b"solid " + b"x" * 5_000_000),
    whole("many", lambda: bytes(80) + struct.pack("<I", 1_900_000) + bytes(50 * 1_900_000)),
)  # fmt: skip


def _nested(levels: int) -> Bomb:
    """Nodes each of which has the one before twice: 2 ** levels cubes."""
    nodes = "".join(
        f'<node id="n{k}">{f"""<instance_node url="#n{k - 1}"/>""" * 2}</node>' for k in range(1, levels + 1)
    )
    first = '<library_nodes><node id="n0"><instance_geometry url="#cube"/></node>'

    def edit(content: bytes, _random: Random) -> bytes:
        scenes, geometry = "<library_visual_scenes>", '<node id="node"><instance_geometry url="#cube"/>'
        text = content.decode().replace(geometry, f'<node id="node"><instance_node url="#n{levels}"/>')
        return text.replace(scenes, f"{first}{nodes}</library_nodes>{scenes}").encode()

    return edited(f"instances-2^{levels}", edit)


COLLADA = (*TEXT, *listed("collada"), *map(_nested, (10, 22, 40, 1000)))

"""What programs wrote and people or disks changed: logs, baselines, results, frames, schedulers, programs, meshes."""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Callable
from random import Random

from tests.cell.mesh.mesh_bombs import binary_stl
from tests.damage.bombs import TABLE, TEXT, YAML, Bomb, edited, listed, text_of, whole


def _again(content: bytes, random: Random) -> bytes:
    lines = content.split(b"\n")
    at = random.randrange(len(lines))
    return b"\n".join([*lines[:at], lines[at].replace(b"{", b'{"t": 1e300, ', 1), *lines[at + 1 :]])


JSON = (*TEXT, *listed("json"), edited("key-twice", _again))


def _in_header(name: str, **fields: object) -> Bomb:
    """A bomb that is other fields in the first line of a log."""

    def edit(content: bytes, _random: Random) -> bytes:
        first, rest = content.split(b"\n", 1)
        return json.dumps({**json.loads(first), **fields}).encode() + b"\n" + rest

    return edited(name, edit)


def _in_events(name: str, change: Callable[[dict[str, object]], None]) -> Bomb:
    """A bomb in every event of a log."""

    def edit(content: bytes, _random: Random) -> bytes:
        events = [json.loads(line) for line in content.splitlines()]
        for event in events:
            change(event)
        return b"\n".join(json.dumps(event).encode() for event in events) + b"\n"

    return edited(name, edit)


_LONG = {f"k{i}": "x" * 100 for i in range(1000)}

LOG = (
    *JSON,
    _in_header("10000-cameras", cameras=[f"cam{i}" for i in range(10_000)], rates={f"cam{i}": 5.0
        for i in range(10_000)}),
    _in_header("no-cameras", cameras=[], rates={}),
    _in_header("other-cameras", cameras=["x"], rates={"y": 1e-300}),
    _in_header("rate-1e300", rates={"cam1": 1e300, "cam2": 1e-300}),
    _in_header("rate-huge", rates={"cam1": 10**400}),
    _in_header("other-version", sqrp_log=10**30),
    _in_header("workspace-of-a-million", workspace="w" * 1_000_000),
    _in_header("workspace-of-signs", workspace="\ud800\u202e\x1b[2J\0"),
    _in_header("10000-steps", steps=[{"skill": "x", "parameters": {}, "time": 1.0}] * 10_000),
    _in_header("seed", seed=10**4000),
    _in_events("times-1e300", lambda event: event.update(t=1e300)),
    _in_events("times-0", lambda event: event.update(t=0.0)),
    _in_events("times-negative", lambda event: event.update(t=-1e9)),
    _in_events("more-fields", lambda event: event.update(_LONG)),
    _in_events("positions-1e300", lambda event: event.update(q=[1e300] * 6)),
    _in_events("no-positions", lambda event: event.update(q=[], joints=[])),
    _in_events("1000-joints", lambda event: event.update(q=[0.0] * 1000, joints=[f"j{i}" for i in range(1000)])),
    _in_events("1000-objects", lambda event: event.update(objects={f"o{i}": [0.0] * 6 + [1.0] for i in range(1000)})),
    _in_events("rotations-of-0", lambda event: event.update(objects={"g1": [0.0] * 7})),
    _in_events("held-by-nobody", lambda event: event.update(held="nobody")),
    _in_events("exposed-1e300", lambda event: event.update(exposed=1e300)),
    _in_events("exposed--1e9", lambda event: event.update(exposed=-1e9)),
    _in_events("one-kind", lambda event: event.update(event="state")),
    _in_events("attempts", lambda event: event.update(attempt=10**30, of=-1, number=10**30)),
    edited("reports", lambda content, _: content + content.splitlines()[-1] + b"\n"),
    edited("100-times", lambda content, _: content + b"\n".join(content.splitlines()[1:-1]) * 100),
    edited("reversed", lambda content, _: b"\n".join(content.splitlines()[::-1])),
)  # fmt: skip

ROWS = (
    edited("semicolons", lambda content, _: content.replace(b",", b";")),
    edited("more-columns", lambda content, _: content.replace(b"\n", b",1\n")),
    edited("fewer-columns", lambda content, _: re.sub(rb",[^,\n]*\n", b"\n", content)),
    edited("rows-reversed", lambda content, _: b"\n".join([content.splitlines()[0], *content.splitlines()[:0:-1]])),
    *TEXT,
)  # fmt: skip
FRAMES = (*listed("frames"), *ROWS)
JOINTS = (
    *ROWS,
    edited("no-times", lambda content, _: re.sub(rb"(?m)^[^,]*,", b"", content)),
    whole("500000-columns", lambda: b"t," + b",".join(b"c%d" % i for i in range(500_000)) + b"\n"),
    whole("commas", lambda: b"t,a\n" + b"," * 50_000_000),
)


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, depth: int = 8, color: int = 2, rows: bytes | None = None, *more: bytes) -> bytes:
    """A PNG of one colour; rows: in place of those that its header promises. more: chunks before them."""
    samples = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}.get(color, 3)
    row = b"\0" + bytes(width * samples * max(depth, 8) // 8)
    header = struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)
    data = zlib.compress(row * height if rows is None else rows)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + b"".join(more) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


PNG = (
    *(whole(f"header-{w}x{h}", lambda w=w, h=h: png(w, h, rows=b"\0" * 1000)) for w, h in (
        (0, 0), (1, 1), (96, 10**6), (30_000, 30_000), (100_000, 100_000), (2**31 - 1, 2**31 - 1))),
    whole("30000x30000", lambda: png(20_000, 8_000, rows=bytes(20_000 * 8_000))),
    whole("rows-of-a-gigabyte", lambda: png(96, 72, rows=bytes(300_000_000))),
    whole("no-rows", lambda: png(96, 72, rows=b"")),
    whole("grey", lambda: png(96, 72, 8, 0)),
    whole("16-bit", lambda: png(96, 72, 16, 2)),
    whole("alpha", lambda: png(96, 72, 8, 6)),
    whole("palette-missing", lambda: png(96, 72, 8, 3)),
    whole("wrong-depth", lambda: png(96, 72, 7, 2)),
    whole("wrong-color", lambda: png(96, 72, 8, 9)),
    whole("wrong-sum", lambda: png(96, 72)[:-40] + b"\0" * 40),
    whole("text-chunk", lambda: png(96, 72, 8, 2, None, chunk(b"zTXt", b"a\0\0"
        + zlib.compress(bytes(200_000_000))))),
    whole("profile", lambda: png(96, 72, 8, 2, None, chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(10_000_000))))),
    whole("chunks", lambda: png(96, 72, 8, 2, None, chunk(b"tEXt", b"a\0b") * 100_000)),
    whole("chunk-of-2^31", lambda: png(96, 72, 8, 2, None, struct.pack(">I", 2**31 - 1) + b"tEXt")),
    whole("jpeg", b"\xff\xd8\xff\xe0" + bytes(1000)),
    whole("gif", b"GIF89a" + b"\xff\xff\xff\xff" + bytes(1000)),
    whole("bmp", b"BM" + struct.pack("<IIIIiiHH", 100, 0, 54, 40, -(2**31), 2**31 - 1, 1, 24) + bytes(1000)),
    whole("tiff", b"II*\0" + struct.pack("<I", 8) + b"\xff\xff" + bytes(1000)),
    whole("exr", b"v/1\x01" + bytes(1000)),
    whole("pam", b"P6\n99999 99999\n255\n" + bytes(1000)),
    whole("hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 99999 +X 99999\n" + bytes(1000)),
    *TEXT,
)  # fmt: skip


_STEP = re.compile(r"^- task:.*", re.MULTILINE | re.DOTALL)


def _steps(count: int) -> Bomb:
    def edit(content: bytes, _random: Random) -> bytes:
        text = content.decode()
        step = _STEP.search(text)
        return (text + (step[0] if step else "") * (count - 1)).encode()

    return edited(f"{count}-steps", edit)


PROGRAM = (*TEXT, *YAML, *listed("program"), *map(_steps, (2, 100, 2000)))
TASK = "pickup object=r1 speed=0.5 lift=5cm"
TASKS = (*map(text_of, TABLE["tasks"]), "pickup \ud800", "pickup \udcff")
"""Tasks on the command line."""


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

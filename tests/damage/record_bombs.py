"""What programs wrote and people or disks changed: logs, baselines, results, frames, scheduler files, programs."""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Callable
from random import Random

from tests.damage.bombs import TEXT, YAML, Bomb, at_a, edited, replaced, whole

_TEXT_VALUE = re.compile(rb'"[^"\n]*"(?=[,}\]\n])')
_ANY_VALUE = re.compile(rb"(?<=: )[^,{\[\n]+(?=[,}\n])")


def _again(content: bytes, random: Random) -> bytes:
    lines = content.split(b"\n")
    at = random.randrange(len(lines))
    return b"\n".join([*lines[:at], lines[at].replace(b"{", b'{"t": 1e300, ', 1), *lines[at + 1 :]])


JSON = (
    *TEXT,
    at_a(_TEXT_VALUE, "surrogate", b'"\\ud800"'),
    at_a(_TEXT_VALUE, "surrogate-pair", b'"\\udc00\\ud800"'),
    at_a(_TEXT_VALUE, "controls", b'"\\u0000\\u001b[2J\\u0007"'),
    at_a(_TEXT_VALUE, "text-of-a-million", b'"' + b"x" * 1_000_000 + b'"'),
    *(at_a(_ANY_VALUE, name, value) for name, value in (
        ("nan-value", b"NaN"), ("infinity-value", b"-Infinity"), ("null-value", b"null"), ("true-value", b"true"),
            ("list-value", b"[]"), ("object-value", b"{}"),
        ("nested-value", b"[" * 900 + b"]" * 900), ("deep-value", b"[" * 100_000 + b"]" * 100_000),
        ("list-of-a-million", b"[" + b"0," * 1_000_000 + b"0]"), ("text-value", b'"1"'), ("minus-0", b"-0.0"),
        ("9999-digits", b"9" * 9999))),
    edited("key-twice", _again),
    whole("list-of-lists", b"[[[]]]"),
    whole("object", b"{}"),
    whole("two", b"{}{}"),
    whole("keys", lambda: json.dumps({f"k{i}": i for i in range(100_000)})),
    whole("byte-order-mark", b"\xef\xbb\xbf{}"),
)  # fmt: skip


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

BASELINE = (
    *JSON,
    replaced("sampling-of-code", "FixedCount(samples=2)", "__import__('os')"),
    replaced("sampling-1e999", "FixedCount(samples=2)", "FixedCount(samples=1e999)"),
    replaced("sampling-dots", "FixedCount(samples=2)", "FixedCount(samples=1.1.1)"),
    replaced("sampling-e", "FixedCount(samples=2)", "FixedStep(step=e)"),
    replaced("sampling-digits", "FixedCount(samples=2)", "Adaptive(tolerance=" + "9" * 500 + ")"),
    replaced("10000-workspaces", '"workspaces": {', lambda: '"workspaces": {' + "".join(
        f'"w{i}": {{"digest": "", "files": {{}}, "tasks": {{}}}},' for i in range(10_000))),
    replaced("10000-tasks", '"tasks": {', lambda: '"tasks": {' + "".join(
        f'"t{i}": {{"best": null, "ways": {{}}}},' for i in range(10_000))),
    replaced("task-of-a-surrogate", '"tasks": {', '"tasks": {"\\ud800": {"best": null, "ways": {}},'),
    replaced("best-of-nobody", '"best": "', '"best": "x'),
    replaced("time-1e300", '"time": ', '"time": 1e300, "x": '),
    replaced("q-1e300", '"q_eoi": 1.0', '"q_eoi": 1e300'),
)  # fmt: skip

FRAMES = (
    *(replaced(f"{name}-step", ",1,", f",{step},") for name, step in (
        ("5000-digits", "9" * 5000), ("arabic", "١"), ("real", "1.0"), ("underscore", "1_0"), ("negative", "-1"))),
    *(at_a(re.compile(rb"(?<=,)\d+\.\d+"), f"time-{name}", time) for name, time in (
        ("1e308", b"1e308"), ("1e999", b"1e999"), ("nan", b"nan"), ("5000-digits", b"9" * 5000), ("minus", b"-1"),
            ("word", b"x"))),
    *(at_a(re.compile(rb"cam\d-\d+\.png"), f"file-{name}", file) for name, file in (
        ("nul", b"a\0b.png"), ("long", b"x" * 5000), ("dots", b"../" * 3000), ("root", b"/"), ("zero", b"/dev/zero"),
            ("empty", b""),
        ("itself", b"frames.csv"), ("quoted", b'"a""b\n.png"'), ("unclosed", b'"'), ("pipe", b"/dev/stdin"))),
    edited("field-of-a-million", lambda content, _: content.replace(b",1,", b"," + b"1" * 1_000_000 + b",", 1)),
    edited("fields", lambda content, _: content + b"," * 1_000_000),
    edited("100000-rows", lambda content, _: content + b"x,y,1,0\n" * 100_000),
    edited("semicolons", lambda content, _: content.replace(b",", b";")),
    edited("more-columns", lambda content, _: content.replace(b"\n", b",1\n")),
    edited("fewer-columns", lambda content, _: re.sub(rb",[^,\n]*\n", b"\n", content)),
    edited("column-twice", lambda content, _: content.replace(b"camera,", b"camera,camera,")),
    edited("rows-reversed", lambda content, _: b"\n".join([content.splitlines()[0], *content.splitlines()[:0:-1]])),
    *TEXT,
)  # fmt: skip


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


def _address(name: str, address: object) -> Bomb:
    return whole(f"address-{name}", lambda: json.dumps({"type": "Scheduler", "id": "x", "address": address}))


SCHEDULER = (
    *JSON,
    *(_address(name, address) for name, address in (
        ("nowhere", "tcp://127.0.0.1:1"), ("port-99999", "tcp://127.0.0.1:99999"), ("port--1", "tcp://127.0.0.1:-1"),
        ("port-of-5000", "tcp://127.0.0.1:" + "9" * 5000), ("port-word", "tcp://127.0.0.1:port"), ("no-port",
            "tcp://127.0.0.1"),
        ("no-host", "tcp://:1"), ("empty", ""), ("scheme", "ftp://127.0.0.1:1"), ("tls", "tls://127.0.0.1:1"),
            ("ucx", "ucx://127.0.0.1:1"),
        ("ws", "ws://127.0.0.1:1"), ("inproc", "inproc://127.0.0.1/1/1"), ("six", "tcp://[::1]:1"), ("six-broken",
            "tcp://[::1:1"),
        ("number", 7), ("list", ["tcp://127.0.0.1:1"]), ("null", None), ("object", {}), ("surrogate",
            "tcp://127.0.0.1\ud800:1"),
        ("nul", "tcp://127.0.0.1\0:1"), ("two", "tcp://127.0.0.1:1,tcp://127.0.0.1:2"), ("schemes", "tcp://" * 1000
            + "127.0.0.1:1"),
        ("blank", "tcp:// 127.0.0.1:1"), ("arabic", "tcp://127.0.0.1:١"), ("unix", "unix:///tmp/x"), ("port-0",
            "tcp://127.0.0.1:0"))),
    replaced("no-address", '"address"', '"adress"'),
)  # fmt: skip

_STEP = re.compile(r"^- task:.*", re.MULTILINE | re.DOTALL)


def _steps(count: int) -> Bomb:
    def edit(content: bytes, _random: Random) -> bytes:
        text = content.decode()
        step = _STEP.search(text)
        return (text + (step[0] if step else "") * (count - 1)).encode()

    return edited(f"{count}-steps", edit)


PROGRAM = (
    *TEXT, *YAML,
    _steps(2), _steps(100), _steps(2000),
    replaced("time-1e300", "  time: ", "  time: 1e300 # "),
    replaced("time-1e9", "  time: ", "  time: 1e9 # "),
    replaced("end-1e300", "    end: ", "    end: 1e300 # "),
    replaced("breaks-of-100000", "breaks: [0.0,", lambda: "breaks: [0.0," + "0.5," * 100_000),
    replaced("no-breaks", "breaks: [0.0,", "breaks: [] # "),
    replaced("100-joints", "joints: [", lambda: "joints: [" + "".join(f"j{i}, " for i in range(100))),
    replaced("other-workspace", "workspace: ", "workspace: /dev/zero # "),
    replaced("workspace-of-dots", "workspace: ", "workspace: " + "../" * 3000 + "# "),
    replaced("workspace-nul", "workspace: ", 'workspace: "a\\0b" # '),
    replaced("workspace-folder", "workspace: ", "workspace: skills # "),
    replaced("other-version", "sqrp_program: 1", "sqrp_program: 99999999999999999999"),
    replaced("task-of-signs", "- task: ", '- task: "\\u202e\\e[2J\\0" # '),
    replaced("task-of-a-million", "- task: ", "- task: " + "x" * 1_000_000 + " # "),
)  # fmt: skip

TASK = "pickup object=r1 speed=0.5 lift=5cm"

TASKS = (
    "", " ", "\n", "\t", "\0", "pickup", "pickup \0", "pickup red\0", "p" * 100_000, "pickup " * 20_000, "pickup "
        + "r" * 100_000,
    "pickup red red", "pickup 红", "pickup \u202ered", "pickup \x1b[2J", "pickup \ud800", "pickup \udcff",
    "PICKUP RED", "pickup -red", "pickup --red",
    "-1", "--json", "pickup *", "pickup object=*", "pickup object=", "pickup =r1", "pickup =", "pickup object==r1",
    "pickup object=r1=r1",
    "pickup object=r1 object=r1", "pickup object=r1,", "pickup object=,r1", "pickup object=" + "r1," * 20_000 + "r1",
    "pickup object=g1,g2,g3,r1",
    "pickup lift=" + "1" * 400, "pickup lift=" + "1" * 5000, "pickup lift=1e999", "pickup lift=-1e999",
    "pickup lift=nan", "pickup lift=inf", "pickup lift=1e-320",
    "pickup lift=0x10", "pickup lift=1_0", "pickup lift=١", "pickup lift=1e300m", "pickup lift=5ccm",
    "pickup lift=5cm,6cm,7cm", "pickup lift=1e3",
    "pickup lift=" + ",".join(f"{k}mm" for k in range(1, 30)), "pickup lift=" + ",".join(f"{k / 1e4:g}"
        for k in range(1, 40_000)),
    "pickup speed=0", "pickup speed=1e-300", "pickup speed=1.0000001", "pickup speed=100%", "pickup elbow=",
    "pickup elbow=sideways", "pickup elbow=any,up,down",
    "pickup approach_yaw=1e18", "pickup approach_yaw=360deg", "pickup approach_yaw=" + "9" * 400 + "deg",
    "pickup {a: 1}", "pickup [1]", "pickup !!python/object:x y", "pickup &a *a", "pickup 'red", 'pickup "red',
    "pickup `red`", "pickup $(red)",
    "pickup;red", "pickup/red", "../pickup red", "pickup a=1 b=2 c=3", "pickup red at " + "a " * 1000, "pickup "
        + "a=b " * 10_000, "pickup " + "lift=5cm " * 2,
    "pickup lift=5cm,5.0cm", "pickup red speed=0.5,0.50", "pickup 1", "pickup 1e999", "pickup r1 g1", "pickup table",
    "pickup object=table", "pickup object=cam1",
    "place red", "hold(r1)", "(pickup r1)", "pickup(r1)", "pickup:red", "pickup,red", "pickup\u00a0red",
    "pickup\u3000red", "\ufeffpickup red", "pickup red\n\n\n",
)  # fmt: skip
"""Tasks on the command line."""

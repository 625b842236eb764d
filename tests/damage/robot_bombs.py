"""Robots that no one has built: long chains, thousands of shapes, limits without end. URDF and SRDF."""

from __future__ import annotations

from collections.abc import Callable

from tests.damage.bombs import TEXT, Bomb, replaced


def _more(name: str, text: Callable[[], str]) -> Bomb:
    return replaced(name, "</robot>", lambda: text() + "</robot>")


def chain(length: int, kind: str, parent: str) -> str:
    """Links one after another, below a link."""
    limit = "" if kind == "fixed" else '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
    return "".join(
        f'<link name="l{i}"/><joint name="k{i}" type="{kind}"><origin xyz="0 0 0.001"/>{limit}'
        f'<parent link="{f"l{i - 1}" if i else parent}"/><child link="l{i}"/></joint>'
        for i in range(length)
    )


def _boxes(count: int, size: float = 0.001) -> str:
    box = f'<geometry><box size="{size} {size} {size}"/></geometry>'
    return "".join(f'<collision><origin xyz="0 0 {i * 1e-6:g}"/>{box}</collision>' for i in range(count))


def _mimics(count: int) -> str:
    return "".join(
        f'<link name="m{i}"/><joint name="j{i}" type="revolute"><mimic joint="j{i + 1}"/><limit lower="-1" upper="1"/>'
        f'<parent link="flange"/><child link="m{i}"/></joint>'
        for i in range(count)
    )


def _limits() -> tuple[Bomb, ...]:
    pairs = [("-1e6", "1e6"), ("-1e18", "1e18"), ("-1e300", "1e300"), ("0", "0"), ("1", "-1"), ("nan", "nan")]
    old = '<limit lower="-2.6" upper="2.6"'
    turning = (replaced(f"limits-{b}", old, f'<limit lower="{a}" upper="{b}"') for a, b in pairs)
    faster = (replaced(f"velocity-{v}", 'velocity="2.0"', f'velocity="{v}"') for v in ("1e18", "1e-18", "-1", "nan"))
    return (*turning, *faster)


def _sliding(limit: str) -> Bomb:
    """A joint that slides without end, between the arm and its flange."""
    joint = f'<joint name="flange_joint" type="prismatic"><axis xyz="0 0 1"/><limit lower="-{limit}" upper="{limit}" '
    return replaced(f"slides-{limit}", '<joint name="flange_joint" type="fixed">', f'{joint} velocity="1" effort="1"/>')


def _meshes(reference: str) -> str:
    joint = '<joint name="mj" type="fixed"><parent link="flange"/><child link="m"/></joint>'
    return f'<link name="m"><visual><geometry><mesh filename="{reference}"/></geometry></visual></link>{joint}'


ARM = (
    *TEXT,
    _more("1950-links", lambda: chain(1950, "fixed", "flange")),
    _more("190-joints", lambda: chain(190, "revolute", "flange")),
    _more("1950-joints", lambda: chain(1950, "revolute", "flange")),
    _more("3000-links", lambda: chain(3000, "fixed", "flange")),
    _more("100000-links", lambda: "".join(f'<link name="l{i}"/>' for i in range(100_000))),
    _more("1950-links-aside", lambda: "".join(
        f'<link name="s{i}"/><joint name="t{i}" type="fixed"><parent link="flange"/><child link="s{i}"/></joint>'
        for i in range(1950))),
    _more("150-mimics", lambda: _mimics(150) + chain(0, "fixed", "flange")),
    replaced("20000-boxes", '<link name="flange"/>', lambda: f'<link name="flange">{_boxes(20_000)}</link>'),
    replaced("1000-boxes", '<link name="flange"/>', lambda: f'<link name="flange">{_boxes(1000)}</link>'),
    replaced("box-of-1e9", '<link name="flange"/>', lambda: f'<link name="flange">{_boxes(1, 1e9)}</link>'),
    replaced("box-of-1e-9", '<link name="flange"/>', lambda: f'<link name="flange">{_boxes(1, 1e-9)}</link>'),
    replaced("far-away", '<link name="flange"/>', lambda: '<link name="flange"><collision><origin xyz="1e9 0 0"/>'
             '<geometry><sphere radius="1"/></geometry></collision></link>'),
    *(replaced(f"joint-type-{name}", 'type="revolute"', f'type="{name}"') for name in ("floating", "planar", "fixed",
        "x")),
    *_limits(),
    *map(_sliding, ("1e6", "1e18", "1e300")),
    replaced("axis-of-nothing", '<axis xyz="', '<axis xyz="0 0 0"/><axis xyz="'),
    *(_more(f"mesh-{name}", lambda reference=reference: _meshes(reference)) for name, reference in (
        ("zero", "/dev/zero"), ("percent", "%00%ff.stl"), ("package", "package://no/where.stl"), ("url",
            "http://x/y.stl"),
        ("long", "x" * 5000 + ".stl"), ("home", "~nobody-of-that-name/x.stl"), ("folder", "."), ("empty", ""),
        ("format", "../workspace.yaml"))),
    _more("depth", lambda: "<a>" * 100_000),
    _more("attributes", lambda: "<a " + " ".join(f'a{k}="1"' for k in range(100_000)) + "/>"),
    _more("comment", lambda: "<!-- " + "x" * 9_000_000 + " -->"),
    _more("too-large", lambda: "<!-- " + "x" * 11_000_000 + " -->"),
)  # fmt: skip

TOOL = (*TEXT, *[bomb for bomb in ARM if bomb.name.startswith("depth") or bomb.name.startswith("attr")])

GROUPS = (
    *TEXT,
    _more("groups-of-groups", lambda: "".join(
        f'<group name="g{i}"><group name="g{i + 1}"/></group>' for i in range(3000)) + '<group name="g3000"/>'),
    _more("group-of-itself", lambda: '<group name="g"><group name="g"/></group>'),
    _more("groups-2^30", lambda: '<group name="g0"><joint name="joint_1"/></group>' + "".join(
        f'<group name="g{i}"><group name="g{i - 1}"/><group name="g{i - 1}"/></group>' for i in range(1, 30))),
    _more("100000-pairs", lambda: '<disable_collisions link1="base" link2="shoulder" reason="x"/>' * 100_000),
    _more("20000-states", lambda: "".join(
        f'<group_state name="s{i}" group="arm"><joint name="joint_1" value="0"/></group_state>'
            for i in range(20_000))),
    replaced("state-of-1e18", 'name="joint_2" value="0.1"', 'name="joint_2" value="1e18"'),
    replaced("state-of-1e300", 'name="joint_2" value="0.1"', 'name="joint_2" value="-1e300"'),
)  # fmt: skip

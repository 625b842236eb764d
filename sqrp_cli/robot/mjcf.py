"""MuJoCo's format: the URDF that an MJCF stands for, with its bodies as links, and what stands in a scene.

MuJoCo reads the file (https://mujoco.readthedocs.io/en/stable/XMLreference.html) with includes, defaults and frames,
and computes where everything is. Each mesh is a small sphere meanwhile: so a file is read in milliseconds, and shapes
keep the frame of the mesh's own file. MuJoCo is imported here once it is certain that it can be.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from os.path import relpath
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import InputError, Place, Problem, bad_input, first_names, no_such
from sqrp_cli.files.frames import WORLD
from sqrp_cli.files.xml_file import Element
from sqrp_cli.geometry import Array, displacement, matrix_to_rpy, pose, quaternion_to_matrix, read_only
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.platform.simulator import check_simulator
from sqrp_cli.records import dataclass
from sqrp_cli.robot.urdf import LinkShape
from sqrp_cli.shapes import Box, shape_of

if TYPE_CHECKING:
    import mujoco

NAMED = 5  # most names in a warning
MESH_ENDS = (".stl", ".obj")  # of the mesh files of MuJoCo that SQRP reads, too
LEAST_MASS = 1e-9  # of a body whose mass does not count [kg], and its inertia [kg m^2]
STAND_IN = 1e-3  # radius of the sphere that stands for a mesh [m]
Told = list[Any]  # an element: its tag, attributes, file, line, column and elements inside
Solid = tuple[LinkShape, Array]  # a shape with its pose, shape (4, 4)
Follower = tuple[int, float, float]  # the joint that one follows, the multiplier, and the offset [rad or m]
MeshFile = tuple[str, Array, Array]  # of a mesh, the scale along x, y, z, and its pose in a geom, shape (4, 4)

# Numbers of MuJoCo's C interface, which never change.
SLIDE, HINGE, JOINT_EQUALITY, JOINT_WRAP = 2, 3, 2, 1
JOINT_DRIVES, TENDON_DRIVE = (0, 1), 3
PLANE, SPHERE, ELLIPSOID, BOX = 0, 2, 4, 6
ROUND = {SPHERE: "sphere", 3: "capsule", 5: "cylinder"}


@dataclass(frozen=True, eq=False)
class Scene:
    """An MJCF as MuJoCo compiles it, without its meshes, and what of it a robot can be."""

    model: mujoco.MjModel
    meshes: Mapping[str, MeshFile | None]  # Of each geom that had one, by name; None for one that is left out
    weighed: frozenset[str]  # the bodies whose mass follows from no mesh
    unnamed: frozenset[str]  # the bodies to which the file gives no name
    path: Path
    lost: dict[str, list[str]]  # Names of what becomes something else, or nothing, by what is said about it

    @property
    def touching(self) -> NDArray[np.bool_]:
        """Of each geom, whether it can touch anything."""
        return np.asarray(self.model.geom_contype | self.model.geom_conaffinity, dtype=bool)


def mjcf_as_urdf(path: Path, root: Element) -> tuple[Told, tuple[Problem, ...]]:
    """The `<robot>` that an MJCF stands for, and warnings about what it says otherwise or not at all.

    root: of the file. The robot is every tree of bodies with a joint that an actuator moves, or without actuators with
    any joint. If there is one, and it begins with a body that is fixed or floats, that is the root, else the world is.
    Named sites are links. Raises InputError for a file that MuJoCo cannot read, or that has no such tree.
    """
    scene = _compiled(path, weighing=True)
    model, bases = scene.model, _bases(scene)
    bodies = [body for body in range(1, model.nbody) if model.body_rootid[body] in bases]
    own = {body: list[int]() for body in bodies}
    for body, joints in own.items():
        joints += range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        kinds = [(model.jnt_type[joint], bool(model.jnt_limited[joint])) for joint in joints]
        if not all(kind == HINGE or (kind == SLIDE and limited) for kind, limited in kinds):
            said = "bodies that float, turn about every axis or slide without limits stand still"
            scene.lost.setdefault(said, []).append(model.body(body).name)
            joints.clear()
    whole = len(bases) == 1 and not own[bases[0]]
    following, held = _followers(scene, {joint for joints in own.values() for joint in joints})
    told = [] if whole else [_told("link", {"name": WORLD})]
    taken = {model.body(body).name for body in range(model.nbody)}
    sites = {model.site(site).name for site in range(model.nsite)}
    for body in bodies:
        told.append(_link(scene, body))
        if len(told) > 1:  # it is not the root
            told += _joints_to(scene, body, own[body], following, held)
        for site in np.flatnonzero(model.site_bodyid == body).tolist():
            name = model.site(site).name
            if name and name not in taken and f"{re.sub('_[xyz]$', '', name)}_x" not in sites:  # those draw axes
                X_BS, link = _pose(model.site_pos[site], model.site_quat[site]), _told("link", {"name": name})
                told += [link, _joint(f"{name}/fixed", (model.body(body).name, name), X_BS)]

    warnings = []
    for said, names in scene.lost.items():
        warnings.append(Problem("mjcf", f"{said}: {first_names(names, NAMED)}", Place(path), severity="warning"))
    return _told("robot", {"name": root.attributes.get("model") or path.stem}, told), tuple(warnings)


def fixed_bodies(path: Path) -> tuple[list[tuple[str, list[Solid]]], Mapping[str, list[str]]]:
    """What stands in an MJCF: name and shapes, placed in the world, of the world's own geoms and of each body in it.

    With names of what becomes something else, or nothing, by what is said about it. Solid are the geoms of a body that
    touch something, or else all. Bodies with joints, and what they carry, are left out. Raises InputError for a file
    that MuJoCo cannot read.
    """
    scene = _compiled(path, weighing=False)
    model, X_WB = scene.model, [np.eye(4)]
    found, can_move = {0: (path.stem, list[Solid]())}, [False]
    for body in range(model.nbody):
        name, parent = model.body(body).name, model.body_parentid[body]
        if body > 0:
            X_WB.append(X_WB[parent] @ _pose(model.body_pos[body], model.body_quat[body]))
            can_move.append(can_move[parent] or bool(model.body_dofnum[body]))
        if can_move[body]:
            if not can_move[parent]:
                scene.lost.setdefault("bodies that can move are left out; state them as `objects`", []).append(name)
            continue
        base = int(model.body_rootid[body])
        if base == body > 0:
            found[base] = f"{path.stem}_body" if name in scene.unnamed else name, []
        solid = [geom for geom in _geoms(model, body) if scene.touching[geom]] or _geoms(model, body)
        placed = filter(None, (_solid(scene, geom) for geom in solid))
        found[base][1].extend((shape, read_only(X_WB[body] @ X_BG)) for shape, X_BG in placed)
    return [*found.values()], scene.lost


def _compiled(path: Path, *, weighing: bool) -> Scene:
    """The file as MuJoCo compiles it; bodies, joints and geoms without a name get one.

    weighing: whether masses count.
    """
    if find_spec("mujoco") is None:
        raise bad_input("missing-extra", "an MJCF needs the extra `sim`", Place(path), mend="pip install mujoco")
    with suppress(InputError):  # it finds out how it can draw while it is imported, but may also do without
        check_simulator()
    with interrupts_later():
        import mujoco
    kinds, lost = mujoco.mjtGeom, dict[str, list[str]]()
    mujoco.set_mju_user_warning(lambda _: None)  # else they go to a file in this folder
    try:
        spec = mujoco.MjSpec.from_file(str(path.absolute()))
        spec.compiler.discardvisual = spec.compiler.fusestatic = False
        if not weighing:  # else it refuses what moves and has no mass
            spec.compiler.boundmass = spec.compiler.boundinertia = LEAST_MASS
        always = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        models = [path.absolute()]
        for model in models:  # and those that they attach
            named = (
                model.parent / name for name in re.findall(r'file="([^"]+\.xml)"', model.read_text("utf-8", "replace"))
            )
            models += {one.resolve() for one in named if one.is_file()} - {*models}
        folders = [*dict.fromkeys(model.parent for model in models)]
        files = {mesh.name: _mesh(spec, mesh, folders, lost) for mesh in spec.meshes}
        unnamed = frozenset(f"body_{number}" for number, one in enumerate(spec.bodies) if not one.name)
        for kind, elements in (("body", spec.bodies), ("joint", spec.joints), ("geom", spec.geoms)):
            for number, one in enumerate(elements):
                one.name = one.name or f"{kind}_{number}"
        meshes, of_mesh = dict[str, MeshFile | None](), set[str]()
        for geom in spec.geoms:
            geom.material = ""
            if geom.meshname or geom.type in (kinds.mjGEOM_HFIELD, kinds.mjGEOM_SDF):
                if not geom.meshname:
                    lost.setdefault("height fields and shapes of plugins are left out", []).append(geom.name)
                elif geom.meshname not in files:
                    raise ValueError(no_such(geom.meshname, "mesh", files))
                meshes[geom.name] = files.get(geom.meshname)
                of_mesh.add(geom.parent.name)
                geom.type, geom.meshname, geom.hfieldname = kinds.mjGEOM_SPHERE, "", ""
                geom.size[:] = STAND_IN
        for one in (*spec.sites, *spec.tendons):
            one.material = ""
        for one in (*spec.skins, *spec.flexes, *spec.meshes, *spec.hfields, *spec.materials, *spec.textures):
            spec.delete(one)
        weighed = [one.name for one in spec.bodies if one.name not in of_mesh or (one.explicitinertial and not always)]
        with catch_warnings(action="ignore"):
            return Scene(spec.compile(), meshes, frozenset(weighed), unnamed, path, lost)
    except Exception as error:  # of several types, some of its own
        why = re.sub(r"^(XML )?(Error: )+", "", " ".join(str(error).split()))
        raise bad_input("mjcf", f"MuJoCo cannot read this file: {why}", Place(path)) from error
    finally:
        mujoco.set_mju_user_warning(None)


def _mesh(
    spec: mujoco.MjSpec, mesh: mujoco.MjsMesh, folders: Sequence[Path], lost: dict[str, list[str]]
) -> MeshFile | None:
    """The file of a mesh, if it is one that SQRP can read; folders: of the model, and of those that it attaches."""
    directory = getattr(getattr(mesh, "compiler", None), "meshdir", "") or spec.meshdir
    file = Path(mesh.file).name if spec.strippath else mesh.file
    found = [there for folder in folders for there in (folder / directory / file, folder / file) if there.is_file()]
    turned = not np.array_equal(mesh.refquat / np.linalg.norm(mesh.refquat), [1.0, 0.0, 0.0, 0.0])
    if not (file and file.lower().endswith(MESH_ENDS)) or (turned and np.ptp(mesh.scale) > 0.0):
        lost.setdefault("meshes that no file of STL or OBJ has as they are are left out", []).append(mesh.name)
        return None
    R = quaternion_to_matrix(np.roll(mesh.refquat, -1)).T
    X_GM = pose(R, -(R * mesh.scale) @ mesh.refpos)
    return relpath(found[0] if found else folders[0] / directory / file, folders[0]), mesh.scale, X_GM


def _bases(scene: Scene) -> list[int]:
    """The bodies with which the robot's trees begin. Raises InputError if there are none."""
    model, base_of = scene.model, scene.model.body_rootid[scene.model.jnt_bodyid]
    jointed = {*base_of[np.isin(model.jnt_type, (SLIDE, HINGE))].tolist()}
    bases = sorted(jointed & {int(base_of[joint]) for joint in _motors(model)} or jointed)
    if not bases:
        message = "no joint of this file turns or slides, expected those of an arm"
        raise bad_input("no-arm", message, Place(scene.path), mend="name the file of the robot, not of an object")
    others = {*model.body_rootid[model.geom_bodyid[model.geom_type != PLANE]].tolist()} - {*bases}
    if others:
        said = "of the scene, what no actuator moves is left out; state it as `objects`"
        scene.lost[said] = [model.body(body).name for body in sorted(others)]
    return bases


def _motors(model: mujoco.MjModel) -> dict[int, float]:
    """The joints that actuators move, also by tendons, and the largest force of each [Nm or N]; 0 if not stated."""
    motors = dict[int, float]()
    for actuator in range(model.nu):
        kind, (first, _) = model.actuator_trntype[actuator], model.actuator_trnid[actuator]
        if kind == TENDON_DRIVE:
            wraps = range(model.tendon_adr[first], model.tendon_adr[first] + model.tendon_num[first])
            motors |= {int(model.wrap_objid[wrap]): 0.0 for wrap in wraps if model.wrap_type[wrap] == JOINT_WRAP}
        elif kind in JOINT_DRIVES:
            most = np.abs(model.actuator_forcerange[actuator]).max() * abs(model.actuator_gear[actuator, 0])
            motors[int(first)] = float(most) if model.actuator_forcelimited[actuator] else 0.0
    limited = {joint for joint in motors if model.jnt_actfrclimited[joint]}
    return motors | {joint: float(np.abs(model.jnt_actfrcrange[joint]).max()) for joint in limited}


def _followers(scene: Scene, moving: set[int]) -> tuple[dict[int, Follower], dict[int, float]]:
    """The joints that follow others by equality constraints, and where those are that one holds [rad or m].

    MuJoCo's constraint is `q - ref = a + b (q_other - ref_other) + ...`; where only the first has a motor, the other
    one follows.
    """
    model, following, held = scene.model, dict[int, Follower](), dict[int, float]()
    motors, ref = _motors(model), [float(model.qpos0[address]) for address in model.jnt_qposadr]
    for row in np.flatnonzero((model.eq_type == JOINT_EQUALITY) & (model.eq_active0 != 0)).tolist():
        one, other = int(model.eq_obj1id[row]), int(model.eq_obj2id[row])
        a, b, *more = model.eq_data[row][:5].tolist()
        if one not in moving or one in following or one in held:
            continue
        if other not in moving or b == 0.0:
            held[one] = ref[one] + a
        elif other in motors or one not in motors:
            following[one] = other, b, ref[one] + a - b * ref[other]
        elif other not in following:
            following[other] = one, 1.0 / b, ref[other] - (ref[one] + a) / b
        if any(more):
            scene.lost.setdefault("joints that follow by a curve, taken as straight", []).append(model.joint(one).name)
    for joint, (leader, b, a) in [*following.items()]:
        passed = {joint}
        while leader in following and leader not in passed:  # a chain of them
            passed.add(leader)
            leader, next_b, next_a = following[leader]
            b, a = b * next_b, b * next_a + a
        following[joint] = leader, b, a
        if leader in held or leader in passed:
            del following[joint]
            held[joint] = b * held.get(leader, ref[leader]) + a
    return following, held


def _link(scene: Scene, body: int) -> Told:
    """A body as a link. Geoms that touch nothing are visual, and so are others of the groups that have such geoms."""
    model, name = scene.model, scene.model.body(body).name
    drawn, pieces = {*model.geom_group[~scene.touching].tolist()}, list[Told]()
    for geom in _geoms(model, body):
        if (solid := _solid(scene, geom)) is None:
            continue
        shape, X_BG = solid
        if isinstance(shape, tuple):
            inside = _told("mesh", {"filename": shape[0], "scale": _text(shape[1])})
        else:
            figures = {key: _text(np.atleast_1d(value)) for key, value in vars(shape).items()}
            inside = _told(type(shape).__name__.lower(), figures)
        tags = ["collision"] if scene.touching[geom] else []
        if model.geom_rgba[geom, 3] > 0.0 and (not tags or int(model.geom_group[geom]) in drawn):
            tags.append("visual")
        called, holder = {"name": model.geom(geom).name}, _told("geometry", {}, [inside])
        pieces += [_told(tag, called, [_origin(X_BG), holder]) for tag in tags]
    if name in scene.weighed and (mass := float(model.body_mass[body])) > 0.0:
        X_BI = _pose(model.body_ipos[body], model.body_iquat[body])
        moments = X_BI[:3, :3] @ np.diag(model.body_inertia[body]) @ X_BI[:3, :3].T
        stated = {f"i{'xyz'[i]}{'xyz'[j]}": _text((moments[i, j],)) for i in range(3) for j in range(i, 3)}
        inside = [_told("mass", {"value": _text((mass,))}), _told("inertia", stated)]
        pieces.append(_told("inertial", {}, [_origin(pose(position=X_BI[:3, 3])), *inside]))
    return _told("link", {"name": name}, pieces)


def _geoms(model: mujoco.MjModel, body: int) -> range:
    return range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])


def _solid(scene: Scene, geom: int) -> Solid | None:
    """The shape of a geom, and its pose in its body; None for planes, and meshes that are left out."""
    model, name, kind = scene.model, scene.model.geom(geom).name, int(scene.model.geom_type[geom])
    X_BG, (x, y, z) = _pose(model.geom_pos[geom], model.geom_quat[geom]), model.geom_size[geom].tolist()
    if name in scene.meshes:
        if (mesh := scene.meshes[name]) is None:
            return None
        file, scale, X_GM = mesh
        return (file, (float(scale[0]), float(scale[1]), float(scale[2]))), X_BG @ X_GM
    if kind in (BOX, ELLIPSOID):
        if kind == ELLIPSOID:
            scene.lost.setdefault("ellipsoids, taken as the boxes around them", []).append(name)
        return Box((2 * x, 2 * y, 2 * z)), X_BG
    if kind not in ROUND:
        return None
    return shape_of(ROUND[kind], [x] if kind == SPHERE else [x, 2 * y]), X_BG


def _joints_to(
    scene: Scene, body: int, joints: list[int], following: Mapping[int, Follower], held: Mapping[int, float]
) -> Iterator[Told]:
    """The joints that carry a body, one after the other, with links between them and where an axis is elsewhere."""
    model, name, motors = scene.model, scene.model.body(body).name, _motors(scene.model)
    parent, X_PB = model.body_parentid[body], _pose(model.body_pos[body], model.body_quat[body])
    carrier = WORLD if parent == 0 else model.body(parent).name
    for joint in joints:
        ref, axis = float(model.qpos0[model.jnt_qposadr[joint]]), model.jnt_axis[joint]
        at, turns = pose(position=model.jnt_pos[joint]), model.jnt_type[joint] == HINGE
        by = held.get(joint, 0.0) - ref
        X_PJ = X_PB @ at @ (displacement(np.zeros(3), axis * by) if turns else pose(position=axis * by))
        X_PB = pose(position=-model.jnt_pos[joint])
        if joint in held:
            X_PB = X_PJ @ X_PB
            continue
        called, bounded = model.joint(joint).name, bool(model.jnt_limited[joint])
        child = name if joint == joints[-1] and not model.jnt_pos[joint].any() else f"{called}/axis"
        lower, upper = model.jnt_range[joint].tolist() if bounded else (0.0, 0.0)
        limit = {"lower": _text((lower,)), "upper": _text((upper,)), "effort": _text((motors.get(joint, 0.0),))}
        more = [_told("axis", {"xyz": _text(axis)}), _told("limit", limit)]
        if joint in following:
            leader, b, a = following[joint]
            follows = {"joint": model.joint(leader).name, "multiplier": _text((b,)), "offset": _text((a,))}
            more.append(_told("mimic", follows))
        kind = "prismatic" if not turns else "revolute" if bounded else "continuous"
        yield _joint(called, (carrier, child), X_PJ, kind, more)
        if child != name:
            yield _told("link", {"name": child})
        carrier = child
    if carrier != name:
        yield _joint(f"{name}/fixed", (carrier, name), X_PB)


def _pose(position: Array, wxyz: Array) -> Array:
    """The pose of a position and a quaternion as MuJoCo has it, shape (4, 4)."""
    return pose(quaternion_to_matrix(np.roll(wxyz, -1)), position)


def _joint(name: str, links: tuple[str, str], X_PJ: Array, kind: str = "fixed", more: Iterable[Told] = ()) -> Told:
    ends = [_told(tag, {"link": link}) for tag, link in zip(("parent", "child"), links, strict=True)]
    return _told("joint", {"name": name, "type": kind}, [*ends, _origin(X_PJ), *more])


def _told(tag: str, attributes: Mapping[str, str], inside: Iterable[Told] = ()) -> Told:
    return [tag, attributes, "", None, None, [*inside]]


def _origin(X: Array) -> Told:
    return _told("origin", {"xyz": _text(X[:3, 3]), "rpy": _text(matrix_to_rpy(X[:3, :3]))})


def _text(values: Iterable[float]) -> str:
    """Numbers to twelve digits: rounding differs between releases and machines, and a digest must not."""
    return " ".join(f"{round(float(value), 15) + 0.0:.12g}" for value in values)

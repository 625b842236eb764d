"""The cell as a MuJoCo model: robot and tool from their URDFs, fixed objects, and movable ones as free bodies.

MuJoCo is imported here, once it is certain that it can be; other modules have it from this one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import pairwise

import cv2
import numpy as np

from sqrp_cli.camera.light import COLORS, Rgb, paint_of
from sqrp_cli.camera.markers import DICTIONARIES, Marker, opencv_name
from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.cell.scene import FLOOR_DEPTH
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError
from sqrp_cli.files.packages import resolve_mesh
from sqrp_cli.geometry import Array, pose
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.platform.simulator import check_simulator
from sqrp_cli.robot.robot import Robot
from sqrp_cli.robot.urdf import UrdfLink, UrdfModel
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Part, Sphere

check_simulator()

with interrupts_later():
    import mujoco as mujoco  # reads its environment here; other modules import it from this one


TIME_STEP = 0.002  # Of the physics [s]
DENSITY = 500.0  # Of everything whose mass is not stated, as of wood or hollow plastic [kg/m^3]
FRICTION = (0.8, 0.005, 0.0001)  # Coefficients of everything: sliding, turning [m] and rolling [m]
ARMATURE = 0.1  # Inertia of each joint's motor and gear, as seen behind the gear [kg m^2, or kg]
MARKER_DEPTH = 2e-4  # How far a marker stands out from its face, so that it is drawn in front of it [m]
_MARKER_PIXELS = 32  # Of the texture along a module of a marker
TIP = "tool tip"  # Name of the small sphere at the origin of the tool frame, from which suction reaches
TIP_RADIUS = 1e-3  # Of that sphere [m]
DRAWN, FELT = 0, 3  # Groups of geoms: those that cameras see, and those that only collide
_ROBOT_COLOR: Rgb = (0.16, 0.16, 0.17)
_FLOOR_COLOR: Rgb = (0.36, 0.35, 0.34)  # Without a hue that a detector looks for
SHADOWS_AROUND = 1.5  # How far around arm and objects stated lights cast shadows: more than an arm's length [m]
_SHADOW_PIXELS = 4096  # Along the map of each light's shadows: a pixel of a millimetre or two
_ROBOT, _MOVABLE, _FIXED = 1, 2, 4
"""Bits of what may touch what: movable objects touch everything, the robot also fixed objects, but not itself."""
_TOUCHES = {_ROBOT: 0, _MOVABLE: _ROBOT | _MOVABLE | _FIXED, _FIXED: _ROBOT}
_STIFF = (2 * TIME_STEP, 1.0)
"""Time constant [s] and damping ratio of constraints that give way as little as the time step allows."""
_HARD = (0.99, 0.999, 1e-4)
"""Shares of a constraint's violation that are undone, without and with a violation of that width [m]."""
_SLICE, _CORNERS = 0.01, 64
"""Width of the slices of a mesh of a hand of which each collides as its hull [m], and corners of that at most."""
_LIGHTEST = 1e-3  # Least mass of a moving link [kg]


def build_model(workspace: Workspace, objects: Mapping[str, Array]) -> mujoco.MjModel:
    """The model of a cell in which some of the objects are, at poses X_WO, shape (4, 4) each.

    Bodies are named like links and objects. Each movable joint has a motor of its own name, save those that mimic
    another one, which follow by a constraint. A weld of each movable object to the tool frame is prepared, inactive.
    Self-collision of the robot is left out: motions are free of it, but for the convex hulls that physics uses it may
    not be.

    Raises InputError for a URDF or mesh that cannot be used.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = TIME_STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0  # so that objects between fingers hardly creep
    spec.compiler.degree = False
    spec.compiler.balanceinertia = True
    _light(spec, workspace, objects)
    robot = workspace.robot
    _add_urdf(spec, robot.urdf, robot, spec.worldbody, robot.X_WB)
    if robot.tool is not None:
        _add_urdf(spec, robot.tool.urdf, robot, spec.body(robot.tool.link), robot.tool.X_LT)
    for link, marker in robot.markers.items():
        _add_marker(spec, spec.body(link), marker, pose())
    tip = spec.body(robot.tool_frame).add_geom(name=TIP, type=mujoco.mjtGeom.mjGEOM_SPHERE)
    tip.size[0], tip.mass, tip.group = TIP_RADIUS, 0.0, FELT
    tip.contype = tip.conaffinity = 0
    lowest = float(robot.X_WB[2, 3])
    for name, X_WO in objects.items():
        obj = workspace.objects[name]
        body = spec.worldbody.add_body(name=name, pos=X_WO[:3, 3], quat=quaternion(X_WO))
        for part in obj.parts:
            _add_part(spec, body, part, paint_of(obj.color))
            _add_part(spec, body, part, paint_of(obj.color), (_FIXED if obj.fixed else _MOVABLE, DENSITY))
        if obj.printed_marker is not None:
            _add_marker(spec, body, obj.printed_marker, pose(position=(0.0, 0.0, obj.size[2] / 2)))
        if obj.fixed:
            lowest = min(lowest, X_WO[2, 3] - obj.size[2] / 2)
            continue
        body.add_freejoint(name=name)
        weld = spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_WELD, active=False)
        weld.objtype, weld.name1, weld.name2 = mujoco.mjtObj.mjOBJ_BODY, robot.tool_frame, name
        weld.solref[:], weld.solimp[:3] = _STIFF, _HARD
    floor = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(20.0, 20.0, 1.0))
    floor.pos[2] = lowest - FLOOR_DEPTH
    floor.rgba = (*_FLOOR_COLOR, 1.0)
    floor.contype, floor.conaffinity = _FIXED, _TOUCHES[_FIXED]
    return spec.compile()


def quaternion(X: Array) -> Array:
    """The rotation of a pose as MuJoCo's quaternion w, x, y, z."""
    wxyz = np.zeros(4)
    mujoco.mju_mat2Quat(wxyz, np.ascontiguousarray(X[:3, :3]).reshape(9))
    return wxyz


def _add_urdf(spec: mujoco.MjSpec, urdf: UrdfModel, robot: Robot, parent: mujoco.MjsBody, X_PR: Array) -> None:
    """A URDF whose root link has the pose X_PR in a body."""
    root = parent.add_body(name=urdf.root, pos=X_PR[:3, 3], quat=quaternion(X_PR))
    bodies = {urdf.root: root}
    for joint in urdf.joints.values():
        body = bodies[joint.parent].add_body(name=joint.child, pos=joint.X_PJ[:3, 3], quat=quaternion(joint.X_PJ))
        bodies[joint.child] = body
        if not joint.movable:
            continue
        kind = mujoco.mjtJoint.mjJNT_SLIDE if joint.type == "prismatic" else mujoco.mjtJoint.mjJNT_HINGE
        added = body.add_joint(name=joint.name, type=kind, axis=joint.axis, armature=ARMATURE)
        if joint.mimic is not None:
            follow = spec.add_equality(name=joint.name, type=mujoco.mjtEq.mjEQ_JOINT)
            follow.name1, follow.name2 = joint.name, joint.mimic.joint
            follow.data[:5] = joint.mimic.offset, joint.mimic.multiplier, 0.0, 0.0, 0.0
            follow.solref[:] = _STIFF
            continue
        if np.isfinite([joint.lower, joint.upper]).all():
            added.limited, added.range[:] = True, (joint.lower, joint.upper)
            added.solref_limit[:] = _STIFF
        motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        if joint.effort is not None:
            added.actfrclimited, added.actfrcrange[:] = True, (-joint.effort, joint.effort)
    resolve = partial(resolve_mesh, robot.package_roots)
    for part in urdf.parts("visual", resolve):
        try:
            _add_part(spec, bodies[part.parent], part, _ROBOT_COLOR)
        except InputError as error:  # where it is not the geometry that is solid, nobody left these out
            if error.problems[0].code != "mesh-empty":
                raise
    driven = robot.fingers.open if robot.fingers else ()
    driving = [one for one in urdf.joints.values() if one.name in driven or (one.mimic and one.mimic.joint in driven)]
    hand = {link for joint in driving for link in (joint.parent, *urdf.beyond(joint.child))}
    for part in urdf.parts("collision", resolve):
        inertial = urdf.links[part.parent].inertial
        density = DENSITY if inertial is None or inertial.mass <= 0.0 else 0.0
        for piece in _slices(part.shape) if part.parent in hand and isinstance(part.shape, Mesh) else (None,):
            _add_part(spec, bodies[part.parent], part, _ROBOT_COLOR, (_ROBOT, density), piece)
    for name, body in bodies.items():
        _set_inertia(body, urdf.links[name])


def _add_part(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    part: Part,
    color: Rgb,
    felt: tuple[int, float] | None = None,
    piece: Array | None = None,
) -> None:
    """Add a part of a link or an object, to be drawn; or to be felt, by what it touches and its density [kg/m^3].

    Every mesh file is one asset for each. piece: corners of a slice of it, (n, 3), which stands for the mesh.
    """
    touches, density = felt or (0, 0.0)
    group = DRAWN if felt is None else FELT
    kinds, inertias, mesh = mujoco.mjtGeom, mujoco.mjtMeshInertia, part.shape
    triangles = read_mesh(mesh.path, mesh.scale) if isinstance(mesh, Mesh) else None
    geom = body.add_geom(pos=part.X_PG[:3, 3], quat=quaternion(part.X_PG), rgba=(*color, 1.0))
    match mesh:
        case Box(size):
            geom.type, geom.size[:] = kinds.mjGEOM_BOX, np.array(size) / 2
        case Sphere(radius):
            geom.type, geom.size[0] = kinds.mjGEOM_SPHERE, radius
        case Cylinder(radius, length):
            geom.type, geom.size[:2] = kinds.mjGEOM_CYLINDER, (radius, length / 2)
        case Capsule(radius, length):
            geom.type, geom.size[:2] = kinds.mjGEOM_CAPSULE, (radius, length / 2)
        case Mesh():
            name = f"{mesh.path} {mesh.scale} {group}" + ("" if piece is None else f" {hash(piece.tobytes())}")
            geom.type, geom.meshname = kinds.mjGEOM_MESH, name
            if spec.mesh(name) is None and triangles is not None:
                asset = spec.add_mesh(name=name)
                if piece is None:
                    asset.uservert, asset.userface = triangles.vertices.ravel(), triangles.faces.ravel()
                else:
                    asset.uservert, asset.maxhullvert = piece.ravel(), _CORNERS
                # A drawn mesh may be open or flat; one that collides does so as its convex hull.
                asset.inertia = inertias.mjMESH_INERTIA_SHELL if group == DRAWN else inertias.mjMESH_INERTIA_CONVEX
    geom.group, geom.density = group, density
    geom.friction[:], geom.condim = FRICTION, 4
    geom.solref[:], geom.solimp[:3] = _STIFF, _HARD
    geom.contype, geom.conaffinity = (touches, _TOUCHES[touches]) if touches else (0, 0)


def _slices(mesh: Mesh) -> Iterator[Array]:
    """Corners of slices of a mesh across its longest side, (n, 3) each: their hulls leave its hollows open."""
    read = read_mesh(mesh.path, mesh.scale)
    corners = read.vertices[read.faces]
    start, way = corners.reshape(-1, 3), (np.roll(corners, -1, axis=1) - corners).reshape(-1, 3)
    axis = int(np.ptp(start, axis=0).argmax())
    low, high = start[:, axis].min(), start[:, axis].max()
    levels = np.linspace(low, high, 1 + int(np.ceil((high - low) / _SLICE)))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = (levels[:, None] - start[:, axis]) / way[:, axis]
        cuts = [(start + share[:, None] * way)[(share >= 0.0) & (share <= 1.0)] for share in shares]
    for k, (bottom, top) in enumerate(pairwise(levels)):
        inside = start[(start[:, axis] >= bottom) & (start[:, axis] <= top)]
        points = np.unique(np.concatenate([cuts[k], inside, cuts[k + 1]]).round(6), axis=0)
        if np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-3) == 3:
            yield points


def _add_marker(spec: mujoco.MjSpec, body: mujoco.MjsBody, marker: Marker, X_BF: Array) -> None:
    """A marker with its margin on a face whose middle is at X_BF with z outwards."""
    name, side, modules = f"{marker.dictionary} {marker.id}", marker.side, DICTIONARIES[marker.dictionary].modules
    if spec.material(name) is None:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(marker.dictionary)))
        pixels, kind = modules * _MARKER_PIXELS, mujoco.mjtTexture.mjTEXTURE_2D
        gray = cv2.aruco.generateImageMarker(dictionary, marker.id, pixels, borderBits=1)
        texture = spec.add_texture(name=name, type=kind, width=pixels, height=pixels, nchannel=3)
        texture.data = np.repeat(gray[:, :, None], 3, axis=2).tobytes()
        material = spec.add_material(name=name, specular=0.0, shininess=0.0)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    margin = body.add_geom(rgba=(*COLORS["white"], 1.0))
    margin.size[:] = (*(side / 2 * (1.0 + 2.0 / modules),) * 2, MARKER_DEPTH)
    black = body.add_geom(material=name)
    black.size[:] = side / 2, side / 2, 2 * MARKER_DEPTH
    for geom in (margin, black):
        geom.type, geom.group, geom.mass = mujoco.mjtGeom.mjGEOM_BOX, DRAWN, 0.0
        geom.pos, geom.quat = X_BF[:3, 3], quaternion(X_BF)
        geom.contype = geom.conaffinity = 0


def _set_inertia(body: mujoco.MjsBody, link: UrdfLink) -> None:
    """State the inertia of a link: the URDF's, else that of its geometry, else next to nothing."""
    inertial = link.inertial
    if inertial is not None and inertial.mass > 0.0:
        # About the principal axes; no moment is below that of a point 3 mm away.
        mass = max(inertial.mass, _LIGHTEST)
        moments, axes = np.linalg.eigh(inertial.inertia)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        X_LI, moments = inertial.X_LI @ pose(axes), np.maximum(moments, mass * 1e-5)
    elif not link.geometry("collision"):
        mass, X_LI, moments = _LIGHTEST, pose(), np.full(3, 1e-6)
    else:
        return
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat, body.inertia = mass, X_LI[:3, 3], quaternion(X_LI), moments


def _light(spec: mujoco.MjSpec, workspace: Workspace, objects: Mapping[str, Array]) -> None:
    """The stated lights, which cast shadows on the arm, the objects and around them; else even light without shadows.

    That has no more quality than the software renderer has time for. Some light comes from everywhere and, where none
    is stated, from the camera; the sky is plain.
    """
    visual, kinds, ambient, from_camera = spec.visual, mujoco.mjtLightType, 0.45, 0.25
    visual.quality.shadowsize = visual.quality.offsamples = 0
    if workspace.lights:
        places = np.stack([workspace.robot.X_WB[:3, 3], *(X_WO[:3, 3] for X_WO in objects.values())])
        spec.stat.center = middle = places.mean(axis=0)
        spec.stat.extent = float(np.linalg.norm(places - middle, axis=1).max()) + SHADOWS_AROUND
        visual.map.shadowclip = visual.map.shadowscale = 1.0
        visual.quality.shadowsize = _SHADOW_PIXELS
        ambient = sum(light.intensity for light in workspace.lights.values() if light.is_ambient)
        from_camera = 0.0
    else:
        light = spec.worldbody.add_light(type=kinds.mjLIGHT_DIRECTIONAL, castshadow=False)
        light.dir = (0.2, 0.1, -1.0)
        light.diffuse, light.specular, light.ambient = (0.30,) * 3, (0.0,) * 3, (0.0,) * 3
    for stated in workspace.lights.values():
        if not stated.is_ambient:
            light = spec.worldbody.add_light(castshadow=True, dir=stated.heading)
            light.diffuse, light.specular, light.ambient = (stated.intensity,) * 3, (0.0,) * 3, (0.0,) * 3
            if stated.position is None:
                light.type, light.pos = kinds.mjLIGHT_DIRECTIONAL, middle - spec.stat.extent * stated.heading
            else:
                light.type, light.pos = kinds.mjLIGHT_SPOT, stated.position
                light.cutoff, light.exponent = np.degrees(stated.half_beam), 0.0
                light.attenuation = (0.0, 0.0, 1.0)
    visual.headlight.active = int(ambient > 0.0 or from_camera > 0.0)  # it takes the place of one of eight lights
    visual.headlight.ambient[:] = ambient
    visual.headlight.diffuse[:] = from_camera
    visual.headlight.specular[:] = 0.0
    sky = spec.add_texture(name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=64)
    sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
    sky.rgb1 = sky.rgb2 = (0.80, 0.80, 0.80)

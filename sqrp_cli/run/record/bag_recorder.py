"""Keeps a run as a recording that ROS tools show: images, joints, frames, objects, boxes and verdicts.

docs/howto/run.md lists its topics.
"""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.light import Rgb, paint_of
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.files.frames import WORLD, WORLD_LINK
from sqrp_cli.geometry import Array, inverse, matrix_to_rpy, pose, quaternion_to_matrix
from sqrp_cli.robot.robot import Robot
from sqrp_cli.ros.bag import BagWriter
from sqrp_cli.ros.messages import Message, MessageTypes, pose_fields, transform_message
from sqrp_cli.run.image import CameraImage
from sqrp_cli.run.record.events import Event
from sqrp_cli.run.record.packed_image import encoded
from sqrp_cli.run.robot_body import RobotBody
from sqrp_cli.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

AS_PLANNED = "/as_planned"  # The topic that says whether everything goes as the program says
EPOCH = 1_000_000_000  # What a clock of a recording says when the run's says 0 [s]: ROS takes a time of 0 for none
_SHOWN = {"true": (0.2, 0.9, 0.2), "false": (0.3, 0.6, 1.0), "blind": (0.95, 0.2, 0.2)}
_COLOR, _TF = "std_msgs/msg/ColorRGBA", "tf2_msgs/msg/TFMessage"
_MARKERS = "visualization_msgs/msg/MarkerArray"
_ALPHA = 0.35  # Opacity of boxes
_CUBE, _SPHERE, _CYLINDER, _MESH = 1, 2, 3, 10  # Types of `visualization_msgs/Marker`
_LOG_LEVELS = {1: (2, 4), 2: (20, 30)}  # Of a log message that informs, and of one that warns, by the version of ROS


class BagRecorder:
    """Writes the events and images of a run into a recording; a listener of events."""

    def __init__(self, writer: BagWriter, workspace: Workspace, body: RobotBody) -> None:
        """Writes what never changes."""
        self._writer, self._types = writer, writer.types
        self._workspace, self._body, robot = workspace, body, workspace.robot
        links = {joint.child: joint.parent for urdf in robot.urdfs for joint in urdf.joints.values()}
        moving = {link for link, (joint, _) in body.tree.mounts.items() if joint >= 0}
        self._moving = {child: parent for child, parent in links.items() if child in moving}
        if robot.tool is not None:
            links[robot.tool.urdf.root] = robot.tool.link
        self._joints: dict[str, float] = {}
        self._boxes: dict[str, list[Message]] = {}
        self._planned: bool | None = None
        self._holds_run = False
        self._add("/robot_description", 0.0, "std_msgs/msg/String", latched=True, data=robot_description(robot))
        rest, frames = body.link_poses({}), [(WORLD, robot.urdf.root, robot.X_WB)]
        for child, parent in links.items():
            if child not in self._moving:
                frames.append((parent, child, inverse(rest[parent]) @ rest[child]))
        frames += [(one.frame, optical_frame(one.name), one.X_FC) for one in workspace.cameras.values()]
        transforms = [transform_message(self._types, _at(0.0), *frame) for frame in frames]
        self._add("/tf_static", 0.0, _TF, latched=True, transforms=transforms)
        for camera in workspace.cameras.values():
            info = camera_info(self._types, camera, _at(0.0))
            self._writer.add(f"/{camera.name}/camera_info", _at(0.0), info, latched=True)

    def __call__(self, event: Event) -> None:
        """Keep an event."""
        t, said, warns = event.t, "", True
        match event.event:
            case "state":
                self._add_state(event)
            case "step":
                color, alpha = _SHOWN["blind"], _ALPHA
                self._boxes = {}
                for atom, boxes in event.boxes.items():
                    for i, box in enumerate(boxes):
                        x, y, z = box.size
                        X_FB, shape = np.array(box.pose), Box((x, y, z))
                        marker = self._marker(t, (atom, i), box.frame, X_FB, shape, color, alpha)
                        self._boxes.setdefault(atom, []).append(marker)
                wiped = self._types.make("visualization_msgs/msg/Marker", action=3)
                markers = [wiped, *(one for found in self._boxes.values() for one in found)]
                self._add("/boxes", t, _MARKERS, markers=markers)
                said, warns = f"step {event.number}: {event.skill}", False
            case "evidence":
                self._judge(event)
            case "primitive":
                said, warns = event.name, False
            case "fault":
                said = f"fault: {event.name} ({event.text})" if event.text else f"fault: {event.name}"
            case "moving on":
                said = f"moving on to see {event.to_see}"
            case "stopping":
                said = f"stopping: {event.reason}"
            case "retry":
                said = f"retry {event.attempt} of {event.of}"
            case "done" | "stopped" | "missed" as outcome:
                self._holds_run = True
                said = outcome if event.reason is None else f"{outcome}: {event.reason}"
        if said:
            ros2, level = self._types.ros == 2, _LOG_LEVELS[self._types.ros][warns]
            kind = "rcl_interfaces/msg/Log" if ros2 else "rosgraph_msgs/msg/Log"
            when = {"stamp": self._types.time(_at(t))} if ros2 else {"header": self._types.header(_at(t))}
            self._add("/rosout", t, kind, **when, level=level, name="sqrp", msg=said)

    def add(self, frame: CameraImage, *, planned: bool) -> None:
        """Keep an image; planned: whether all went as the program says when it was taken."""
        self._holds_run = True
        self.tell_planned(frame.t, planned=planned)
        topic = f"/{frame.camera}/image_raw/compressed"
        header = self._types.header(_at(frame.t), optical_frame(frame.camera))
        data = np.frombuffer(encoded(frame.image, "jpeg"), np.uint8)
        self._add(topic, frame.t, "sensor_msgs/msg/CompressedImage", header=header, format="jpeg", data=data)

    def tell_planned(self, t: float, *, planned: bool) -> None:
        """Keep whether all goes as the program says from time t [s] on."""
        if planned != self._planned:
            self._planned = planned
            self._add(AS_PLANNED, t, "std_msgs/msg/Bool", data=planned)

    def close(self) -> None:
        """Finish the recording; of a run that was ended before its first image, nothing is kept."""
        if self._holds_run:
            self._writer.close()
        else:
            self._writer.discard()

    def _add(self, topic: str, t: float, kind: str, *, latched: bool = False, **fields: Message) -> None:
        """Write a message of a type."""
        self._writer.add(topic, _at(t), self._types.make(kind, **fields), latched=latched)

    def _add_state(self, state: Event) -> None:
        t, names = state.t, state.joints if "joints" in state.model_fields_set else list(self._joints)
        if state.q:
            self._joints = dict(zip(names, state.q, strict=True))
        joints, position = list(self._joints), np.array(list(self._joints.values()))
        header = self._types.header(_at(t))
        self._add("/joint_states", t, "sensor_msgs/msg/JointState", header=header, name=joints, position=position)
        X_WL = self._body.link_poses(self._joints)
        moved = [(parent, child, inverse(X_WL[parent]) @ X_WL[child]) for child, parent in self._moving.items()]
        self._add("/tf", t, _TF, transforms=[transform_message(self._types, _at(t), *frame) for frame in moved])
        markers = []
        for name, (x, y, z, *quaternion) in state.objects.items():
            obj, X_WO = self._workspace.objects[name], pose(quaternion_to_matrix(quaternion), (x, y, z))
            for number, part in enumerate(obj.parts):
                paint = paint_of(obj.color)
                markers.append(self._marker(t, (name, number), WORLD, X_WO @ part.X_PG, part.shape, paint))
        if markers:
            self._add("/objects", t, _MARKERS, markers=markers)

    def _judge(self, event: Event) -> None:
        make, status = self._types.make, []
        for atom, shown in event.literals.items():
            values = {"asked": str(shown.asked), "predicted": str(shown.predicted)}
            values |= shown.cameras
            status.append(
                make(
                    "diagnostic_msgs/msg/DiagnosticStatus",
                    level=1 if shown.asked and shown.value == "blind" else 0,  # a warning: it cannot be judged
                    name=atom,
                    message=shown.value,
                    values=[make("diagnostic_msgs/msg/KeyValue", key=k, value=v) for k, v in values.items()],
                )
            )
            for marker in self._boxes.get(atom, ()):
                marker.header = self._types.header(_at(event.t), marker.header.frame_id)
                marker.color = make(_COLOR, **dict(zip("rgba", (*_SHOWN[shown.value], _ALPHA), strict=True)))
        header = self._types.header(_at(event.exposed))
        self._add("/verdicts", event.t, "diagnostic_msgs/msg/DiagnosticArray", header=header, status=status)
        if markers := [one for atom in event.literals for one in self._boxes.get(atom, ())]:
            self._add("/boxes", event.t, _MARKERS, markers=markers)

    def _marker(
        self, t: float, name: tuple[str, int], frame: str, X: Array, shape: Shape, color: Rgb, alpha: float = 1.0
    ) -> Message:
        mesh = ""
        match shape:
            case Box(size):
                kind, scale = _CUBE, size
            case Sphere(radius):
                kind, scale = _SPHERE, (2 * radius,) * 3
            case Cylinder(radius, length):
                kind, scale = _CYLINDER, (2 * radius, 2 * radius, length)
            case Capsule(radius, length):  # markers have none
                kind, scale = _CYLINDER, (2 * radius, 2 * radius, length + 2 * radius)
            case Mesh(path, scale):
                kind, mesh = _MESH, path.resolve().as_uri()
        x, y, z = map(float, scale)
        return self._types.make(
            "visualization_msgs/msg/Marker",
            header=self._types.header(_at(t), frame),
            ns=name[0],
            id=name[1],
            type=kind,
            pose=dict(zip(("position", "orientation"), pose_fields(X), strict=True)),
            scale=self._types.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            color=self._types.make(_COLOR, **dict(zip("rgba", (*color, alpha), strict=True))),
            mesh_resource=mesh,
            frame_locked=alpha < 1.0,  # boxes move with their frames, objects are where they are told to be
        )


def camera_info(types: MessageTypes, camera: Camera, ns: int) -> Message:
    """The `sensor_msgs/CameraInfo` of a camera; ns: the stamp [ns]."""
    plain = camera.distortion_model == "none"
    numbers = {
        "d": np.zeros(5) if plain else np.array(camera.distortion),
        "k": camera.matrix.ravel(),
        "r": np.eye(3).ravel(),
        "p": np.column_stack([camera.matrix, np.zeros(3)]).ravel(),
    }
    return types.make(
        "sensor_msgs/msg/CameraInfo",
        header=types.header(ns, optical_frame(camera.name)),
        width=camera.width,
        height=camera.height,
        distortion_model="plumb_bob" if plain else camera.distortion_model,
        **{name.upper() if types.ros == 1 else name: value for name, value in numbers.items()},
    )


def _at(t: float) -> int:
    """A time of the run [s] on the recording's clock [ns]."""
    return (EPOCH * 1_000_000_000) + round(t * 1_000_000_000)


def optical_frame(camera: str) -> str:
    """What TF calls the optical frame of a camera."""
    return f"{camera}_optical_frame"


_NAMING = {"link": ("name",), "parent": ("link",), "child": ("link",), "joint": ("name",), "mimic": ("joint",)}
"""Attributes of a description that name links and joints, by element."""


def robot_description(robot: Robot) -> str:
    """The URDF of a robot, its tool fixed to it. Meshes beside a file get their full path, packages stay named."""
    root: Xml.Element | None = None
    for urdf in robot.urdfs:
        described, fixed = Xml.Element("robot", name=urdf.name), list[tuple[str, str, str, Array]]()
        if urdf.content:
            described = Xml.fromstring(urdf.content)  # noqa: S314 - it was read, and found harmless, with the workspace
            for mesh in described.iter("mesh"):
                name = mesh.get("filename", "")
                if "://" not in name:
                    mesh.set("filename", (urdf.path.parent / name).resolve().as_uri())
            # A link of the name `world` is not where the cell's frame of that name is.
            for element in described.iter():
                for key in _NAMING.get(element.tag, ()):
                    if (called := element.get(key)) is not None:
                        of_link = element.tag in ("link", "parent", "child")
                        element.set(key, urdf.prefix + (WORLD_LINK if of_link and called == WORLD else called))
        else:  # a tool that the workspace gives as boxes
            for link in urdf.links.values():
                element = Xml.SubElement(described, "link", name=link.name)
                for piece in link.geometry("collision"):
                    if isinstance(piece.shape, Box):
                        visual = Xml.SubElement(element, "visual")
                        Xml.SubElement(visual, "origin", _origin(piece.X_LG))
                        size = " ".join(f"{value:.9g}" for value in piece.shape.size)
                        Xml.SubElement(Xml.SubElement(visual, "geometry"), "box", size=size)
            fixed = [(one.name, one.parent, one.child, one.X_PJ) for one in urdf.joints.values()]
        if root is None:
            root = described
        elif (tool := robot.tool) is not None:
            root.extend(described)
            fixed.append((f"{tool.link}_to_{urdf.root}", tool.link, urdf.root, tool.X_LT))
        for name, parent, child, X_PC in fixed:
            joint = Xml.SubElement(root, "joint", name=name, type="fixed")
            Xml.SubElement(joint, "parent", link=parent)
            Xml.SubElement(joint, "child", link=child)
            Xml.SubElement(joint, "origin", _origin(X_PC))
    assert root is not None  # noqa: S101 - a robot has a description
    return Xml.tostring(root, encoding="unicode")


def _origin(X: Array) -> dict[str, str]:
    numbers = {"xyz": X[:3, 3].tolist(), "rpy": matrix_to_rpy(X[:3, :3])}
    return {name: " ".join(f"{value:.9g}" for value in values) for name, values in numbers.items()}

"""A robot with its tool as one URDF, for programs that show it."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

from sqrp_cli.geometry import Array, matrix_to_rpy
from sqrp_cli.knowledge.frames import WORLD, WORLD_LINK
from sqrp_cli.knowledge.robot.robot import Robot
from sqrp_cli.knowledge.robot.urdf import UrdfModel
from sqrp_cli.shapes import Box


def robot_description(robot: Robot) -> str:
    """The URDF of a robot, its tool fixed to it. Meshes beside a file get their full path, packages stay named."""
    root = _described(robot.urdf)
    if robot.tool is not None:
        root.extend(_described(robot.tool.urdf))
        joint = Xml.SubElement(root, "joint", name=f"{robot.tool.link}_to_{robot.tool.urdf.root}", type="fixed")
        Xml.SubElement(joint, "parent", link=robot.tool.link)
        Xml.SubElement(joint, "child", link=robot.tool.urdf.root)
        joint.append(_origin(robot.tool.X_LT))
    return Xml.tostring(root, encoding="unicode")


def _described(urdf: UrdfModel) -> Xml.Element:
    if not urdf.content:
        return _of_boxes(urdf)
    root = Xml.fromstring(urdf.content)  # noqa: S314 - it was read, and found harmless, with the workspace
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        if "://" not in name:
            mesh.set("filename", (urdf.path.parent / name).resolve().as_uri())
    # A link of the name `world` is not where the cell's frame of that name is.
    for element in root.iter():
        for key in ("name", "link"):
            if element.tag in ("link", "parent", "child") and element.get(key) == WORLD:
                element.set(key, WORLD_LINK)
    return root


def _of_boxes(urdf: UrdfModel) -> Xml.Element:
    """The description of a tool that the workspace gives as boxes."""
    root = Xml.Element("robot", name=urdf.name)
    for link in urdf.links.values():
        element = Xml.SubElement(root, "link", name=link.name)
        for piece in link.geometry("collision"):
            if isinstance(piece.shape, Box):
                visual = Xml.SubElement(element, "visual")
                visual.append(_origin(piece.X_LG))
                Xml.SubElement(Xml.SubElement(visual, "geometry"), "box", size=_numbers(piece.shape.size))
    for one in urdf.joints.values():
        joint = Xml.SubElement(root, "joint", name=one.name, type="fixed")
        Xml.SubElement(joint, "parent", link=one.parent)
        Xml.SubElement(joint, "child", link=one.child)
        joint.append(_origin(one.X_PJ))
    return root


def _origin(X: Array) -> Xml.Element:
    return Xml.Element("origin", xyz=_numbers(X[:3, 3].tolist()), rpy=_numbers(matrix_to_rpy(X[:3, :3])))


def _numbers(values: list[float] | tuple[float, ...]) -> str:
    return " ".join(f"{value:.9g}" for value in values)

"""Robot and tool as one Pinocchio model. Only this module uses that library.

Pinocchio: J. Carpentier et al., The Pinocchio C++ library, SII 2019. The model is built joint by joint from our own
records of the URDFs, because Pinocchio's reader has no `<capsule>` and keeps the name of a link `world`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.robot.joint_tree import JointTree, Mount
from sqrp_cli.knowledge.robot.robot import Robot
from sqrp_cli.knowledge.robot.urdf import UrdfJoint, UrdfModel


class PinocchioModel:
    """Robot and tool, placed in the world, for one configuration at a time; `tree` is the same for many at once.

    Positions are those of all N movable joints in the order of `tree.joints`, shape (N,) [rad or m].
    """

    def __init__(self, robot: Robot) -> None:
        """Every link of robot and tool becomes a frame, every movable joint a joint."""
        self._model: Any = pin.Model()
        self._frames: dict[str, int] = {}
        joints: list[UrdfJoint] = []
        mounts: dict[str, Mount] = {}

        def grow(urdf: UrdfModel, root: Mount) -> None:
            mounts[urdf.root] = root
            for joint in urdf.joints.values():
                seat = mounts[joint.parent].with_offset(joint.X_PJ)
                if joint.movable:
                    # The index of a new joint, from 0; Pinocchio counts the world as the first.
                    kind = (
                        pin.JointModelPrismaticUnaligned
                        if joint.type == "prismatic"
                        else pin.JointModelRevoluteUnaligned
                    )
                    added: int = self._model.addJoint(seat.joint + 1, kind(joint.axis), pin.SE3(seat.X_JL), joint.name)
                    seat = Mount((added - 1), np.eye(4))
                    joints.append(joint)
                mounts[joint.child] = seat

        grow(robot.urdf, Mount(-1, robot.X_WB))
        if robot.tool is not None:
            grow(robot.tool.urdf, mounts[robot.tool.link].with_offset(robot.tool.X_LT))
        for link, mount in mounts.items():
            frame = pin.Frame(link, mount.joint + 1, pin.SE3(mount.X_JL), pin.FrameType.BODY)
            self._frames[link] = self._model.addFrame(frame)
        self._data = self._model.createData()
        self.tree = self._tree(joints)

    def _tree(self, joints: Sequence[UrdfJoint]) -> JointTree:
        frames = {link: self._model.frames[index] for link, index in self._frames.items()}
        return JointTree.of(
            joints,
            parents=[parent - 1 for parent in self._model.parents.tolist()[1:]],
            axes=np.array([joint.extract().axis for joint in self._model.joints[1:]]).reshape(-1, 3),
            still=np.array([X_PJ.homogeneous for X_PJ in self._model.jointPlacements[1:]]).reshape(-1, 4, 4),
            mounts={
                link: Mount(frame.parentJoint - 1, np.ascontiguousarray(frame.placement.homogeneous))
                for link, frame in frames.items()
            },
        )

    def link_pose(self, link: str, positions: Array) -> Array:
        """World pose X_WL of a link, shape (4, 4)."""
        pin.forwardKinematics(self._model, self._data, positions)
        X_WL: Array = pin.updateFramePlacement(self._model, self._data, self._frames[link]).homogeneous
        return X_WL

    def jacobian(self, link: str, chain: Sequence[int], positions: Array) -> Array:
        """The Jacobian of a link: linear over angular velocity, in world axes, per velocity of c joints, (6, c).

        chain: the c joints, such as those that carry the link.
        """
        pin.computeJointJacobians(self._model, self._data, positions)
        X_WL = pin.updateFramePlacement(self._model, self._data, self._frames[link])
        # For a single joint, the binding drops the second dimension.
        at_origin = np.asfortranarray(self._data.J.reshape(6, -1)[:, chain])
        at_link: Array = pin.SE3(np.eye(3), X_WL.translation).toActionMatrixInverse() @ at_origin
        return at_link

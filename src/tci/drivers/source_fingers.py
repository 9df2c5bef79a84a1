"""Fingers whose angles only a source beside the robot's driver measures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tci.drivers.source_reader import SourceReader
from tci.messages import JointReading
from tci.messages.frames import read_only
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain
from tci.robot.tactile_devices import DeviceJoint, hand_joints


def joints_of(robot: Robot, name: str, side: str, hand: str) -> dict[int, DeviceJoint]:
    """The hand's joint of each servo that the source `name` measures.

    It is found by the servo's address in the robot's binding to the source or, without an address, by the
    servo's name: that of the maker's model, behind `side` if the robot has two hands. Joints without angles
    in the table of devices are left out.
    """
    bound = {
        servo.index: binding.address(servo.name, "")
        for binding in robot.bindings
        if binding.middleware == name
        for servo in robot.servos
    }
    found: dict[int, DeviceJoint] = {}
    for joint in hand_joints(hand):
        fitting = [servo for servo, to in bound.items() if to == joint.name] or [
            servo.index
            for servo in robot.servos
            if f"_{servo.name}".endswith(f"_{joint.model}")
            and (not side or servo.name.startswith(f"{side}_"))
        ]
        if len(fitting) == 1:
            found[fitting[0]] = joint
    return found


class SourceFingers:
    """The joints of one source, and the pads that they carry."""

    def __init__(
        self, robot: Robot, reader: SourceReader, joints: Mapping[int, DeviceJoint], pads: Mapping[str, str]
    ) -> None:
        """`pads` is the pad of the source for each patch that it feels."""
        self.reader, self.joints = reader, joints
        self.carried: dict[int, tuple[str, ...]] = dict.fromkeys(joints, ())
        """For each servo, the pads on links that it moves."""
        if robot.model is not None and joints:
            kinematics = KinematicChain(robot)
            for patch, pad in pads.items():
                for servo in kinematics.chain(robot.patch(patch).link):
                    if servo in self.carried:
                        self.carried[servo] = (*self.carried[servo], pad)

    def fill(self, joints: JointReading) -> JointReading:
        """The reading with the angles that the source measured: of each finger those at the stamp of the
        newest frame of its pads, so that touches are placed where the finger was then; without a frame the
        latest."""
        position, velocity = joints.position.copy(), joints.velocity.copy()
        pads, track = self.reader.pads, self.reader.track
        for servo, joint in self.joints.items():
            stamp = max((pads[pad].stamp for pad in self.carried[servo]), default=-np.inf)
            felt = np.isfinite(stamp)
            share, speed = track.at(joint.name, stamp) if felt else (track.latest.get(joint.name), 0.0)
            if share is not None:
                position[servo] = joint.angle(share)
                velocity[servo] = speed * (joint.rad[1] - joint.rad[0])
        return JointReading(
            joints.stamp, joints.sequence, read_only(position), read_only(velocity), joints.torque,
            joints.modes, joints.powered, joints.gravity,
        )  # fmt: skip

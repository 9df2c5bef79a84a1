"""The description of one robot, and its kinematics.

A description (`description/`) is read from an XML file (`xml/`); TCI's own descriptions are in `robots/`.
Joint maps convert between generic joints and the joints of the robot (eqs. 1-2), and poses, gravity torques
and clearances are computed from the kinematic model.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.robot.catalogue import load_robot as load_robot
    from tci.robot.catalogue import robot_names as robot_names
    from tci.robot.description import Address as Address
    from tci.robot.description import Attachment as Attachment
    from tci.robot.description import Binding as Binding
    from tci.robot.description import CartesianActuator as CartesianActuator
    from tci.robot.description import Coupling as Coupling
    from tci.robot.description import Description as Description
    from tci.robot.description import Eyes as Eyes
    from tci.robot.description import GenericPart as GenericPart
    from tci.robot.description import GenericServo as GenericServo
    from tci.robot.description import Grid as Grid
    from tci.robot.description import Kind as Kind
    from tci.robot.description import Limits as Limits
    from tci.robot.description import Mimic as Mimic
    from tci.robot.description import Model as Model
    from tci.robot.description import Patch as Patch
    from tci.robot.description import Robot as Robot
    from tci.robot.description import Segment as Segment
    from tci.robot.description import Sensor as Sensor
    from tci.robot.description import Servo as Servo
    from tci.robot.description import Table as Table
    from tci.robot.description import Term as Term
    from tci.robot.description import TriangularModules as TriangularModules
    from tci.robot.description import TruncatedCone as TruncatedCone
    from tci.robot.gravity import Gravity as Gravity
    from tci.robot.inverse import InverseAnswer as InverseAnswer
    from tci.robot.inverse import InverseKinematics as InverseKinematics
    from tci.robot.inverse import InverseSettings as InverseSettings
    from tci.robot.joint_calibration import JointCalibration as JointCalibration
    from tci.robot.joint_calibration import JointFriction as JointFriction
    from tci.robot.joint_calibration import Tool as Tool
    from tci.robot.joint_map import JointMap as JointMap
    from tci.robot.joint_map import initial_position as initial_position
    from tci.robot.kinematics import KinematicChain as KinematicChain
    from tci.robot.like import RobotLike as RobotLike
    from tci.robot.like import as_robot as as_robot
    from tci.robot.skin_files.calibration import PatchCalibration as PatchCalibration
    from tci.robot.skin_files.calibration import SkinCalibration as SkinCalibration
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)

"""Frozen types that describe a robot, in SI units and radians. `tci.robot.xml` reads them from a file.

The names follow Listing 2 of the paper. A *servo* is a joint of the robot (DS in eq. 1). A *generic servo* is
a joint of a generic part (GS). `scale` is gamma and `offset` is sigma.
"""

from tci.robot.description.base import Description, Vector
from tci.robot.description.binding import Address, Binding, wire_name
from tci.robot.description.part import (
    FOV,
    USUAL_ACTUATORS,
    CartesianActuator,
    Eyes,
    GenericPart,
    GenericServo,
    Kind,
    Segment,
    Term,
)
from tci.robot.description.patch import SOLE, Grid, Patch, Table, TriangularModules, TruncatedCone
from tci.robot.description.robot import Attachment, Model, Mount, Robot
from tci.robot.description.sensor import THROUGH_JOINTS, Sensor
from tci.robot.description.servo import Coupling, Limits, Mimic, Servo

__all__ = [
    "FOV",
    "SOLE",
    "THROUGH_JOINTS",
    "USUAL_ACTUATORS",
    "Address",
    "Attachment",
    "Binding",
    "CartesianActuator",
    "Coupling",
    "Description",
    "Eyes",
    "GenericPart",
    "GenericServo",
    "Grid",
    "Kind",
    "Limits",
    "Mimic",
    "Model",
    "Mount",
    "Patch",
    "Robot",
    "Segment",
    "Sensor",
    "Servo",
    "Table",
    "Term",
    "TriangularModules",
    "TruncatedCone",
    "Vector",
    "wire_name",
]

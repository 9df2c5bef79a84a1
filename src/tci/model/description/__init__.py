"""What a robot is, as frozen types in SI units and radians. `tci.model.xml` reads them from a file.

The names follow the paper's Listing 2: a *servo* is a joint of the robot (DS in eq. 1), a *generic
servo* one joint of a generic part (GS), `scale` is gamma and `offset` sigma.
"""

from tci.model.description.binding import Address, Binding
from tci.model.description.part import GenericPart, GenericServo, Segment, Term
from tci.model.description.patch import SOLE, Patch, Table, TriangularModules, TruncatedCone
from tci.model.description.robot import Model, Robot
from tci.model.description.sensor import Sensor
from tci.model.description.servo import Coupling, Limits, Servo
from tci.model.description.words import Vector, Words

__all__ = [
    "SOLE",
    "Address",
    "Binding",
    "Coupling",
    "GenericPart",
    "GenericServo",
    "Limits",
    "Model",
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
    "Words",
]

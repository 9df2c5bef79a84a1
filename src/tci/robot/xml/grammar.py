"""The grammar of robot descriptions in XML: the elements, their contents, and the valid values.

Each element names a type in `tci.robot.description` for its content. The names, defaults and explanations of
its attributes are taken from this type. So reader, writer, schema and reference always agree.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import get_args

from tci.messages import CONTROL_MODES
from tci.robot.description import (
    Address,
    Attachment,
    Binding,
    CartesianActuator,
    Coupling,
    Description,
    GenericPart,
    GenericServo,
    Kind,
    Limits,
    Mimic,
    Model,
    Patch,
    Robot,
    Segment,
    Sensor,
    Servo,
    Table,
    TruncatedCone,
)
from tci.robot.xml.element import Element
from tci.robot.xml.values import (
    Angle,
    Choice,
    Choices,
    Factor,
    Flag,
    Integer,
    Integers,
    Name,
    Number,
    RelativePath,
    Three,
    Value,
)


def _choice(described: type[Description], field: str) -> Choice:
    """Returns the choice of valid values for a field that is a Literal."""
    return Choice(get_args(described.model_fields[field].annotation))


UNIT = Choice(("deg", "rad"))
NAME = Name()
ADDRESS = Name(1000)
"""A name in another system, or several names separated by spaces."""
ID = Integer(0, 9999)
SHARE = Number(0.0, 1.0)
LENGTH = Number(most=3.0, positive=True, unit="m")
POINT = Three(Number(-10.0, 10.0, unit="m"))
ORIENTATION = Three(Angle())
RATE = Number(most=1e4, positive=True, unit="Hz")
ORIGIN = Choice(("published", "assumed"))

# The largest plausible limits are assumed: far above any servo's, and below the placeholders (50000) that
# CAD exports put where a figure is missing.
SPEED = Angle(positive=True, most=100.0, per="/s")
ACCELERATION = Angle(positive=True, most=1e5, per="/s2")
JERK = Angle(positive=True, most=1e8, per="/s3")
TORQUE = Number(most=1e4, positive=True, unit="N m")


def _limit(about: str, fields: Mapping[str, str], value: Value) -> Element:
    return Element(
        about, dict.fromkeys(fields, value), may={"origin": ORIGIN}, describes=Limits, fields=fields
    )


LIMITS: dict[str, Element] = {
    "position": _limit("Limits of the angle.", {"min": "lower", "max": "upper"}, Angle()),
    "velocity": _limit("Limit of the speed, per second.", {"max": "velocity"}, SPEED),
    "acceleration": _limit(
        "Limit of the acceleration, per second squared.", {"max": "acceleration"}, ACCELERATION
    ),
    "jerk": _limit("Limit of the jerk, per second cubed.", {"max": "jerk"}, JERK),
    "torque": _limit("Limit of the torque.", {"max": "torque"}, TORQUE),
}

MODES = Choices(tuple(mode.value for mode in CONTROL_MODES))
MIMIC = Element(
    "A joint of the model that this servo moves as well, as in URDF: angle = multiplier x the servo's + "
    "offset. In simulation each follows for itself, as on cables: one that is blocked stops no other.",
    needs={"joint": NAME}, may={"multiplier": Factor(), "offset": Angle()}, describes=Mimic,
)  # fmt: skip
SERVO = Element(
    "One joint, and its limits. `joint` is its name in the model; without it a simulated servo takes the "
    "angles that it is sent. `modes` replaces those of its robot part. A limit with `origin=\"assumed\"` is "
    "a figure that no maker published. A servo without limits is known, but the gate never moves it: a "
    "command for a whole robot part leaves it where it is.",
    needs={"id": ID, "name": NAME}, may={"joint": NAME, "modes": MODES}, once=LIMITS,
    many={"mimic": MIMIC}, describes=Servo,
    fields={"modes": None},  # no field's default holds: the robot part gives it
)  # fmt: skip

ROBOT_PART = Element(
    "The robot's own part: a control board of YARP, a chain of NAOqi. `modes` are the control modes of its "
    "servos; they start in the first. Without it: `position`.",
    needs={"name": NAME}, may={"modes": MODES},
    some={"servo": SERVO},
)  # fmt: skip

COUPLING = Element(
    "min <= sum of coefficient x angle <= max, such as iCub's shoulder cables.",
    needs={"name": NAME, "min": Angle(), "max": Angle()},
    some={
        "term": Element(
            "One servo of the sum.", needs={"robot_part": NAME, "servo": ID, "coefficient": Factor()}
        )
    },
    describes=Coupling, fields={"min": "lower", "max": "upper"},
)  # fmt: skip

GENERIC_SERVO = Element(
    "A generic joint: GS = gamma x DS + sigma (eq. 1). Those of an arm have the names of "
    "[the generic arm](conventions.md).",
    needs={"id": ID},
    may={"name": NAME},
    must={
        "destination_servo_id": Element(
            "DS, in the part's `robot_part` or another. `none`: the robot lacks this joint; it reads as its "
            "`fixed_position`, and commands for it are dropped.",
            may={"robot_part": NAME}, text=Integer(0, 9999, word="none"),
        )
    },
    once={
        "transform_type": Element(
            "Relation of the generic angle to the robot's. `retarget` is for the shoulder (0, 1, 2) of an "
            "arm: its generic angles count in the torso frame, whatever axes the robot's three joints have; "
            "they are taken from the model. `synergy` is for fingers that share motors, or have several.",
            text=_choice(GenericServo, "transform"),
        ),
        "transform_factor": Element("gamma.", text=Factor()),
        "transform_displacement": Element("sigma.", text=Angle()),
        "fixed_position": Element("Generic angle of a joint that the robot lacks.", text=Angle()),
        "stiffness": Element("Fraction of full stiffness that `GenericBody.home` sets.", text=SHARE),
        "damping": Element("Fraction of full damping that `GenericBody.home` sets.", text=SHARE),
        "speed": Element(
            "Largest generic speed, per second; the servo's limit holds beside it. On its way to a target a "
            "retargeted shoulder's servo itself turns no faster than this; driven at a velocity, the generic "
            "angle.",
            text=SPEED,
        ),
        "transform_table": Element(
            "For `table`: straight lines between the points and beyond; the robot's angles rise, the generic "
            "ones rise or fall.",
            some={
                "point": Element("A pair of angles.", needs={"robot": Angle(), "generic": Angle()}),
            },
        ),
    },
    many={
        "coupled_term": Element(
            "For `coupled` and `synergy`: GS = sum of factor x DS + sigma. The servos of `coupled` are those "
            "of this part's coupled joints, and the matrix must be invertible. Those of `synergy` may be "
            "more or fewer than the joints: they go where the sum of squared errors is least, by the "
            "smallest motion.",
            needs={"destination_servo_id": ID, "factor": Factor()}, may={"robot_part": NAME},
        )
    },
    describes=GenericServo,
    fields={
        "transform_type": "transform", "transform_factor": "scale", "transform_displacement": "offset",
        "fixed_position": "fixed",
    },
)  # fmt: skip

CARTESIAN_ACTUATOR = Element(
    "A point of the part that a [CartesianCommand](kinematics.md) brings to a place: on the axis of a "
    "`segment` of an arm, or of any part at `xyz` of a `link`. An arm with both segments has `hand` and "
    "`elbow` anyway.",
    needs={"name": NAME},
    may={
        "link": NAME, "xyz": POINT, "segment": NAME, "u": SHARE, "frame": _choice(CartesianActuator, "frame"),
        "speed": Number(most=10.0, positive=True, unit="m/s"), "tolerance": LENGTH,
    },
    describes=CartesianActuator,
)  # fmt: skip

GENERIC_ROBOT_PART = Element(
    "A generic part. An arm has five generic servos, fingers have ten. `robot_part` has its servos; one can "
    "say otherwise.",
    needs={"name": NAME},
    may={"kind": Choice(get_args(Kind)), "side": Choice(("left", "right")), "robot_part": NAME},
    once={
        "mount": Element(
            "Small turn of the arm's base against the torso, at most 20 degrees in all.",
            may={"roll": Angle(), "pitch": Angle(), "yaw": Angle()},
        ),
        "generic_servo_number": Element("Number of its `generic_servo` elements.", text=Integer(1, 999)),
        "initial_positions": Element(
            "The initial posture: of all joints of this part that the robot has, or of none (then it is 0).",
            some={
                "servo": Element(
                    "As in the paper, the id here is that of a generic servo.",
                    needs={"destination_servo_id": ID, "pos": Angle()},
                )
            },
        ),
    },
    some={"generic_servo": GENERIC_SERVO},
    many={
        "segment": Element(
            "A piece of a limb: u is 0 at `origin` and 1 at `length`. An arm has `upper_arm` and `forearm`; "
            "fingers may have `palm` and, for their tips, `thumb`, `index`, `middle`, `ring`, `little`; "
            "other parts name theirs freely (`thigh`, `shank`, `foot`).",
            needs={"name": NAME, "link": NAME, "length": LENGTH}, may={"origin": POINT}, describes=Segment,
        ),
        "cartesian_actuator": CARTESIAN_ACTUATOR,
    },
    describes=GenericPart,
)  # fmt: skip

SENSOR = Element(
    "pressure = (raw - rest) x pascal_per_count; negative where raw falls with pressure. `noise` at rest is "
    "where [conditioning](conditioning.md) starts. With `axes=\"3\"` a taxel sends x, y (along the skin) and "
    "z (outward) in turn, and `channels` counts all of them.",
    needs={"rest": Number(), "pascal_per_count": Number(), "min": Number(), "max": Number()},
    may={
        "noise": Number(0.0, 1e6, unit="counts"), "axes": Integer(1, 3), "shear_pascal_per_count": Number(),
    },
    once={
        "response": Element(
            "For a sensor that is not linear: from 0, 0 on; then only the sign of `pascal_per_count` counts.",
            some={
                "point": Element(
                    "Counts away from rest, and their pressure.",
                    needs={
                        "counts": Number(0.0, 1e9, unit="counts"), "pressure": Number(0.0, 1e9, unit="Pa"),
                    },
                )
            },
        )
    },
    describes=Sensor, fields={"min": "lowest", "max": "highest", "shear_pascal_per_count": "shear"},
)  # fmt: skip

SENSORS = {
    "sensor": SENSOR,
    "felt_through_joints": Element(
        "In place of a sensor: no taxels, and no frames. Touches on this surface are "
        "[felt through the torques of joints](touch-without-skin.md); `channels` counts the places that are "
        "told apart."
    ),
}
"""Elements that define how touches on a patch are measured; each patch has one of them."""

SURFACES = {
    "truncated_cone": Element(
        "Eqs 3-4: first and last ring are the ends; -z of its frame points distally, x to theta = 0.",
        needs={
            "length": LENGTH, "r1": LENGTH, "r2": LENGTH,
            "rings": Integer(1, 10_000), "per_ring": Integer(1, 10_000),
        },
        may={"origin": POINT, "rpy": ORIENTATION}, describes=TruncatedCone,
    ),
    "triangular_modules": Element(
        "Modules of ten taxels at frames of the model.",
        some={
            "module": Element(
                "A module, whose channels are 12 x port to 12 x port + 11; `turn` is about its frame's z.",
                needs={"frame": NAME, "port": ID}, may={"turn": Angle()},
            )
        },
    ),
    "table": Element(
        "Rows `x y z nx ny nz` [m] beside the description; row i is channel i, all zeros: no taxel there. "
        "With `format=\"icub\"` it is a [skin calibration file](skin-files.md) in the frame of the patch's "
        "link. `xyz` and `rpy` are the file's frame in that link, where it is another one: `tci skin check` "
        "finds them.",
        needs={"file": RelativePath()},
        may={"format": _choice(Table, "format"), "sensor": NAME, "xyz": POINT, "rpy": ORIENTATION},
        describes=Table,
    ),
}  # fmt: skip
"""Elements that define the positions of a patch's taxels; each patch has one of them."""

PATCH = Element(
    "A piece of skin on one link; without a segment it is on no limb (head, hand). `rigid=\"true\"`: its "
    "taxels carry one rigid plate, as the load cells under a foot, so that all that are pressed are one "
    "contact. `xyz` and `rpy` move all its taxels in the link: `tci skin mount` finds them.",
    needs={"name": NAME, "part": NAME, "link": NAME, "rate": RATE, "channels": Integer(1, 100_000)},
    may={"segment": NAME, "rigid": Flag(), "neighbours": LENGTH, "xyz": POINT, "rpy": ORIENTATION},
    once=SENSORS | SURFACES, describes=Patch,
)  # fmt: skip

MODEL = Element(
    "Kinematic model. `file` lies beside the description, or is the end of a path in an installed "
    "`package` (the extra that installs it is named for the error). The torso frame has x forward, y left, "
    "z up. `meshes` is a folder beside the description with meshes that are not where the model says; `none` "
    "leaves all out.",
    needs={"format": _choice(Model, "format"), "file": RelativePath(), "torso_link": NAME},
    may={
        "package": NAME, "extra": NAME, "meshes": RelativePath(),
        "torso_rpy": ORIENTATION, "torso_xyz": POINT,
    },
    many={
        "attachment": Element(
            "A model in a file beside the description (MJCF) that is fixed to a link, such as a hand that "
            "the robot's model lacks. Names in it get the prefix.",
            needs={"file": RelativePath(), "link": NAME, "prefix": NAME},
            may={"xyz": POINT, "rpy": ORIENTATION},
            describes=Attachment, fields={"file": "path"},
        )
    },
    describes=Model, fields={"file": "path"},
)  # fmt: skip

BINDING = Element(
    "Commands per second, and the age beyond which joint data means hold. Without a binding these are the "
    "usual ones of the middleware, for each that can carry any robot.",
    needs={
        "middleware": NAME, "rate": RATE, "stale_after": Number(most=10.0, positive=True, unit="s"),
    },
    many={
        "address": Element(
            "Place of a patch, a robot part or a servo (`of`) in this middleware, unless under its usual "
            "name: a port, a topic, a key.",
            needs={"of": NAME, "to": ADDRESS},
            may={"channels": Integer(1, 100_000), "modules": Integers(ID)}, describes=Address,
        )
    },
    describes=Binding,
)  # fmt: skip

ROOT = "generic_robot"
GENERIC_ROBOT = Element(
    "The file. Without `robot_part`, as in the paper, it gets bare servos without limits. `extends` names a "
    "description beside it: an element here adds to the one there that has the same name, id or middleware, "
    "or to the list.",
    needs={"angle_unit": UNIT},
    may={"version": Choice(("1",)), "name": NAME, "title": NAME, "extends": RelativePath()},
    once={"model": MODEL, "skin": Element("All skin.", some={"patch": PATCH})},
    some={"generic_robot_part": GENERIC_ROBOT_PART},
    many={"robot_part": ROBOT_PART, "coupling": COUPLING, "binding": BINDING},
    describes=Robot,
)  # fmt: skip

MAX_MOUNT = math.radians(20.0)
"""Largest rotation [rad] of a mount. Assumed: a mount is only a small correction; if a shoulder differs by
more, it is retargeted."""

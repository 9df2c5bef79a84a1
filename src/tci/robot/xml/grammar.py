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
    Eyes,
    GenericPart,
    GenericServo,
    Grid,
    Kind,
    Limits,
    Mimic,
    Model,
    Mount,
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
    """Returns the valid keywords of the field `field` of the class `described`. The type of the field must be
    a `Literal`."""
    return Choice(get_args(described.model_fields[field].annotation))


UNIT = Choice(("deg", "rad"))
NAME = Name()
ADDRESS = Name(1000)
"""Name that a middleware uses, for example of a port or joint, or several names separated by spaces."""
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
    "A joint of the model that this servo also moves, as in URDF: angle of the joint = multiplier x angle "
    "of the servo + offset. In simulation each of these joints is driven separately, like a finger joint "
    "with its own cable: if one joint is blocked, the other joints still move.",
    needs={"joint": NAME}, may={"multiplier": Factor(), "offset": Angle()}, describes=Mimic,
)  # fmt: skip
SLIDE = Element(
    "A joint of the model that slides as this servo turns, such as the jaw of a gripper, like a rack on a "
    "pinion of this `radius` [m]: place of the joint [m] = radius x angle of the servo [rad] + offset [m]. "
    "The limits of the servo are those of the pinion: its angle, and its torque [N m] = force [N] x radius.",
    needs={"joint": NAME, "radius": Factor(least=1e-4, most=3.0)},
    may={"offset": Number(-3.0, 3.0, unit="m")}, describes=Mimic,
    fields={"radius": "multiplier"},
)  # fmt: skip
SERVO = Element(
    'One joint of the robot, with its limits. `joint` is the name of this joint in the model; without '
    '`joint`, the angle of a simulated servo is always the commanded angle. `modes` replaces the modes of '
    'the robot part. A limit with `origin="assumed"` is not published by the manufacturer. The gate never '
    'moves a servo without limits: a command for a whole robot part does not change the angle of this '
    'servo.',
    needs={"id": ID, "name": NAME}, may={"joint": NAME, "modes": MODES}, once=LIMITS,
    many={"mimic": MIMIC, "slide": SLIDE}, describes=Servo,
    fields={"modes": None},  # no field's default holds: the robot part gives it
)  # fmt: skip

ROBOT_PART = Element(
    "A part of the robot in the robot's own software, such as a control board of YARP or a chain of "
    "NAOqi. `modes` are the control modes of its servos; at the start they are in the first of these "
    "modes. The default of `modes` is `position`.",
    needs={"name": NAME}, may={"modes": MODES},
    some={"servo": SERVO},
)  # fmt: skip

COUPLING = Element(
    "A limit of a weighted sum of servo angles: min <= sum of coefficient x angle <= max. Example: the "
    "cables of iCub's shoulder.",
    needs={"name": NAME, "min": Angle(), "max": Angle()},
    some={
        "term": Element(
            "One servo of the sum, with its coefficient.",
            needs={"robot_part": NAME, "servo": ID, "coefficient": Factor()},
        )
    },
    describes=Coupling, fields={"min": "lower", "max": "upper"},
)  # fmt: skip

GENERIC_SERVO = Element(
    "A generic joint. Its angle is GS = gamma x DS + sigma (eq. 1), where DS is the angle of a servo of "
    "the robot. The generic joints of an arm have the names of [the generic arm](conventions.md).",
    needs={"id": ID},
    may={"name": NAME},
    must={
        "destination_servo_id": Element(
            "The `id` of the servo with the angle DS, in the `robot_part` of the generic part or in "
            "another robot part. `none`: the robot lacks this joint, its angle is always "
            "`fixed_position`, and commands for it are ignored.",
            may={"robot_part": NAME}, text=Integer(0, 9999, word="none"),
        )
    },
    once={
        "transform_type": Element(
            "Relation between the generic angle and the angles of the robot's servos. `retarget` is for "
            "the shoulder of an arm (generic servos 0, 1 and 2): the generic angles are relative to the "
            "torso frame, and the robot's three joints may have any axes, which TCI reads from the model. "
            "`synergy` is for fingers that share motors, or have several motors.",
            text=_choice(GenericServo, "transform"),
        ),
        "transform_factor": Element("The factor gamma of eq. 1.", text=Factor()),
        "transform_displacement": Element("The offset sigma of eq. 1.", text=Angle()),
        "fixed_position": Element("Generic angle of a joint that the robot lacks.", text=Angle()),
        "stiffness": Element("Fraction of full stiffness that `GenericBody.home` sets.", text=SHARE),
        "damping": Element("Fraction of full damping that `GenericBody.home` sets.", text=SHARE),
        "speed": Element(
            "Largest speed of the generic joint; the speed limit of the servo is valid too. For a "
            "retargeted shoulder this value limits the speed of each servo in position mode, and the "
            "speed of each generic angle in velocity mode.",
            text=SPEED,
        ),
        "transform_table": Element(
            "For `transform_type` `table`: pairs of angles, with linear interpolation between the pairs "
            "and linear extrapolation beyond them. The robot's angles must increase from pair to pair; "
            "the generic angles must all increase or all decrease.",
            some={
                "point": Element("One pair: an angle of the robot's servo, and the generic angle.",
                    needs={"robot": Angle(), "generic": Angle()}),
            },
        ),
    },
    many={
        "coupled_term": Element(
            "For `transform_type` `coupled` and `synergy`: GS = sum of factor x DS + sigma. With "
            "`coupled`, all coupled joints of the part use the same servos, as many as there are coupled "
            "joints, and the matrix of factors must be invertible. With `synergy`, the number of servos "
            "may differ from the number of joints: TCI computes the servo angles with the smallest sum of "
            "squared errors, and of several solutions the one with the smallest motion.",
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
    "A point of the part that a [CartesianCommand](kinematics.md) moves to a target. On an arm the point "
    "may be on the axis of a `segment`, at `u`; on any part it may be the point `xyz` of a `link`. An arm "
    "with upper arm and forearm always has the actuators `hand` and `elbow`.",
    needs={"name": NAME},
    may={
        "link": NAME, "xyz": POINT, "segment": NAME, "u": SHARE, "frame": _choice(CartesianActuator, "frame"),
        "speed": Number(most=10.0, positive=True, unit="m/s"), "tolerance": LENGTH,
    },
    describes=CartesianActuator,
)  # fmt: skip

GENERIC_ROBOT_PART = Element(
    "A generic part. An arm has five generic servos, fingers have ten. `robot_part` names the robot part "
    "with the servos; a generic servo can name another robot part.",
    needs={"name": NAME},
    may={"kind": Choice(get_args(Kind)), "side": Choice(("left", "right")), "robot_part": NAME},
    once={
        "mount": Element(
            "Rotation of the base of the arm relative to the torso frame, at most 20 degrees in total.",
            may={"roll": Angle(), "pitch": Angle(), "yaw": Angle()},
        ),
        "eyes": Element(
            "Where a head looks from: the point `xyz` of a `link`, between its eyes or cameras. With all "
            "angles of the head at zero it looks along the x axis of the torso frame. `fov` is the vertical "
            "angle of view of the camera, `pitch` by how much it looks down from there.",
            needs={"link": NAME},
            may={"xyz": POINT, "fov": Angle(positive=True, most=math.radians(170.0)), "pitch": Angle()},
            describes=Eyes,
        ),
        "generic_servo_number": Element("Number of `generic_servo` elements here.", text=Integer(1, 999)),
        "initial_positions": Element(
            "The initial posture. It lists either all joints of this part that the robot has, or no "
            "joints; then all angles are 0.",
            some={
                "servo": Element(
                    "Initial angle of one joint. As in the paper, `destination_servo_id` here is the `id` "
                    "of a generic servo.",
                    needs={"destination_servo_id": ID, "pos": Angle()},
                )
            },
        ),
    },
    some={"generic_servo": GENERIC_SERVO},
    many={
        "segment": Element(
            "A section of a limb. The coordinate u is 0 at `origin`, and 1 at the distance `length` from "
            "it. An arm has the segments `upper_arm` and `forearm`. Fingers may have the segment `palm`, "
            "and for the finger tips `thumb`, `index`, `middle`, `ring`, `little`. Segments of other "
            "parts may have any names (`thigh`, `shank`, `foot`).",
            needs={"name": NAME, "link": NAME, "length": LENGTH}, may={"origin": POINT}, describes=Segment,
        ),
        "cartesian_actuator": CARTESIAN_ACTUATOR,
    },
    describes=GenericPart,
)  # fmt: skip

SENSOR = Element(
    'Scale of the raw values: pressure = (raw - rest) x pascal_per_count. `pascal_per_count` is negative '
    'if raw values decrease under pressure. `noise` is the initial estimate of the noise at rest for '
    '[conditioning](conditioning.md). With `axes="3"` each taxel sends three values in the order x, y '
    '(along the skin), z (outward), and `channels` is the number of all these values.',
    needs={"rest": Number(), "pascal_per_count": Number(), "min": Number(), "max": Number()},
    may={
        "noise": Number(0.0, 1e6, unit="counts"), "axes": Integer(1, 3), "shear_pascal_per_count": Number(),
    },
    once={
        "response": Element(
            "Response of a nonlinear sensor: points of a curve that starts at 0 counts and 0 Pa. With a "
            "`response`, only the sign of `pascal_per_count` is used.",
            some={
                "point": Element(
                    "One point of the curve: the difference from the rest value in counts, and the "
                    "pressure at this difference.",
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
        "Replaces `sensor` for a surface without taxels and without frames. Touches on this surface are "
        "[estimated from joint torques](touch-without-skin.md). `channels` is the number of places on the "
        "surface that the estimate distinguishes."
    ),
}
"""Elements that define how touches on a patch are measured; each patch has one of them."""

SURFACES = {
    "truncated_cone": Element(
        "Taxels in rings on a truncated cone (eqs. 3-4). The first and the last ring are at the two ends "
        "of the cone. In the frame of the cone the -z axis points to the distal end, and the x axis "
        "points to theta = 0.",
        needs={
            "length": LENGTH, "r1": LENGTH, "r2": LENGTH,
            "rings": Integer(1, 10_000), "per_ring": Integer(1, 10_000),
        },
        may={"origin": POINT, "rpy": ORIENTATION}, describes=TruncatedCone,
    ),
    "grid": Element(
        "A flat pad of taxels in rows and columns. In its frame, z points outward, rows are counted along x "
        "over the `length`, columns along y over the `width`; `origin` is the middle of the surface. A "
        "frame lists the taxels row by row, or column by column with `order=\"column-major\"`; "
        "`mirrored=\"true\"` counts columns against y. A pad with a `thickness` is part of its link in "
        "collisions.",
        needs={
            "rows": Integer(1, 1000), "columns": Integer(1, 1000), "length": LENGTH, "width": LENGTH,
        },
        may={
            "thickness": Number(0.0, 0.1, unit="m"), "order": _choice(Grid, "order"), "mirrored": Flag(),
            "origin": POINT, "rpy": ORIENTATION,
        },
        describes=Grid,
    ),
    "triangular_modules": Element(
        "Triangular modules of ten taxels each. The frame of each module is a frame of the model.",
        some={
            "module": Element(
                "One module. Its channels are 12 x port to 12 x port + 11. `turn` rotates the module "
                "about the z axis of its frame.",
                needs={"frame": NAME, "port": ID}, may={"turn": Angle()},
            )
        },
    ),
    "table": Element(
        "A file of taxel positions in the folder of the description. Format `rows`: one row `x y z nx ny "
        "nz` [m] for each channel, in order; a row of zeros means a channel without a taxel. Format "
        "`icub`: a [skin calibration file](skin-files.md). `xyz` and `rpy` are the pose of the file's "
        "frame in the frame of the patch's link, if the two frames differ; `tci skin check` computes "
        "them.",
        needs={"file": RelativePath()},
        may={"format": _choice(Table, "format"), "sensor": NAME, "xyz": POINT, "rpy": ORIENTATION},
        describes=Table,
    ),
}  # fmt: skip
"""Elements that define the positions of a patch's taxels; each patch has one of them."""

PATCH = Element(
    'A patch of skin on one link. A patch without `segment` has no place on a limb (for example on the '
    'head). `rigid="true"` means that a rigid plate covers all taxels, like the load cells under a foot; '
    'all pressed taxels then form one contact. `xyz` and `rpy` move all taxels of the patch relative to '
    'the link; `tci skin mount` computes them. `assumed="true"`: nobody has seen this skin on the robot.',
    needs={"name": NAME, "part": NAME, "link": NAME, "rate": RATE, "channels": Integer(1, 100_000)},
    may={
        "segment": NAME, "rigid": Flag(), "assumed": Flag(), "neighbours": LENGTH, "xyz": POINT,
        "rpy": ORIENTATION,
    },
    once=SENSORS | SURFACES, describes=Patch,
)  # fmt: skip

MODEL = Element(
    "The kinematic model. `file` is a path relative to the folder of the description. With `package`, "
    "`file` is the end of a path in this installed Python package; `extra` is the extra of TCI that "
    "installs the package, for the text of the error if the package is missing. In the torso frame x "
    "points forward, y left, z up. `meshes` is a folder, relative to the folder of the description, for "
    "meshes that are not at the paths in the model; `none` ignores all meshes. `radians`: the angles of an "
    "MJCF that tells no unit are in radians. `stands_on`: the base of one arm is mounted on a flat fixed "
    "body that the arm must not hit, whose surface is `stands_at` above the torso frame's origin, or in "
    "front of it on a wall.",
    needs={"format": _choice(Model, "format"), "file": RelativePath(), "torso_link": NAME},
    may={
        "package": NAME, "extra": NAME, "meshes": RelativePath(), "radians": Flag(),
        "torso_rpy": ORIENTATION, "torso_xyz": POINT,
        "stands_on": Choice(get_args(Mount)), "stands_at": Number(-10.0, 10.0, unit="m"),
    },
    many={
        "attachment": Element(
            "A second model (MJCF file in the folder of the description) that is fixed to a link, such as "
            "a hand that the robot's model lacks. `prefix` is added to all names of this second model. "
            "`replaces` names a fixed link, such as a rubber hand, that loses its shapes and its mass.",
            needs={"file": RelativePath(), "link": NAME, "prefix": NAME},
            may={"replaces": NAME, "xyz": POINT, "rpy": ORIENTATION},
            describes=Attachment, fields={"file": "path"},
        )
    },
    describes=Model, fields={"file": "path"},
)  # fmt: skip

BINDING = Element(
    "Settings for one middleware. `rate` is the number of commands per second. If joint data is older "
    "than `stale_after`, the robot holds. Without a `binding`, TCI uses the default values of the "
    "middleware, if this middleware can transport every robot.",
    needs={
        "middleware": NAME, "rate": RATE, "stale_after": Number(most=10.0, positive=True, unit="s"),
    },
    many={
        "address": Element(
            "Name of a patch, a robot part or a servo (`of`) in this middleware, such as a port, a topic "
            "or a key. Without an `address` the default name is used.",
            needs={"of": NAME, "to": ADDRESS},
            may={"channels": Integer(1, 100_000), "modules": Integers(ID)}, describes=Address,
        ),
        "source": Element(
            "A tactile hand or loose sensor that this robot has, as it stands behind the driver in the "
            "option `--via`. It is opened with this middleware, unless `--via` names a source. Not with sim, "
            "which must run without the hand.",
            needs={"via": ADDRESS},
        ),
    },
    describes=Binding,
)  # fmt: skip

ROOT = "generic_robot"
GENERIC_ROBOT = Element(
    "The root of the file. Without `robot_part`, as in the paper, the robot gets servos without limits. "
    "`extends` names another description in the same folder, which this file changes: an element with the "
    "same name, id or middleware changes the element there, every other element is added.",
    needs={"angle_unit": UNIT},
    may={"version": Choice(("1",)), "name": NAME, "title": NAME, "extends": RelativePath()},
    once={"model": MODEL, "skin": Element("All patches of skin of the robot.", some={"patch": PATCH})},
    some={"generic_robot_part": GENERIC_ROBOT_PART},
    many={"robot_part": ROBOT_PART, "coupling": COUPLING, "binding": BINDING},
    describes=Robot,
)  # fmt: skip

"""The XML dialect: its elements, their contents, and the valid values.

`robot.xsd` describes it for editors, docs/robot-description.md for people.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from tci.messages import CONTROL_MODES
from tci.robot.xml.values import (
    Angle,
    Choice,
    Choices,
    Factor,
    Integer,
    Name,
    Number,
    RelativePath,
    Three,
    Value,
)


@dataclass(frozen=True)
class Element:
    """Valid content of one element."""

    needs: Mapping[str, Value] = field(default_factory=dict)
    """Required attributes."""
    may: Mapping[str, Value] = field(default_factory=dict)
    """Optional attributes."""
    text: Value | None = None
    """Value of its text; None if it has no text."""
    must: Mapping[str, Element] = field(default_factory=dict)
    """Children that occur exactly once."""
    once: Mapping[str, Element] = field(default_factory=dict)
    """Children that occur at most once."""
    some: Mapping[str, Element] = field(default_factory=dict)
    """Children that occur at least once."""
    many: Mapping[str, Element] = field(default_factory=dict)
    """Children that occur any number of times."""

    @property
    def children(self) -> dict[str, Element]:
        """Returns all possible children."""
        return {**self.must, **self.once, **self.some, **self.many}

    @property
    def values(self) -> dict[str, Value]:
        """Returns all attributes except `type`."""
        return {**self.needs, **self.may}

    @property
    def angular(self) -> bool:
        """Returns True if the element holds an angle, so that `type` may give a unit other than the
        root's."""
        return any(value.angular for value in [*self.values.values(), self.text] if value is not None)


UNIT = Choice(("deg", "rad"))
NAME = Name()
ADDRESS = Name(1000)
"""A name in another system, or several names with spaces between them."""
ID = Integer(0, 9999)
SHARE = Number(0.0, 1.0)
LENGTH = Number(most=3.0, positive=True, unit="m")
POINT = Three(Number(-10.0, 10.0, unit="m"))
ORIENTATION = Three(Angle())
ORIGIN = Choice(("published", "ours"))

# The largest plausible limits are assumed: far above any servo's, and below the placeholders (50000) that
# CAD exports put where a figure is missing.
SPEED = Angle(positive=True, most=100.0, per="/s")
ACCELERATION = Angle(positive=True, most=1e5, per="/s2")
JERK = Angle(positive=True, most=1e8, per="/s3")
TORQUE = Number(most=1e4, positive=True, unit="N m")

LIMITS: dict[str, Element] = {
    "position": Element(needs={"min": Angle(), "max": Angle()}, may={"origin": ORIGIN}),
    "velocity": Element(needs={"max": SPEED}, may={"origin": ORIGIN}),
    "acceleration": Element(needs={"max": ACCELERATION}, may={"origin": ORIGIN}),
    "jerk": Element(needs={"max": JERK}, may={"origin": ORIGIN}),
    "torque": Element(needs={"max": TORQUE}, may={"origin": ORIGIN}),
}

ROBOT_PART = Element(
    needs={"name": NAME},
    may={"modes": Choices(tuple(mode.value for mode in CONTROL_MODES))},
    some={"servo": Element(needs={"id": ID, "name": NAME}, may={"joint": NAME}, once=LIMITS)},
)

COUPLING = Element(
    needs={"name": NAME, "min": Angle(), "max": Angle()},
    some={"term": Element(needs={"robot_part": NAME, "servo": ID, "coefficient": Factor()})},
)

GENERIC_SERVO = Element(
    needs={"id": ID},
    may={"name": NAME},
    must={"destination_servo_id": Element(may={"robot_part": NAME}, text=Integer(0, 9999, word="none"))},
    once={
        "transform_type": Element(text=Choice(("linear", "table", "coupled", "retarget"))),
        "transform_factor": Element(text=Factor()),
        "transform_displacement": Element(text=Angle()),
        "fixed_position": Element(text=Angle()),
        "stiffness": Element(text=SHARE),
        "damping": Element(text=SHARE),
        "speed": Element(text=SPEED),
        "transform_table": Element(some={"point": Element(needs={"robot": Angle(), "generic": Angle()})}),
    },
    many={
        "coupled_term": Element(
            needs={"destination_servo_id": ID, "factor": Factor()}, may={"robot_part": NAME}
        )
    },
)

INITIAL_POSITIONS = Element(
    some={"servo": Element(needs={"destination_servo_id": ID, "pos": Angle()})},
)

RESPONSE_POINT = Element(
    needs={"counts": Number(0.0, 1e9, unit="counts"), "pressure": Number(0.0, 1e9, unit="Pa")}
)

SEGMENT = Element(needs={"name": NAME, "link": NAME, "length": LENGTH}, may={"origin": POINT})

KINDS = ("arm", "head", "torso", "leg", "hand", "other")
SIDES = ("left", "right")

GENERIC_ROBOT_PART = Element(
    needs={"name": NAME},
    may={"kind": Choice(KINDS), "side": Choice(SIDES), "robot_part": NAME},
    once={
        "mount": Element(may={"roll": Angle(), "pitch": Angle(), "yaw": Angle()}),
        "generic_servo_number": Element(text=Integer(1, 999)),
        "initial_positions": INITIAL_POSITIONS,
    },
    some={"generic_servo": GENERIC_SERVO},
    many={"segment": SEGMENT},
)

PATCH = Element(
    needs={
        "name": NAME, "part": NAME, "link": NAME,
        "rate": Number(most=1e4, positive=True, unit="Hz"), "channels": Integer(1, 100_000),
    },
    may={"segment": NAME, "rigid": Choice(("true", "false"))},
    must={
        "sensor": Element(
            needs={"rest": Number(), "pascal_per_count": Number(), "min": Number(), "max": Number()},
            may={
                "noise": Number(0.0, 1e6, unit="counts"), "axes": Integer(1, 3),
                "shear_pascal_per_count": Number(),
            },
            once={"response": Element(some={"point": RESPONSE_POINT})},
        ),
    },
    once={
        "truncated_cone": Element(
            needs={
                "length": LENGTH, "r1": LENGTH, "r2": LENGTH,
                "rings": Integer(1, 10_000), "per_ring": Integer(1, 10_000),
            },
            may={"origin": POINT, "rpy": ORIENTATION},
        ),
        "triangular_modules": Element(
            some={"module": Element(needs={"frame": NAME, "port": ID}, may={"turn": Angle()})}
        ),
        "table": Element(
            needs={"file": RelativePath()},
            may={
                "format": Choice(("rows", "icub", "csv", "urdf")), "sensor": NAME,
                "xyz": POINT, "rpy": ORIENTATION,
            },
        ),
    },
)  # fmt: skip

MODEL = Element(
    needs={"format": Choice(("urdf", "mjcf")), "file": RelativePath(), "torso_link": NAME},
    may={"package": NAME, "extra": NAME, "torso_rpy": ORIENTATION, "torso_xyz": POINT},
)

BINDING = Element(
    needs={
        "middleware": NAME,
        "rate": Number(most=1e4, positive=True, unit="Hz"),
        "stale_after": Number(most=10.0, positive=True, unit="s"),
    },
    many={"address": Element(needs={"of": NAME, "to": ADDRESS})},
)

ROOT = "generic_robot"
GENERIC_ROBOT = Element(
    needs={"angle_unit": UNIT},
    may={"version": Choice(("1",)), "name": NAME, "title": Name()},
    once={"model": MODEL, "skin": Element(some={"patch": PATCH})},
    some={"generic_robot_part": GENERIC_ROBOT_PART},
    many={"robot_part": ROBOT_PART, "coupling": COUPLING, "binding": BINDING},
)

MAX_MOUNT = math.radians(20.0)
"""Largest rotation [rad] of a mount. Assumed: a mount is a small correction, not another kind of shoulder."""

"""Receptive fields of head, torso, hands and legs: discs on the skin, read from a TOML file."""

from __future__ import annotations

import tomllib
from importlib.resources import as_file, files
from math import radians
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from tci.capabilities.fields import ForceRange
from tci.errors import DescriptionError, Fault
from tci.messages import Landmark
from tci.robot.description import Description, Vector

JOINTS = {
    "head": ("pitch", "roll", "yaw"),
    "torso": ("pitch", "roll", "yaw"),
    "hand": ("flexion", "deviation"),
    "leg": ("hip_pitch", "hip_roll", "hip_yaw", "knee_pitch", "ankle_pitch", "ankle_roll"),
}
"""Generic joints of each kind of part, by index.

Positive directions. Head and torso: pitch nods forward, roll leans right, yaw turns left. Legs and hands,
equal on both sides: flexion of hip, knee and wrist, abduction, internal rotation, toes up, sole inwards,
thumb forward. Zero is standing upright with straight legs and straight wrists.
"""
Kind = Literal["head", "torso", "hand", "leg"]


class BodyField(Description):
    """A disc on the skin of a part, and the motion in response to a touch there (eqs 5-6)."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    """Name of the field, unique in a set of fields."""
    kind: Kind
    """Kind of the generic part that the field lies on."""
    segment: str = ""
    """Segment of the part; empty for skin that belongs to no segment."""
    towards: Annotated[Vector, Field(strict=False)]
    """Direction (3,) of the centre, see `tci.messages.Landmark`."""
    radius_m: Annotated[float, Field(gt=0.0, le=1.0)]
    """Geodesic radius r_i [m]."""
    motion_deg: dict[str, float]
    """Base motion Theta_i [degrees] by generic joint."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        valid = JOINTS[self.kind]
        if unknown := [joint for joint in self.motion_deg if joint not in valid]:
            raise ValueError(
                f"motion_deg names {', '.join(unknown)}, which a {self.kind} lacks; valid: {', '.join(valid)}"
            )
        if not any(self.motion_deg.values()) or not any(self.towards):
            raise ValueError("motion_deg and towards must not be all zero")
        return self

    @property
    def spot(self) -> Landmark:
        """Centre of the field, as a landmark of the body surface."""
        return Landmark(self.segment, self.towards)

    @property
    def motion(self) -> tuple[float, ...]:
        """Base motion Theta_i (n,) [rad], one angle for each generic joint of the kind."""
        return tuple(radians(self.motion_deg.get(joint, 0.0)) for joint in JOINTS[self.kind])


class BodyFields(Description):
    """A set of fields, and the range of force over which their responses grow."""

    force: ForceRange
    field: Annotated[tuple[BodyField, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="after")
    def _one_name_each(self) -> Self:
        names = [field.name for field in self.field]
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"{', '.join(repeated)}: each field needs its own name")
        return self


def default_body_fields() -> BodyFields:
    """Returns the fields that come with TCI. Their values are assumed: nobody has published any."""
    with as_file(files("tci.capabilities") / "body_withdrawal.toml") as path:
        return load_body_fields(path)


def load_body_fields(path: str | Path) -> BodyFields:
    """Reads the fields from a TOML file. Raises DescriptionError with every fault of the file at once."""
    try:
        raw: dict[str, Any] = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        return BodyFields.model_validate(raw)
    except OSError as error:
        faults = [f"can't be read: {error.strerror}"]
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        faults = [f"is not TOML in UTF-8: {error}"]
    except ValidationError as error:
        faults = [_sentence(fault) for fault in error.errors()]
    raise DescriptionError(str(path), [Fault(0, fault) for fault in faults])


def _sentence(fault: Any) -> str:
    place = ".".join(str(key + 1 if isinstance(key, int) else key) for key in fault["loc"])
    what = fault["msg"].removeprefix("Value error, ")
    return f"{place}: {what}" if place else what

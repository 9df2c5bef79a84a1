"""Receptive fields of head, torso, hands and legs: discs on the skin, and the file that holds them."""

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

Of head and torso pitch nods forward, roll leans right, yaw turns left. Of legs and hands signs are the same
on both sides: flexion of hip, knee and wrist, abduction, internal rotation, toes up, sole inwards, thumb
forward. Zero is standing with straight legs, or the wrist straight.
"""
Kind = Literal["head", "torso", "hand", "leg"]


class BodyField(Description):
    """A disc on a part's skin, and the motion that a touch there provokes (eqs 5-6)."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    """Its name, unique in a set of fields."""
    kind: Kind
    """Kind of the part that it lies on."""
    segment: str = ""
    """Segment of the part; empty for all that is on none."""
    towards: Annotated[Vector, Field(strict=False)]
    """Place of its centre, see `tci.messages.Landmark`."""
    radius_m: Annotated[float, Field(gt=0.0, le=1.0)]
    """Geodesic radius r_i [m]."""
    motion_deg: dict[str, float]
    """Base motion Theta_i [degrees] by generic joint."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        valid = JOINTS[self.kind]
        if unknown := [joint for joint in self.motion_deg if joint not in valid]:
            raise ValueError(f"motion_deg names {', '.join(unknown)}; a {self.kind} has {', '.join(valid)}")
        if not any(self.motion_deg.values()) or not any(self.towards):
            raise ValueError("motion_deg and towards must not be all zero")
        return self

    @property
    def spot(self) -> Landmark:
        """Its centre."""
        return Landmark(self.segment, self.towards)

    @property
    def motion(self) -> tuple[float, ...]:
        """Theta_i [rad] of every generic joint of the kind."""
        return tuple(radians(self.motion_deg.get(joint, 0.0)) for joint in JOINTS[self.kind])


class BodyFields(Description):
    """A set of fields with the forces between which their responses grow."""

    force: ForceRange
    field: Annotated[tuple[BodyField, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="after")
    def _one_name_each(self) -> Self:
        names = [field.name for field in self.field]
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"{', '.join(repeated)}: each field needs its own name")
        return self


def default_body_fields() -> BodyFields:
    """The fields that come with TCI. Their values are ours."""
    with as_file(files("tci.capabilities") / "body_withdrawal.toml") as path:
        return load_body_fields(path)


def load_body_fields(path: str | Path) -> BodyFields:
    """The fields of a file. Raises DescriptionError with every fault at once."""
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

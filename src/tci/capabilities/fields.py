"""Receptive fields and their base motions (§4.1), read from TOML files.

Fields of arms are circles on the generic limb. Fields of other parts are discs on the skin around a landmark.
There is one file for arms and one file for the other parts. Each file is valid for all robots and both sides.
"""

from __future__ import annotations

import tomllib
from collections import Counter
from functools import cache
from importlib.resources import as_file, files
from math import radians
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator

from tci.errors import DescriptionError, Fault
from tci.messages import Landmark, LimbPlace
from tci.robot.description import Description, Vector
from tci.robot.generic_arm import JOINTS
from tci.skin.contacts import Measure

BODY_JOINTS = {
    "head": ("pitch", "roll", "yaw"),
    "torso": ("pitch", "roll", "yaw"),
    "hand": ("flexion", "deviation"),
    "leg": ("hip_pitch", "hip_roll", "hip_yaw", "knee_pitch", "ankle_pitch", "ankle_roll"),
}
"""Generic joints of each kind of part, by index.

Positive directions:

- Head and torso: pitch nods forward, roll leans right, yaw turns left.
- Legs, on both sides: flexion of hip and knee, abduction, internal rotation, toes up, sole inwards.
- Hands, on both sides: flexion of the wrist, thumb forward.

At angles of zero, the robot stands upright with straight legs and straight wrists.
"""
BodyKind = Literal["head", "torso", "hand", "leg"]


def _one_angle_per_joint(motion: tuple[float, ...]) -> tuple[float, ...]:
    if len(motion) != len(JOINTS):
        raise ValueError(f"needs {len(JOINTS)} angles ({', '.join(JOINTS)})")
    return motion


Motion = Annotated[tuple[float, ...], Field(strict=False), AfterValidator(_one_angle_per_joint)]


class Circle(Description):
    """Position and size of a receptive field. Base class of `ReceptiveField`, and of the class for a field's
    table in a TOML file."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    """Name of the field. No other field of a set has this name."""
    segment: Literal["upper_arm", "forearm"]
    """Segment of the arm on which the field lies."""
    u: Annotated[float, Field(ge=0.0, le=1.0)]
    """Centre along the segment: 0 at the proximal joint, 1 at the distal joint."""
    radius: Annotated[float, Field(gt=0.0)]
    """Radius of the field [segment lengths]: r_i in eqs. 5-7 of the paper."""


class ForceRange(Description):
    """Range of force over which a response increases from none to full."""

    threshold_n: Annotated[float, Field(ge=0.0)]
    """Threshold delta_f [N]: forces up to this value cause no response."""
    saturation_n: float
    """Saturation F_sat [N]: forces from this value on cause the full response."""

    @model_validator(mode="after")
    def _rises(self) -> Self:
        if not self.saturation_n > self.threshold_n:
            raise ValueError(f"saturation_n must be above threshold_n, which is {self.threshold_n:g}")
        return self


class ReceptiveField(Circle):
    """A place on the generic limb, and the motion in response to a touch at this place (eqs. 5-6)."""

    theta: float
    """Angle [rad] of the field's centre around the segment: 0 flexor, +pi/2 lateral, pi extensor, -pi/2
    medial side."""
    measure: Measure = "total"
    """Force of a contact that is compared with `threshold` and `saturation`. "total": force of the whole
    contact. "weighted": weighted mean of the forces of its taxels (eq. 7). "peak": force of the strongest
    taxel."""
    threshold: Annotated[float, Field(ge=0.0)]
    """Threshold delta_f [N]: forces up to this value cause no response."""
    saturation: float
    """Saturation F_sat [N]: forces from this value on cause the full response."""
    motion: Motion
    """Base motion Theta_i (5,) [rad] of the generic arm."""

    @property
    def place(self) -> LimbPlace:
        """Centre of the field on the generic limb."""
        return LimbPlace(self.segment, self.u, self.theta)

    @model_validator(mode="after")
    def _rises(self) -> Self:
        if not self.saturation > self.threshold:
            raise ValueError(f"saturation {self.saturation:g} must be above threshold {self.threshold:g}")
        return self


class BodyMotion(Description):
    """A base motion of a part: the response "blended" mixes those of the touched segment."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    """Name of the motion or field. No other one of a set has this name."""
    kind: BodyKind
    """Kind of the generic part that is touched."""
    segment: str = ""
    """Segment of the part. The text is empty for skin that belongs to no segment."""
    motion_deg: dict[str, float]
    """Base motion Theta_i [degrees] by generic joint."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        valid = BODY_JOINTS[self.kind]
        if unknown := [joint for joint in self.motion_deg if joint not in valid]:
            raise ValueError(
                f"motion_deg names {', '.join(unknown)}, which a {self.kind} lacks; valid: {', '.join(valid)}"
            )
        if not any(self.motion_deg.values()):
            raise ValueError("motion_deg must not be all zero")
        return self

    @property
    def motion(self) -> tuple[float, ...]:
        """Base motion Theta_i (n,) [rad], with one angle for each of the n generic joints of a part of this
        kind."""
        return tuple(radians(self.motion_deg.get(joint, 0.0)) for joint in BODY_JOINTS[self.kind])


class BodyField(BodyMotion):
    """A disc on the skin of a part, and the motion in response to a touch of this disc (eqs 5-6)."""

    towards: Annotated[Vector, Field(strict=False)]
    """Direction (3,) of a ray from the middle of the skin. The ray reaches the skin at the centre of the
    field, see `tci.messages.Landmark`."""
    radius_m: Annotated[float, Field(gt=0.0, le=1.0)]
    """Radius r_i [m], measured along the skin (geodesic)."""

    @model_validator(mode="after")
    def _points(self) -> Self:
        if not any(self.towards):
            raise ValueError("towards must not be all zero")
        return self

    @property
    def landmark(self) -> Landmark:
        """Centre of the field as a landmark on the skin."""
        return Landmark(self.segment, self.towards)


class BodyFields(Description):
    """A set of fields, and the range of force over which their responses increase from none to full."""

    force: ForceRange
    field: Annotated[tuple[BodyField, ...], Field(min_length=1, strict=False)]
    surround: Annotated[tuple[BodyMotion, ...], Field(strict=False)] = ()
    """What the response "blended" mixes; without any, the motions of the fields."""

    @model_validator(mode="after")
    def _one_name_each(self) -> Self:
        names = [one.name for one in (*self.field, *self.surround)]
        if repeated := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"{', '.join(repeated)}: each field needs its own name")
        return self


class _FieldTable(Circle):
    """One receptive field of arms as a table in a TOML file, `[[field]]` or `[[surround]]`, with angles in
    degrees."""

    theta_deg: float
    motion_deg: Motion


class _FieldsFile(Description):
    """Contents of a TOML file with the receptive fields of arms."""

    force: dict[Measure, ForceRange]
    field: Annotated[list[_FieldTable], Field(min_length=1)]
    surround: Annotated[list[_FieldTable], Field(default_factory=list)]


@cache
def default_fields(*, measure: Measure = "total") -> tuple[ReceptiveField, ...]:
    """Returns the five default fields of arms. All values of the fields are assumed, since no values are
    published."""
    with as_file(files("tci.capabilities") / "withdrawal.toml") as path:
        return load_fields(path, measure=measure)


@cache
def default_surround(*, measure: Measure = "total") -> tuple[ReceptiveField, ...]:
    """The default wide fields, each of which moves one joint: the response "blended" mixes them."""
    with as_file(files("tci.capabilities") / "withdrawal.toml") as path:
        return load_fields(path, measure=measure, surround=True)


def load_fields(
    path: str | Path, *, measure: Measure = "total", surround: bool = False
) -> tuple[ReceptiveField, ...]:
    """Reads the fields of arms from a TOML file. The file contains thresholds for several kinds of force;
    `measure` selects one kind.

    With `surround`, the wide fields are read instead. Raises DescriptionError with all faults of the file.
    """
    raw = _read(path)
    faults = [*_structure_faults(raw, _FieldsFile, _FieldTable), *_repeated_names(raw)]
    if isinstance(ranges := raw.get("force"), dict) and measure not in ranges:
        stated = ", ".join(ranges) or "none"
        faults.append(f"force: no thresholds for the measure {measure!r}; the file has: {stated}")
    if faults:
        raise DescriptionError(str(path), [Fault(0, fault) for fault in faults])
    content = _FieldsFile.model_validate(raw)
    limits = content.force[measure]
    return tuple(
        ReceptiveField(
            name=table.name,
            segment=table.segment,
            u=table.u,
            theta=radians(table.theta_deg),
            radius=table.radius,
            measure=measure,
            threshold=limits.threshold_n,
            saturation=limits.saturation_n,
            motion=tuple(radians(angle) for angle in table.motion_deg),
        )
        for table in (content.surround if surround else content.field)
    )


def default_body_fields() -> BodyFields:
    """Returns the default fields of head, torso, hands and legs.

    All values of the fields are assumed, since no values are published.
    """
    with as_file(files("tci.capabilities") / "body_withdrawal.toml") as path:
        return load_body_fields(path)


def load_body_fields(path: str | Path) -> BodyFields:
    """Reads the fields of head, torso, hands and legs from a TOML file.

    Raises DescriptionError with all faults of the file.
    """
    raw = _read(path)
    if faults := _structure_faults(raw, BodyFields, BodyField):
        raise DescriptionError(str(path), [Fault(0, fault) for fault in faults])
    return BodyFields.model_validate(raw)


def _read(path: str | Path) -> dict[str, Any]:
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        fault = f"can't be read: {error.strerror}"
    except UnicodeDecodeError as error:
        fault = f"is not UTF-8 text: {error.reason} at byte {error.start}"
    except tomllib.TOMLDecodeError as error:
        fault = f"is not TOML: {error}"
    raise DescriptionError(str(path), [Fault(0, fault)])


def _structure_faults(raw: dict[str, Any], whole: type[Description], field: type[Description]) -> list[str]:
    """Checks the content `raw` of a file of receptive fields, and returns its faults as sentences. Valid
    content fits the class `whole`, and each field in it fits the class `field`."""
    try:
        whole.model_validate(raw)
    except ValidationError as error:
        return [_sentence(raw, fault, whole, field) for fault in error.errors()]
    return []


def _sentence(raw: dict[str, Any], fault: Any, whole: type[Description], field: type[Description]) -> str:
    """Returns a fault of the file's content as text with place and value, for example `field 2
    (forearm_lateral), radius: ...; got -1`."""
    keys, place, kind = [key for key in fault["loc"] if key != "[key]"], "", whole
    what = fault["msg"].removeprefix("Value error, ")
    if not keys:
        return str(what)
    if keys[0] == "force":
        kind = ForceRange
    if keys[0] in ("field", "surround") and len(keys) > 1:
        table = raw[keys[0]][keys[1]]
        name = table.get("name", "no name") if isinstance(table, dict) else "no table"
        place, kind = f"{keys[0]} {keys[1] + 1} ({name})", field
        if keys[0] == "surround" and field is BodyField:
            kind = BodyMotion
        keys = keys[2:]
    where = ", ".join(filter(None, [place, ".".join(map(str, keys))]))
    if fault["type"] == "extra_forbidden":
        return f"{where}: unknown key; valid: {', '.join(kind.model_fields)}"
    value = "" if fault["type"] == "missing" else f"; got {fault['input']!r}"
    return f"{where}: {what}{value}"


def _repeated_names(raw: dict[str, Any]) -> list[str]:
    kinds = [tables for key in ("field", "surround") if isinstance(tables := raw.get(key), list)]
    names = [table.get("name") for tables in kinds for table in tables if isinstance(table, dict)]
    counts = Counter(name for name in names if isinstance(name, str))
    return [
        f"{count} fields are named {name!r}; each needs its own name"
        for name, count in counts.items()
        if count > 1
    ]

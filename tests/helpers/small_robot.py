"""A small robot for tests of the skin, with two thin arms whose servos are the generic joints.

The skin of the left forearm turns with pronation, as on an iCub. The other patches do not turn. The right arm
has a mount of 0.2 rad. The limbs have a radius of 25 mm.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tci.messages import JointReading, Reading, SkinFrame
from tci.robot.description import (
    GenericPart,
    GenericServo,
    Model,
    Patch,
    Robot,
    Segment,
    Sensor,
    Servo,
    TruncatedCone,
)
from tci.robot.generic_arm import JOINTS, Side

RADIUS = 0.025
UPPER, LOWER = 0.15, 0.12
MOUNT = 0.2
RINGS, PER_RING = 16, 24
TAXELS = RINGS * PER_RING
REST = 240
PASCAL = 700.0


def build(folder: Path) -> Robot:
    """Writes the model into `folder` and returns the robot."""
    path = folder / "small.xml"
    path.write_text(
        f"<mujoco><worldbody><body name='torso'>{_arm('l', 1)}{_arm('r', -1)}</body></worldbody></mujoco>"
    )
    sides: tuple[tuple[Side, str, float], ...] = (("left", "l", 0.0), ("right", "r", MOUNT))
    return Robot(
        name="small",
        source="small",
        digest="0" * 64,
        model=Model(format="mjcf", path=str(path), torso_link="torso"),
        servos=tuple(
            Servo(
                index=5 * k + i, robot_part=f"{letter}_arm", id=i, name=f"{letter}{i}", joint=f"{letter}{i}"
            )
            for k, (_, letter, _) in enumerate(sides)
            for i in range(5)
        ),
        parts=tuple(
            GenericPart(
                name=f"{side}_arm",
                kind="arm",
                side=side,
                mount=(0.0, 0.0, mount),
                servos=tuple(GenericServo(id=i, name=JOINTS[i], servo=5 * k + i) for i in range(5)),
                segments=(
                    Segment(name="upper_arm", link="torso", origin=(0.0, 0.1 - 0.2 * k, 0.0), length=UPPER),
                    Segment(name="forearm", link=f"{letter}_2", origin=(0.0, 0.0, -UPPER), length=LOWER),
                ),
            )
            for k, (side, letter, mount) in enumerate(sides)
        ),
        patches=(
            _patch("left_arm", "forearm", "l_4", 0.0),
            _patch("left_arm", "upper_arm", "l_1", -0.02),
            _patch("right_arm", "forearm", "r_3", 0.0),
        ),
    )


def _arm(letter: str, s: int) -> str:
    """Returns the XML of five hinges: Ry(-g0) Rx(s g1) Rz(-s g2), the upper arm, Ry(-g3) Rz(-s g4)."""
    axes = ("0 -1 0", f"{s} 0 0", f"0 0 {-s}", "0 -1 0", f"0 0 {-s}")
    half = 0.0 if s > 0 else MOUNT / 2
    text = ""
    for i in reversed(range(5)):
        place = f"pos='0 {0.1 * s} 0' quat='{np.cos(half)} 0 0 {np.sin(half)}'" if i == 0 else "pos='0 0 0'"
        if i == 3:
            place = f"pos='0 0 {-UPPER}'"
        joint = f"<joint name='{letter}{i}' axis='{axes[i]}'/>"
        text = f"<body name='{letter}_{i}' {place}>{joint}<geom size='0.01'/>{text}</body>"
    return text


def _patch(part: str, segment: str, link: str, z: float) -> Patch:
    return Patch(
        name=f"{part}_{segment}",
        part=part,
        segment=segment,
        link=link,
        rate=100.0,
        channels=TAXELS,
        sensor=Sensor(rest=float(REST), pascal_per_count=-PASCAL, lowest=0.0, highest=255.0),
        surface=TruncatedCone(
            origin=(0.0, 0.0, z),
            rpy=(0.0, 0.0, 0.0),
            length=0.1,
            r1=RADIUS,
            r2=RADIUS,
            rings=RINGS,
            per_ring=PER_RING,
        ),
    )


def joints(position: np.ndarray, *, sequence: int = 0) -> JointReading:
    """Returns a joint reading at rest."""
    return JointReading(0.01 * sequence, sequence, position, np.zeros(10))


def frame(patch: str, pressed: dict[int, int], *, sequence: int = 0, stamp: float | None = None) -> SkinFrame:
    """Returns a frame in which each channel in `pressed` is the given number of counts below its rest
    value."""
    values = np.full(TAXELS, REST, np.uint8)
    for channel, counts in pressed.items():
        values[channel] = REST - counts
    return SkinFrame(patch, 0.01 * sequence if stamp is None else stamp, sequence, values)


def reading(*frames: SkinFrame, position: np.ndarray | None = None) -> Reading:
    """Returns a reading of the whole robot, with all joints at zero unless `position` is given."""
    return Reading(joints(np.zeros(10) if position is None else position), frames)

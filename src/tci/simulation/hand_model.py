"""A person's hand in MuJoCo's model: a mass on three springs (the arm), on which six capsules, a palm and
five finger tips, slide on springs of their own (the pads), all together sideways on two more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tci.errors import CommandError
from tci.robot.collisions import PERSON
from tci.robot.neutral import neutral
from tci.simulation.hand_control import SLOTS
from tci.simulation.hand_path import PADS
from tci.simulation.touch import FINGER_PRIORITY, FRICTION, stiff
from tci.support.engine import mujoco

PERSON_PRIORITY = FINGER_PRIORITY + 3
"""The contact's settings are those of the person, whatever the robot's model says of its own geoms."""
SOFT = [0.0, 0.95, 5e-4, 0.5, 2.0]
"""MuJoCo's `solimp`: skin gives way by some tenths of a millimetre. With the usual 0.9 for a shallow contact,
a light pad lies so near the surface that single steps of a lasting contact are missed."""
MARGIN = 5e-4
"""Distance [m] at which a contact begins. Assumed: a firm touch is less deep, and outside of a body distances
are exact."""
SIDES = "left", "right"
PAD_MASS = 0.015
"""Mass [kg] of a pad. Assumed: light, so that the blow is that of the hand behind it."""
FLESH_MASS = 0.01
"""Mass [kg] of what lies between the hand's bones and its pads, which gives way sideways: else the edge of a
link that comes from the side would strike 0.6 kg rigidly, with hundreds of newtons. Assumed: light."""
PAD_DAMPING, ARM_DAMPING = 0.5, 0.7
"""Damping ratios. Assumed."""
_PALM, _TIP = (0.014, 0.025), (0.007, 0.012)
"""Radius and half length [m] of the palm's capsule, which lies across the fingers, and of a finger's, whose
tip points at the skin. Assumed: an adult's."""
_COLOUR = (0.85, 0.55, 0.45, 1.0)


@dataclass(frozen=True, kw_only=True)
class PersonModel:
    """A person who touches. Raises CommandError for a number out of range."""

    name: str = "person"
    mass: float = 0.6
    """Of a hand [kg]."""
    pad: float = 1500.0
    """Stiffness [N/m] of a pad, and of all together sideways; people's are 1000 to 2000."""
    arm: float = 500.0
    """Stiffness of the arm at the hand [N/m]; people's are 200 to 800."""
    delay: float = 0.15
    """From what is seen and felt to the muscle [s]."""
    bandwidth: float = 3.0
    """Of what is corrected [Hz]."""
    hands: Sequence[str] = SIDES
    """Some of `SIDES`: each hand makes the simulation slower, also while it waits."""

    def __post_init__(self) -> None:
        ranges = {"mass": (0.05, 5.0), "pad": (200.0, 5000.0), "arm": (50.0, 5000.0), "delay": (0.0, 0.5),
                  "bandwidth": (0.1, 3.0)}  # fmt: skip
        if not self.hands or not set(self.hands) <= set(SIDES) or len(set(self.hands)) < len(self.hands):
            raise CommandError(f"hands {self.hands} of {self.name}; valid: some of {', '.join(SIDES)}")
        for name, (low, high) in ranges.items():
            if not low <= (value := getattr(self, name)) <= high:
                raise CommandError(f"{name} {value} of {self.name}; valid: {low:g} to {high:g}")


def add_hand(spec: mujoco.MjSpec, name: str, person: PersonModel, *, step: float, bit: int) -> None:
    """Adds a hand with its own collision `bit` (`collisions.HANDS`), out of reach."""
    plain = neutral(spec)
    axes, slide = np.eye(3), mujoco.mjtJoint.mjJNT_SLIDE
    hand = spec.worldbody.add_body(
        name=name, gravcomp=1.0, mass=person.mass, inertia=[1e-3] * 3, explicitinertial=True
    )
    damping = 2.0 * ARM_DAMPING * np.sqrt(person.arm * person.mass)
    for axis, direction in zip("xyz", axes, strict=True):
        hand.add_joint(plain, name=f"{name}_{axis}", type=slide, axis=direction)
        arm = spec.add_actuator(
            plain, name=f"{name}_{axis}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"{name}_{axis}"
        )
        arm.set_to_position(kp=person.arm, kv=damping)
    flesh = hand.add_body(name=f"{name}_flesh", gravcomp=1.0, mass=FLESH_MASS, inertia=[1e-6] * 3,
                          explicitinertial=True)  # fmt: skip
    sideways = 2.0 * PAD_DAMPING * np.sqrt(person.pad * (FLESH_MASS + len(PADS) * PAD_MASS))
    for axis, direction in zip("xy", axes, strict=False):
        flesh.add_joint(
            plain, name=f"{name}_flesh_{axis}", type=slide, axis=direction, stiffness=[person.pad, 0.0, 0.0],
            damping=[sideways, 0.0, 0.0],
        )  # fmt: skip
    soft = 2.0 * PAD_DAMPING * np.sqrt(person.pad * PAD_MASS)
    for pad in PADS:
        body = flesh.add_body(name=f"{name}_{pad}", gravcomp=1.0)
        body.add_joint(
            plain, name=f"{name}_{pad}", type=slide, axis=[0.0, 0.0, 1.0], stiffness=[person.pad, 0.0, 0.0],
            damping=[soft, 0.0, 0.0],
        )  # fmt: skip
        radius, half = _PALM if pad == "palm" else _TIP
        across = (-half, half) if pad == "palm" else (-2.0 * half, 0.0)
        ends = [[0.0, end, -radius] if pad == "palm" else [0.0, 0.0, end - radius] for end in across]
        body.add_geom(
            plain, name=f"{name}_{pad}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[radius, 0.0, 0.0],
            fromto=np.ravel(ends), mass=PAD_MASS, rgba=_COLOUR, group=2, **contact_of(step, bit),
        )  # fmt: skip
    fields = (mujoco.mjtConDataField.mjCONDATA_FOUND, mujoco.mjtConDataField.mjCONDATA_FORCE,
              mujoco.mjtConDataField.mjCONDATA_POS)  # fmt: skip
    spec.add_sensor(
        name=name, type=mujoco.mjtSensor.mjSENS_CONTACT, objtype=mujoco.mjtObj.mjOBJ_XBODY, objname=name,
        intprm=[sum(1 << int(field) for field in fields), 2, SLOTS],
    )  # fmt: skip


def contact_of(step: float, bit: int = PERSON) -> dict[str, object]:
    """Settings of the contacts of people and things with a robot."""
    return {
        "contype": bit, "conaffinity": 0, "condim": 3, "friction": [FRICTION, 0.005, 1e-4],
        "priority": PERSON_PRIORITY, "solref": stiff(step), "solimp": SOFT,
        "margin": MARGIN, "gap": 0.0,
    }  # fmt: skip

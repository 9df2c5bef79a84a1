"""A compliant simulated finger that pokes the skin. After a poke the finger stays at the skin until `retire`
removes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError, TciError
from tci.messages.frames import Array
from tci.robot.collisions import SKIN
from tci.robot.neutral import neutral
from tci.simulation.physics import Physics, exclusive
from tci.simulation.posed_skin import PosedSkin
from tci.simulation.stepping import POKE
from tci.simulation.touch import FINGER_PRIORITY, FINGER_TIP, skin_geom, stiff
from tci.support.engine import mujoco

RADIUS = 0.005
"""Radius of the tip [m]."""
STIFFNESS = 800.0
"""Stiffness [N/m] of the spring between base and tip. If the base moves 2 mm farther than the skin's surface,
the force is 1.6 N. A nearly rigid finger would press with 19 N."""
MASS = 0.02
"""Mass of the tip [kg]. Assumed: light, so that the tip follows the skin. A lighter tip needs smaller
simulation steps."""
DAMPING = 1.4 * np.sqrt(STIFFNESS * MASS)
"""Damping [N s/m] between base and tip. Assumed: 0.7 of the critical damping."""
TRACE = 60_000
"""Number of steps that the trace contains: 60 s with the default step."""

FINGER = "tci_finger_base"
"""Name of the body that contains the whole finger."""
_TIP = FINGER_TIP
PARKED = np.array([0.0, 0.0, -20.0])
_SHAFT = 0.06
_COLOUR = (0.85, 0.55, 0.45, 1.0)
_OVERLAP = 5e-4
"""Largest depth [m] inside the skin at which the finger may start. Assumed: this is larger than the solver's
tolerance and smaller than a visible overlap."""
_PRESSED = 2e-4
"""Depth [m] of the tip in the skin at a force of 8 N. If the tip at this depth also touches a surface without
taxels, the poke is refused."""


def add_finger(spec: mujoco.MjSpec, *, step: float, radius: float = RADIUS) -> None:
    """Adds the finger, far away from the robot.

    The finger's base can be placed anywhere. The tip slides along the z axis of the base.
    """
    plain = neutral(spec)
    base = spec.worldbody.add_body(name=FINGER, mocap=True, pos=PARKED)
    tip = base.add_body(name=_TIP, gravcomp=1.0)
    tip.add_joint(plain, name=_TIP, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0])
    tip.add_geom(
        plain,
        name=_TIP,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[radius, 0.0, 0.0],
        mass=MASS,
        contype=SKIN,
        conaffinity=0,
        # Without friction a contact's force is normal to the skin. Taxels measure only the normal force.
        condim=1,
        priority=FINGER_PRIORITY,
        solref=stiff(step),
        group=2,
        rgba=_COLOUR,
    )
    # The shaft needs a separate body. If tip and shaft shared one body, most rays of MuJoCo would miss the
    # shaft.
    tip.add_body(gravcomp=1.0).add_geom(
        plain,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[RADIUS, 0.0, 0.0],
        fromto=[0.0, 0.0, 0.0, 0.0, 0.0, -_SHAFT],
        mass=0.0,
        contype=0,
        conaffinity=0,
        group=2,
        rgba=_COLOUR,
    )
    spring = spec.add_actuator(plain, name=_TIP, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=_TIP)
    spring.set_to_position(kp=STIFFNESS, kv=DAMPING)
    spec.add_sensor(
        name=_TIP,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_GEOM,
        objname=_TIP,
        intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1],
    )


class Finger:
    """The simulated finger of a world: a sphere, usually of 10 mm diameter, on a spring of 800 N/m.

    A poke moves the spring's base along the skin's inward normal at a constant speed. After the tip's first
    contact, the base moves by another `depth` [m] and then stops. The stopped base does not move again, even
    if the skin moves.
    """

    def __init__(self, physics: Physics, skin: PosedSkin, unfelt: Callable[[], Sequence[str]]) -> None:
        """Creates a finger, which stays far away from the robot until a poke. `unfelt` returns the names of
        those patches that are touched now, but only at places without taxels."""
        model = physics.model
        self._physics = physics
        self._skin = skin
        self._unfelt = unfelt
        self._geom = model.geom(_TIP).id
        self.radius = float(model.geom_size[self._geom, 0])
        """Radius of the tip [m]."""
        self._tip = model.body(_TIP).id
        self.mocap = int(model.body(FINGER).mocapid[0])
        self.qpos = int(model.joint(_TIP).qposadr[0])
        self.dof = int(model.joint(_TIP).dofadr[0])
        self.actuator = model.actuator(_TIP).id
        self.state = np.zeros(1, POKE)
        """State and measurements of the finger."""
        self._poke: Any = self.state[0]
        self._poke["actuator"], self._poke["sensor"] = self.actuator, model.sensor(_TIP).adr[0]
        self._poke["leads"] = DAMPING / STIFFNESS
        self.traced = np.empty((TRACE, 3))
        """Ring buffer (steps, 3) of the last steps: time [s], contact force [N], and distance [m] that the
        finger's base has moved in this poke."""
        self.retire()

    @exclusive
    def retire(self) -> None:
        """Removes the finger at once and clears its measurements."""
        data = self._physics.data
        data.mocap_pos[self.mocap] = PARKED
        data.qpos[self.qpos] = data.qvel[self.dof] = data.ctrl[self.actuator] = 0.0
        self._poke["active"] = 0
        self._clear()
        self._physics.touch()

    def _clear(self) -> None:
        poke = self._poke
        poke["force"] = poke["peak"] = 0.0
        poke["first"] = poke["lost"] = np.nan
        poke["traced"] = 0

    @property
    def force(self) -> float:
        """Contact force [N] on the tip in the latest step."""
        return float(self._poke["force"])

    @property
    def first_contact(self) -> float | None:
        """Time [s] of the tip's first contact in this poke. The value is None if there was no contact."""
        return self._stamp("first")

    @property
    def contact_lost(self) -> float | None:
        """Time [s] when the tip last lost contact. The value is None while the tip touches the skin."""
        return self._stamp("lost")

    @property
    def peak_force(self) -> float:
        """Largest contact force [N] of this poke."""
        return float(self._poke["peak"])

    def _stamp(self, name: str) -> float | None:
        stamp = float(self._poke[name])
        return None if np.isnan(stamp) else stamp

    @property
    def active(self) -> bool:
        """True from the start of a poke until the finger is removed."""
        return bool(self._poke["active"])

    @property
    def pose(self) -> Array | None:
        """`T_WF` (4, 4): pose of the tip's centre in the world frame.

        The z axis of F points into the skin. The value is None if the finger is removed.
        """
        return self._physics.pose(self._tip) if self._poke["active"] else None

    @property
    def touching(self) -> bool:
        """True if the tip touched the skin in the latest step."""
        return self.force > 0.0

    @property
    def trace(self) -> Array:
        """Array (steps, 3) with the time [s], the contact force [N], and the distance [m] that the base has
        moved in this poke, for each of the last 60 000 steps."""
        count = int(self._poke["traced"])
        if count <= TRACE:
            return self.traced[:count].copy()
        return np.roll(self.traced, -count, axis=0)

    @exclusive
    def poke(
        self,
        patch: str,
        place: int | ArrayLike,
        normal: ArrayLike | None = None,
        *,
        speed: float = 0.25,
        depth: float = 0.01,
        gap: float = 0.004,
    ) -> None:
        """Starts a poke at a point on the skin, along the inward normal in the current posture.

        `place` is a taxel, or a point (3,) [m] in the frame of the patch's link. An outward `normal` (3,) in
        the link's frame replaces the surface normal, if given. `speed` [m/s] is the speed of the finger's
        base, which a spring connects to the tip. `depth` [m] determines the force: `depth * 800 N/m` once the
        base rests. `gap` [m] is the distance from tip to skin at the start. Raises UnknownNameError for an
        unknown patch, and CommandError for an invalid number. Raises TciError if the finger would start
        inside another patch, or would also touch another patch at a place without taxels.
        """
        point, outward = self._skin.point(patch, place, normal)
        self._start(point, outward, speed, depth, gap)
        self._check_way(patch, gap)

    @exclusive
    def covered(self, patch: str) -> bool:
        """True if the tip would meet another patch before `patch`, to which this poke was sent."""
        data, own = self._physics.data, {self._geom, self._physics.model.geom(skin_geom(patch)).id}
        data.qpos[self.qpos] = self._poke["end"] - self._poke["depth"]
        self._physics.touch()
        self._physics.refresh()
        found = data.contact[: data.ncon]
        inside = any(
            self._geom in one.geom and one.dist < -_OVERLAP and not own.issuperset(one.geom) for one in found
        )
        data.qpos[self.qpos] = 0.0
        self._physics.touch()
        self._physics.refresh()
        return inside

    @exclusive
    def poke_at(
        self,
        point: ArrayLike,
        normal: ArrayLike,
        *,
        speed: float = 0.25,
        depth: float = 0.01,
        gap: float = 0.004,
    ) -> None:
        """Starts a poke at a `point` (3,) [m] against the outward `normal` (3,).

        Point and normal are in the torso frame.
        """
        start, outward = self._skin.from_torso(point, normal)
        self._start(start, outward, speed, depth, gap)

    @exclusive
    def pull(self, way: float) -> None:
        """Moves the finger's base at once by `way` [m] out of the skin, opposite to the direction of the
        poke."""
        outward = np.empty(3)
        mujoco.mju_rotVecQuat(outward, [0.0, 0.0, -1.0], self._physics.data.mocap_quat[self.mocap])
        self._physics.data.mocap_pos[self.mocap] += way * outward
        self._physics.touch()

    def _start(self, point: Array, outward: Array, speed: float, depth: float, gap: float) -> None:
        for name, value in (("speed", speed), ("depth", depth), ("gap", gap)):
            if not (np.isfinite(value) and value >= 0.0 and (value > 0.0 or name != "speed")):
                raise CommandError(f"{name} {value}; valid: finite, at least 0, and a speed above 0")
        data = self._physics.data
        data.mocap_pos[self.mocap] = point + (self.radius + gap) * outward
        mujoco.mju_quatZ2Vec(data.mocap_quat[self.mocap], -outward)
        # The tip starts at full speed. Otherwise the tip would oscillate on the spring.
        data.qpos[self.qpos] = 0.0
        data.qvel[self.dof] = speed
        self._clear()
        one = self._poke
        one["active"], one["path"], one["end"] = 1, 0.0, gap + depth
        one["begin"], one["speed"], one["depth"] = self._physics.time, speed, depth
        self._physics.touch()
        self._check_room()

    def _check_room(self) -> None:
        """Raises TciError if the finger starts inside the skin.

        In this case the contact force would be too large and at a wrong point.
        """
        self._physics.refresh()
        model, data = self._physics.model, self._physics.data
        for contact in data.contact[: data.ncon]:
            if self._geom in contact.geom and contact.dist < -_OVERLAP:
                other = model.geom(int(contact.geom[contact.geom != self._geom][0])).name
                self.retire()
                raise TciError(f"no room for the finger: it would start {-contact.dist:.4f} m inside {other}")

    def _check_way(self, patch: str, gap: float) -> None:
        """Raises TciError if a finger that touches `patch` also touches another patch at a place without
        taxels, such as the end of a limb.

        In this case no taxel would measure the force on the other patch. `gap` [m] is the distance from the
        tip to `patch`.
        """
        data = self._physics.data
        data.qpos[self.qpos] = gap + _PRESSED
        self._physics.touch()
        others = [name for name in self._unfelt() if name != patch]
        data.qpos[self.qpos] = 0.0
        self._physics.touch()
        self._physics.refresh()  # or a reading before the next step would contain the torques of this touch
        if others:
            self.retire()
            raise TciError(
                f"no room for the finger: {' and '.join(others)} would touch it too, where no taxels are"
            )

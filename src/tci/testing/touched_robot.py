"""Perceptions for tests of capabilities: a robot that does not move and is touched as the test requests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.body.posture import to_platform
from tci.errors import CommandError, UnknownNameError
from tci.messages import GenericCommand, JointReading, Mode, Perception, Reading, SkinFrame
from tci.messages.frames import Array, read_only
from tci.robot.description import Patch
from tci.robot.joint_map import initial_position
from tci.robot.like import RobotLike, as_robot
from tci.skin.kernels.contacts import fill_around
from tci.skin.layout import normal_channels
from tci.skin.surfaces import Surface
from tci.touches.kinds import Kind
from tci.touches.laid import LaidTouches
from tci.touches.person import Person
from tci.touches.planned_touch import plan
from tci.touches.touch import Touch

PERIOD = 0.02
"""Time [s] between perceptions. Assumed: skin at 50 Hz, the lowest rate among the described robots."""
WIDTH = 0.6
"""Standard deviation of a touch's pressure, relative to the distance of neighbouring taxels. Assumed: when a
fingertip presses on one taxel, the pressure on the taxels beside it is a quarter of the pressure on that
taxel."""
AFTER = 0.3
"""Time [s] without touch at the end of `TouchedRobot.feel`. Assumed: contacts are told to be over by then."""


def perception(
    robot: RobotLike,
    touch: str | None = None,
    *,
    taxel: int | None = None,
    force: float = 2.0,
    posture: Mapping[str, ArrayLike] | None = None,
) -> Perception:
    """Returns the perception of a robot that is touched on the patch `touch`; with None, the robot is not
    touched.

    A `force` [N] presses on `taxel`, or on the middle of the patch; `posture` contains generic angles [rad]
    by part, instead of the initial posture. For several perceptions of one touch use `TouchedRobot`.
    """
    return TouchedRobot(robot, posture=posture).perceive(touch, taxel=taxel, force=force)


class TouchedRobot:
    """A robot that does not move and is touched as the test requests, without a simulation.

    Raw frames are conditioned and clustered as on a real robot, so a contact keeps its identity from one
    perception to the next.
    """

    def __init__(self, robot: RobotLike, *, posture: Mapping[str, ArrayLike] | None = None) -> None:
        """Sets the generic angles (n,) [rad] of the parts in `posture`, by name; all other parts are in their
        initial posture.

        Raises UnknownNameError for an unknown part, CommandError for a posture of another shape, and the
        errors of `load_robot`.
        """
        self.robot = as_robot(robot)
        self.body = GenericBody(self.robot)
        """The generic body of the robot."""
        self._perceiver = Perceiver(self.body)
        self._position = np.array(initial_position(self.robot))
        for part, angles in (posture or {}).items():
            command = GenericCommand(part, Mode.POSITION, read_only(angles))
            own = to_platform(self.robot, command, position=self._position)
            self._position[own.servos] = own.values
        self._count = -1
        self.perceive()  # the first frame sets the rest values of the taxels

    def perceive(
        self, touch: str | None = None, *, taxel: int | None = None, force: float = 2.0
    ) -> Perception:
        """Advances the time by one `PERIOD` and returns the perception. The robot is touched on the patch
        `touch`; with None, it is not touched.

        The touch is centred on `taxel`, or on the taxel nearest to the middle of the patch. The touch presses
        that taxel, its neighbours and the gaps between them with `force` [N]. The raw values are rounded as
        by the sensor: a switch is only on or off, and a force below a taxel's threshold causes no contact.
        Raises UnknownNameError for an unknown patch or taxel, CommandError for a force that is negative or
        not finite.
        """
        patches = self.robot.skin if touch is None else (self.robot.patch(touch), *self.robot.patches)
        values = {patch.name: np.full(patch.channels, patch.sensor.rest) for patch in patches}
        if touch is not None:
            self._press(values[touch], patches[0], taxel, force)
        return self._perceive(values)

    def feel(
        self,
        touches: Touch | str | Iterable[Touch | str],
        *,
        persons: Mapping[str, Person] | None = None,
        kinds: Mapping[str, Kind] | None = None,
        seed: int = 0,
    ) -> Iterator[Perception]:
        """The perceptions of touches such as `"stroke 'left forearm' 3N 8cm/s"`, one every `PERIOD`, until
        shortly after the last touch. Times of onset count from now.

        The pressure is laid on the taxels without physics, so skin that feels only joint torques feels
        nothing. Raises the errors of `tci.touches.plan`, at once.
        """
        laid = LaidTouches(
            self.body,
            plan(
                self.body, touches, persons=persons, kinds=kinds, joints=self._joints(self.now), seed=seed
            ),
        )  # fmt: skip
        return self._feel(laid)

    @property
    def now(self) -> float:
        """Time [s] of the latest perception."""
        return self._count * PERIOD

    def _feel(self, laid: LaidTouches) -> Iterator[Perception]:
        rest = {patch.name: np.full(patch.channels, patch.sensor.rest) for patch in self.robot.skin}
        times = np.arange(0.0, laid.end + AFTER, PERIOD)
        for block in np.array_split(times, len(times) // 256 + 1):
            touched = laid.frames(block)
            for row in range(len(block)):
                yield self._perceive({**rest, **{patch: raw[row] for patch, raw in touched.items()}})

    def _perceive(self, values: Mapping[str, Array]) -> Perception:
        """Advances the time by one `PERIOD`, with the raw values (channels,) of each patch."""
        self._count += 1
        frames = (SkinFrame(name, self.now, self._count, read_only(raw)) for name, raw in values.items())
        return self._perceiver.step(Reading(self._joints(self.now), tuple(frames)), self.now)

    def _joints(self, now: float) -> JointReading:
        still = read_only(np.zeros(len(self._position)))
        return JointReading(now, self._count, read_only(self._position), still)

    def _press(self, values: Array, patch: Patch, taxel: int | None, force: float) -> None:
        """Adds a touch of `force` [N] on `taxel` (None: the taxel nearest to the middle of the patch) to the
        raw `values` (channels,) of a patch."""
        if not 0.0 <= force < np.inf:
            raise CommandError(f"a touch of {force} N; valid: 0 or more, finite")
        surface, sensor = self.body.skin.surfaces[patch.name], patch.sensor
        pressed, shares = _around(patch, surface, taxel)
        if force == 0.0:
            return
        layout, areas = self.body.layout, surface.areas[pressed]
        taxels = (layout.taxels[layout.places[patch.name]].start + pressed).astype(np.int32)
        room = np.zeros(len(layout.arrays.taxels))
        measured = force * fill_around(read_only(taxels, np.int32), read_only(areas), room, layout.arrays)
        counts = np.round(sensor.counts(shares * measured / (areas @ shares)))
        counts[shares.argmax()] = max(1.0, counts.max())
        values[normal_channels(patch, surface)[pressed]] += np.sign(sensor.pascal_per_count) * counts
        np.clip(values, sensor.lowest, sensor.highest, out=values)


def _around(patch: Patch, surface: Surface, taxel: int | None) -> tuple[NDArray[np.intp], Array]:
    """Returns the indices (k,) of `taxel` (None: the taxel nearest to the middle) and its neighbours, and the
    pressures (k,) that a round object at this taxel exerts on them. The largest pressure is 1."""
    count = len(surface.positions)
    if taxel is None:
        middle = surface.positions.mean(axis=0)
        taxel = int(np.argmin(np.linalg.norm(surface.positions - middle, axis=1)))
    elif not 0 <= taxel < count:
        raise UnknownNameError(f"taxel of {patch.name}", str(taxel), [f"0 to {count - 1}"])
    beside = surface.neighbours[(surface.neighbours == taxel).any(axis=1)]
    pressed = np.unique([taxel, *beside.ravel()])
    apart = np.linalg.norm(surface.positions[pressed] - surface.positions[taxel], axis=1)
    width = WIDTH * apart.sum() / max(len(pressed) - 1, 1)
    return pressed, np.exp(-0.5 * (apart / width) ** 2) if width else np.ones(1)

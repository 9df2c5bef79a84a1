"""Checks the taxels of a skin. The operator presses one taxel after another, and the check compares the place
of the response with the place of the taxel."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.errors import FrameError
from tci.lab.commissioning.operator import Operator
from tci.messages import Reading
from tci.messages.frames import Array
from tci.robot.description import Patch
from tci.runtime.control import Control
from tci.skin.skin import Skin

REST = 0.5
"""Time [s] over which rest values are averaged before a touch. Assumed: every patch sends at least five
frames in this time."""
PRESS = 10.0
"""Longest time [s] to wait for the start of a touch, and then for the end of the touch. Assumed: the operator
finds the place in this time."""
LEAST = 0.02
"""Least change of a value that counts as a touch, as a fraction of the sensor's range. If six times the noise
is larger, the least change is six times the noise. Assumed: a fingertip changes the value by more than 2 % of
the range."""
NEAR = 0.02
"""Largest distance [m] between the place of a correct response and the pressed taxel. Assumed: the size of a
fingertip plus the size of a skin module."""
_WAYS = (("forward", "backward"), ("left", "right"), ("up", "down"))
_SIDES = ("front (the flexor side)", "outer side", "back (the extensor side)", "inner side")


class SkinCheck:
    """Compares the place of a touch by the operator with the place of the skin's response."""

    def __init__(self, driver: Driver, operator: Operator) -> None:
        """Computes the places of all taxels of the robot. Raises the errors of `Skin`."""
        self.driver, self.operator = driver, operator
        self._control = Control(driver, write=False)
        self.skin = Skin(driver.robot)

    def check(self, patch: Patch, count: int | None) -> Iterator[Finding]:
        """Checks `count` taxels of a patch, with equal steps between their indices. If `count` is None,
        checks all taxels."""
        total = len(self.skin.surfaces[patch.name].positions)
        chosen = np.arange(total)
        if count is not None and count < total:
            chosen = np.unique(np.linspace(0, total - 1, count).round().astype(int))
        for taxel in chosen.tolist():
            yield self._check(patch, taxel)

    def _check(self, patch: Patch, taxel: int) -> Finding:
        subject = f"{patch.name} taxel {taxel}"
        rest, noise = self._rest()
        if patch.name not in rest:
            return Finding(Level.FAULT, subject, "its patch sends nothing", "run tci doctor first")
        if not self.operator.press(patch.name, taxel, self._where(patch, taxel)):
            return Finding(Level.NOTE, subject, "not pressed")
        responses: dict[str, Array] = {}
        for moment in self._control.periods(duration=PRESS):
            responses = self._responses(rest, noise, moment.reading)
            if responses:
                break
        self._settle()
        responses = self._responses(rest, noise, self.driver.read()) or responses
        self.operator.release()
        for moment in self._control.periods(duration=PRESS):
            if not self._responses(rest, noise, moment.reading):
                break
        return self._judge(subject, patch, taxel, responses)

    def _judge(self, subject: str, patch: Patch, taxel: int, responses: dict[str, Array]) -> Finding:
        if not responses:
            words = f"no response within {PRESS:.0f} s"
            return Finding(
                Level.FAULT, subject, words, "the taxel is dead or covered: check its module's cable"
            )
        if patch.name not in responses:
            return Finding(
                Level.FAULT, subject, f"the response is on {', '.join(responses)} instead",
                "two patches are swapped: correct the addresses in the description's binding",
            )  # fmt: skip
        change = responses[patch.name]
        if change.sum() < 0.0:
            return Finding(
                Level.FAULT, subject, "its value goes the wrong way",
                "correct the sign of pascal_per_count in the description",
            )  # fmt: skip
        surface = self.skin.surfaces[patch.name]
        weights = np.maximum(change, 0.0)
        centre = weights @ surface.positions / weights.sum()
        away = float(np.linalg.norm(centre - surface.positions[taxel]))
        strongest = int(np.argmax(weights))
        figures = {"away_mm": 1e3 * away, "strongest": float(strongest)}
        if away > NEAR:
            return Finding(
                Level.FAULT, subject,
                f"the response was {1e3 * away:.0f} mm away, strongest at taxel {strongest}",
                "the order of its modules or its table differs from the robot's: tci skin show draws them",
                figures,
            )  # fmt: skip
        return Finding(Level.OK, subject, f"the response was {1e3 * away:.0f} mm away", figures=figures)

    def _responses(
        self, rest: dict[str, Array], noise: dict[str, Array], reading: Reading
    ) -> dict[str, Array]:
        """Returns, for each patch with a response, the change (taxels,) [counts] of its values from the
        values at rest.

        A change in the direction of pressure is positive. Changes below `noise` are set to 0.
        """
        found = {}
        for name, values in self._values(reading).items():
            if name in rest:
                sign = np.sign(self.driver.robot.patch(name).sensor.pascal_per_count)
                change = sign * (values - rest[name])
                change[np.abs(change) < noise[name]] = 0.0
                if change.any():
                    found[name] = change
        return found

    def _rest(self) -> tuple[dict[str, Array], dict[str, Array]]:
        """Returns by patch name the mean value (taxels,) of each taxel at rest, and the least change
        (taxels,) that counts as a touch."""
        samples: dict[str, list[Array]] = {}
        for moment in self._control.periods(duration=REST):
            for name, values in self._values(moment.reading).items():
                samples.setdefault(name, []).append(values)
        rest = {name: np.mean(some, axis=0) for name, some in samples.items()}
        sensors = {name: self.driver.robot.patch(name).sensor for name in samples}
        noise = {
            name: np.maximum(
                6.0 * np.std(some, axis=0), LEAST * (sensors[name].highest - sensors[name].lowest)
            )
            for name, some in samples.items()
        }
        return rest, noise

    def _settle(self) -> None:
        """Reads frames for 0.1 s, because the first values of a touch do not yet show the place of the
        touch."""
        for _ in self._control.periods(duration=0.1):
            pass

    def _values(self, reading: Reading) -> dict[str, NDArray[np.float64]]:
        """Returns the raw values (taxels,) of each patch by patch name."""
        found = {}
        for frame in reading.skin:
            patch = self.driver.robot.patch(frame.patch)
            if frame.values.shape != (patch.channels,) or frame.values.dtype.kind not in "uif":
                raise FrameError(
                    f"{patch.name}: frame of {frame.values.dtype} {frame.values.shape}; "
                    f"valid: {patch.channels} numbers. Run tci doctor first"
                )
            values = np.nan_to_num(frame.values.astype(float))
            found[frame.patch] = values[self.skin.surfaces[frame.patch].channels]
        return found

    def _where(self, patch: Patch, taxel: int) -> str:
        """Describes the place of a taxel for the operator."""
        if self.driver.robot.limb_segment(patch) is None:
            normal = self.skin.normals(patch.name, self.driver.read().joints, frame="torso")[taxel]
            axis = int(np.argmax(np.abs(normal)))
            return f"{patch.link}, on the side that looks {_WAYS[axis][int(normal[axis] < 0.0)]}"
        u, theta, _ = self.skin.limb(patch.name, self.driver.read().joints)
        side = _SIDES[round(float(theta[taxel]) / (np.pi / 2.0)) % 4]
        return f"{patch.part}, {patch.segment}: {100 * u[taxel]:.0f} % of the way down, on its {side}"

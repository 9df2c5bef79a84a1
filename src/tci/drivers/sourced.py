"""A driver with sources beside it: `unitree:eth0 + inspire:192.168.11.210`."""

from __future__ import annotations

import inspect
import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.drivers.source import Source
from tci.drivers.source_fingers import SourceFingers, joints_of
from tci.drivers.source_reader import PadState, SourceReader
from tci.drivers.wrapper import DriverWrapper
from tci.errors import CommandError, DriverError, UnknownNameError
from tci.gate.partial_gate import PartialGate
from tci.gate.settings import GateSettings
from tci.messages import Reading, SkinFrame
from tci.robot.description import Patch, Robot
from tci.robot.kinematics import KinematicChain

FIRST = 1.0
"""Longest time [s] that a new connection waits for the first frame of every pad."""
SIDES = ("left", "right")
_log = logging.getLogger("tci")


@dataclass(frozen=True, slots=True)
class Address:
    """`NAME:ADDRESS,option=value`, taken apart."""

    name: str
    address: str
    side: str = ""
    """left or right; empty if the address does not say."""
    patch: str = ""
    """The patch of a source with one pad; empty if its pads have names."""
    options: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, via: str) -> Address:
        """Raises DriverError for an option without a value."""
        name, _, rest = via.partition(":")
        address, *texts = rest.split(",")
        options = {}
        for text in texts:
            key, equals, value = text.partition("=")
            if not (key and equals and value):
                raise DriverError(f"{via}: {text!r} is no option; valid: NAME:ADDRESS,option=value")
            options[key] = value
        side, patch = options.pop("side", ""), options.pop("patch", "")
        if side not in ("", *SIDES):
            raise DriverError(f"{via}: side={side}; valid: {', '.join(SIDES)}")
        return cls(name, address, side, patch, tuple(options.items()))

    def make(self, factory: type[Source]) -> Source:
        """Raises UnknownNameError for an option that the source lacks."""
        parameters = inspect.signature(factory).parameters.values()
        valid = [one.name for one in parameters if one.kind is one.KEYWORD_ONLY]
        for name, _ in self.options:
            if name not in valid:
                raise UnknownNameError(f"option of the source {self.name!r}", name, [*valid, "side", "patch"])
        side = {"side": self.side} if "side" in valid and self.side else {}
        return factory(self.address, **dict(self.options), **side)


def patches_of(robot: Robot, via: Address, source: Source) -> dict[str, Patch]:
    """The robot's patch of each pad of a source, by the pad's name; pads without a patch are left out.

    A pad `index_tip` is the patch of this name, or the one whose name ends in `_index_tip`; or the one whose
    address in the robot's binding to the source is `index_tip`. Raises DriverError if no pad has a patch, if
    several patches fit, or if one has another number of values.
    """
    if not source.pads:
        names = via.patch.split("/") if via.patch else [patch.name for patch in robot.skin]
        return {name: robot.patch(name) for name in names}
    if via.patch:
        if len(source.pads) > 1:
            raise DriverError(f"{via.name} has {len(source.pads)} pads; patch= is for a source with one")
        found = {next(iter(source.pads)): robot.patch(via.patch)}
    else:
        found = {pad: patch for pad in source.pads if (patch := _patch_of(robot, via, pad)) is not None}
    if not found:
        pads = ", ".join([*source.pads][:6])
        raise DriverError(
            f"{robot.name} has no patch for a pad of {via.name} ({pads}); valid: a robot whose patches are "
            "called so, such as g1-inspire for inspire, or one patch with patch=NAME"
        )
    for pad, patch in found.items():
        if patch.channels != source.pads[pad]:
            raise DriverError(
                f"{patch.name} has {patch.channels} channels, {pad} of {via.name} {source.pads[pad]} values; "
                "correct the description"
            )
    return found


def _patch_of(robot: Robot, via: Address, pad: str) -> Patch | None:
    bound = {
        binding.address(patch.name, ""): patch
        for binding in robot.bindings
        if binding.middleware == via.name
        for patch in robot.skin
    }
    if pad in bound:
        return bound[pad]
    fitting = [
        patch
        for patch in robot.skin
        if (patch.name == pad or patch.name.endswith(f"_{pad}"))
        and (not via.side or patch.name.startswith(f"{via.side}_"))
    ]
    if len(fitting) > 1:
        raise DriverError(
            f"{pad} of {via.name} may be {' or '.join(patch.name for patch in fitting)}; valid: "
            f"{via.name}:{via.address},side=left or ,side=right"
        )
    return fitting[0] if fitting else None


class SourcedDriver(DriverWrapper):
    """A driver, and sources whose pads replace its patches. The rest is the driver's."""

    def __init__(self, inner: Driver, sources: Sequence[tuple[str, Source]]) -> None:
        """Opens the sources; each comes with its address. Closing it also closes `inner`.

        Raises DriverError if a source can't be opened, or does not fit the robot, or for a recording.
        """
        if inner.info.recorded:
            raise DriverError(
                "a recording can't have a source beside it; valid: sim and drivers of real robots"
            )
        self._by_patch: dict[str, tuple[SourceReader, str]] = {}
        self.readers: tuple[SourceReader, ...] = ()
        """One for each source."""
        self._unused: dict[str, list[str]] = {}
        readers: list[SourceReader] = []
        try:
            for via, source in sources:
                found = patches_of(inner.robot, Address.of(via), source)
                for patch in found.values():
                    if patch.name in self._by_patch:
                        raise DriverError(f"{via}: {patch.name} already comes from another source")
                readers.append(SourceReader(via, source, {pad: one.channels for pad, one in found.items()}))
                self._by_patch |= {patch.name: (readers[-1], pad) for pad, patch in found.items()}
                self._unused[via] = [pad for pad in source.pads if pad not in found]
            for reader in readers:
                reader.wait(FIRST)
        except BaseException:
            for reader in readers:
                reader.close()
            raise
        self.readers = tuple(readers)
        self._fingers = [fingers for reader in readers if (fingers := self._fingers_of(inner, reader)).joints]
        changed = {"sources": {name: one.name for name, (one, _) in self._by_patch.items()}}
        super().__init__(inner, **changed, **self._only_read(inner))
        self._frames: dict[str, SkinFrame] = {}
        self._counts: dict[str, int] = {}

    def feed(self, patch: str, values: ArrayLike) -> None:
        """Gives the values of one patch from this program; the connection needs ` + array:feed`.

        Raises CommandError if no source takes values for this patch.
        """
        if patch not in self._by_patch:
            raise CommandError(f"no source for {patch!r}; valid: {', '.join(self._by_patch)}")
        reader, pad = self._by_patch[patch]
        reader.source.feed(pad, values)

    def diagnose(self) -> tuple[Finding, ...]:
        return (*self.inner.diagnose(), *(one for reader in self.readers for one in self._examine(reader)))

    def _examine(self, reader: SourceReader) -> Iterator[Finding]:
        yield from reader.diagnose()
        if unused := self._unused[reader.name]:
            said = f"{len(unused)} pads have no patch in the description: {', '.join(unused[:6])}"
            yield Finding(Level.NOTE, reader.name, said, "describe them, or leave them out")
        if angles := reader.track.latest:
            used = sum(len(one.joints) for one in self._fingers if one.reader is reader)
            said = f"measures {len(angles)} finger joints"
            if used:
                said += f", of which {used} place touches and can't be moved"
            elif self._unmeasured(self.inner):
                said += ", but neither the table of devices nor the description knows their angles"
            else:
                said += "; touches are placed with the robot's own angles"
            yield Finding(Level.NOTE, reader.name, said)
        if carried := self._on_fingers(reader):
            names = ", ".join(carried[:6])
            said = f"place assumed of {len(carried)} pads on fingers that nobody measures: {names}"
            simulated = "the simulation's fingers; hold the hand as these are"
            advice = f"their touches are placed with {simulated if self.info.harmless else 'open fingers'}"
            yield Finding(Level.NOTE, reader.name, said, advice)

    @staticmethod
    def _unmeasured(inner: Driver) -> set[int]:
        """Servos of real fingers whose angles the driver does not measure: a simulation has none of them."""
        if not inner.info.harmless:
            return {*inner.info.unmeasured}
        parts = [part for part in inner.robot.parts if part.kind == "fingers"]
        return {one.servo for part in parts for one in part.servos if one.servo is not None}

    def _fingers_of(self, inner: Driver, reader: SourceReader) -> SourceFingers:
        """Those joints of a source that the robot's driver does not measure."""
        via, pads = Address.of(reader.name), {}
        for name, (one, pad) in self._by_patch.items():
            if one is reader:
                pads[name] = pad
        source, open_to = reader.source, self._unmeasured(inner)
        sides = (one for one in SIDES if all(pad.startswith(f"{one}_") for pad in source.pads))
        found = joints_of(inner.robot, via.name, via.side or next(sides, ""), source.hand)
        return SourceFingers(
            inner.robot, reader, {servo: one for servo, one in found.items() if servo in open_to}, pads
        )

    def _only_read(self, inner: Driver) -> dict[str, Any]:
        """What differs in the facts about the driver if sources measure fingers of a simulation: these are
        those of a real hand, which nobody moves."""
        why = {
            servo: f"{one.reader.name} measures it, and is only read"
            for one in self._fingers
            for servo in one.joints
        }
        if not why or not inner.info.harmless:
            return {}
        gate = PartialGate(
            inner.robot, why, period=inner.period, stale_after=inner.gate.stale_after,
            streams=inner.info.streams, settings=GateSettings(), unwatched=why,
        )  # fmt: skip
        return {"gate": gate, "unreached": {**inner.info.unreached, **why}}

    def _on_fingers(self, reader: SourceReader) -> list[str]:
        """Patches of a source on links that fingers move, and that nobody measures."""
        robot = self.info.robot
        measured = {servo for one in self._fingers for servo in one.joints}
        fingers = self._unmeasured(self.inner) - measured
        if not fingers or robot.model is None:
            return []
        kinematics = KinematicChain(robot)
        return [
            name
            for name, (one, _) in self._by_patch.items()
            if one is reader and fingers & {*kinematics.chain(robot.patch(name).link)}
        ]

    def _receive(self) -> Reading:
        reading = self.inner.read()
        now, here = self.clock.now(), time.monotonic()
        frames = [frame for frame in reading.skin if frame.patch not in self._by_patch]
        for patch, (reader, pad) in self._by_patch.items():
            frame = self._frame(patch, reader.pads[pad], reader.silence(pad, here), now, here)
            if frame is not None:
                frames.append(frame)
        joints = reading.joints
        for fingers in self._fingers:
            joints = fingers.fill(joints)
        return Reading(joints, tuple(frames))

    def _frame(
        self, patch: str, state: PadState, silent: float | None, now: float, here: float
    ) -> SkinFrame | None:
        """The latest frame. A pad that went silent gets one frame without a value, so that nothing is felt
        there; one that was never heard gets the same."""
        before = self._frames.get(patch)
        if silent is not None:
            if before is not None and before.empty:
                return before
            values = np.full(state.channels, np.nan, np.float32)
            return self._keep(patch, now, values)
        if state.values is None or (before is not None and self._counts.get(patch) == state.sequence):
            return before
        self._counts[patch] = state.sequence
        stamp = now - max(0.0, here - state.stamp)
        return self._keep(patch, stamp, state.values)

    def _keep(self, patch: str, stamp: float, values: np.ndarray) -> SkinFrame:
        before = self._frames.get(patch)
        sequence = 1 if before is None else before.sequence + 1
        frame = self._frames[patch] = SkinFrame(patch, stamp, sequence, values)
        return frame

    def _close(self) -> None:
        for reader in self.readers:
            reader.close()
        self.inner.close()

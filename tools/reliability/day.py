"""A simulated day of imperfect skin with noise, drift and broken taxels. Counts false reflexes and missed
touches."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from pool import Result, gather
from row import Row

import tci
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.messages import JointReading, Reading, SkinFrame
from tci.messages.frames import read_only
from tci.robot.generic_arm import SEGMENTS
from tci.robot.joint_map import initial_position
from tci.simulation.imperfection import Imperfection, ImperfectTaxels

RATE = 50.0
"""Frame rate [Hz]."""
LEARN = 60.0
"""Time [s] in which conditioning estimates the noise. Nothing is counted during this time."""
DRIFT, DRIFT_PERIOD, SCATTER = 0.1, 7200.0, 0.02
"""Drift of all taxels: amplitude as a fraction of the range, period [s], and relative spread between
taxels."""
FAULTY = 600.0
"""Time [s] between the beginnings of two taxel faults. Each fault lasts half of this time."""
KINDS = ("stuck high", "stuck low", "not a number", "noisy", "stuck", "spikes")
SPIKES = 0.1
"""Fraction of frames in which a taxel with spikes shows its random value."""
PRESSED = 40.0
"""Deviation [counts] of each of the 12 taxels of a touch."""


@dataclass
class Hours:
    """Counts over a number of simulated hours."""

    hours: float
    false: int
    touches: int
    missed: int
    twice: int
    broken: int


class Day:
    """One skin patch of a NAO, with the withdrawal reflex."""

    def __init__(self, seed: int) -> None:
        self.robot = tci.load_robot("nao")
        self.random = np.random.default_rng(seed)
        patches = [patch for patch in self.robot.patches if patch.segment in SEGMENTS]
        self.patch = patches[int(self.random.integers(len(patches)))]
        self.body, self.reflex = GenericBody(self.robot), tci.WithdrawalReflex()
        self.perceiver, skin = Perceiver(self.body), self.body.skin
        self.channels = skin.surfaces[self.patch.name].channels
        count = len(self.channels)
        still = read_only(initial_position(self.robot))
        self.joints = JointReading(0.0, 0, still, read_only(np.zeros(len(still))))
        self.u, self.theta, _ = skin.limb(self.patch.name, self.joints)
        self.noise = self.random.uniform(0.5, 1.5, count)
        self.scatter = 1.0 + SCATTER * self.random.standard_normal(count)
        self.foam = ImperfectTaxels(skin.surfaces[self.patch.name], Imperfection.usual())
        self.memory = self.reflex.init(self.body)
        self.stuck = 0.0

    def touch(self) -> np.ndarray:
        """Returns the taxels (12,) that are nearest to a random place inside a receptive field, far from the
        field's border."""
        fields = [field for field in self.reflex.fields if field.segment == self.patch.segment]
        field = fields[int(self.random.integers(len(fields)))]
        u = field.u + self.random.uniform(-0.3, 0.3) * field.radius
        turn = np.abs((self.theta - field.theta + np.pi) % (2 * np.pi) - np.pi)
        return np.argsort(np.hypot(self.u - u, turn / np.pi))[:12]

    def live(self, hours: float, touches: int) -> Hours:
        """Simulates some hours with touches at random times, at least 3 s apart."""
        sensor, sign = self.patch.sensor, np.sign(self.patch.sensor.pascal_per_count)
        slot = (hours * 3600.0 - LEARN) / max(touches, 1)
        begins = LEARN + slot * np.arange(touches) + self.random.uniform(0.5, slot - 2.5, touches)
        result = Hours(hours, 0, touches, 0, 0, 0)
        answers: list[float] = []
        seen: set[float] = set()
        next_touch, chosen, broken, kind = 0, self.touch(), -1, ""
        raw = np.full(self.patch.channels, sensor.rest)
        for frame in range(int(hours * 3600.0 * RATE)):
            now = frame / RATE
            drift = DRIFT * (sensor.highest - sensor.lowest) * np.sin(2 * np.pi * now / DRIFT_PERIOD)
            pressed = np.zeros(len(self.channels))
            if next_touch < touches and now >= begins[next_touch]:
                pressed[chosen] = PRESSED
                if now >= begins[next_touch] + 0.5:
                    next_touch, chosen = next_touch + 1, self.touch()
            values = sensor.rest + sign * (drift * self.scatter + self.foam.signal(pressed, now))
            values += self.noise * self.random.standard_normal(len(self.channels))
            values = np.clip(np.rint(values), sensor.lowest, sensor.highest)
            if now % FAULTY < 1.0 / RATE:
                broken = int(self.random.integers(len(self.channels)))
                kind = KINDS[int(self.random.integers(len(KINDS)))]
                self.stuck = float(self.random.integers(int(sensor.lowest), int(sensor.highest) + 1))
                result.broken += 1
            if broken >= 0 and now > LEARN and now % FAULTY < FAULTY / 2.0:
                values[broken] = self._break(kind, values[broken])
            raw[self.channels] = values
            reading = Reading(self.joints, (SkinFrame(self.patch.name, now, frame, raw.copy()),))
            perceived = self.perceiver.step(reading, now)
            _, self.memory = self.reflex.step(self.memory, perceived, self.body)
            for withdrawal in self.memory.values():
                if withdrawal.started not in seen and now > LEARN:
                    seen = {withdrawal.started}
                    answers.append(withdrawal.started)
        got = np.array(answers)
        for begin in begins:
            here = int(np.count_nonzero((got >= begin) & (got <= begin + 0.52)))
            result.missed += here == 0
            result.twice += here > 1
        result.false = (
            len(got) - int(sum(np.any((got >= b) & (got <= b + 0.52)) for b in begins)) - result.twice
        )
        return result

    def _break(self, kind: str, value: float) -> float:
        sensor = self.patch.sensor
        pressed = sensor.lowest if sensor.pascal_per_count < 0.0 else sensor.highest
        match kind:
            case "stuck high":
                return float(pressed)
            case "stuck low":
                return float(sensor.rest)
            case "not a number":
                return float("nan")
            case "stuck":
                return self.stuck
            case "spikes":
                return self.stuck if self.random.random() < SPIKES else value
        return float(
            np.clip(round(value + 15.0 * self.random.standard_normal()), sensor.lowest, sensor.highest)
        )


def _live(seed: int, hours: float, touches: int) -> Result:
    return asdict(Day(seed).live(hours, touches))


def false_reflexes(full: bool) -> Row:
    """Simulates the hours. Every frame passes through conditioning, contact detection and reflex."""
    jobs, hours, touches = (96, 0.25, 105) if full else (1, 0.05, 20)
    work = [(seed, hours, touches) for seed in range(jobs)]
    done = gather("false_reflexes", _live, work, full=full)
    total = {
        key: sum(d[key] for d in done) for key in ("hours", "false", "touches", "missed", "twice", "broken")
    }
    return Row(
        "reflexes on a simulated skin with noise, drift and faulty single taxels",
        total["hours"],
        24.0,
        "hours",
        f"{total['false']} reflexes without a touch; {total['missed']} of {total['touches']} touches missed; "
        f"{total['twice']} touches answered twice; {total['broken']} taxels were broken",
        "0 reflexes without a touch, 0 of 10000 touches missed",
        total["false"] == total["missed"] == 0,
    )

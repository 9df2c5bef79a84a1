"""Benchmark from a raw frame of one patch to the gains of all fields: TCI's compiled loops, with warm caches,
are compared with C and with NumPy."""

from __future__ import annotations

import ctypes
import itertools
import subprocess
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from measured import Measured, cold, each, in_turn, row

import tci
from helpers import contact_oracle
from helpers.felt_skin import FeltSkin, PatchFelt
from tci.capabilities.answer import FIELD, field_table, find_answers
from tci.capabilities.discounts import phi, psi
from tci.capabilities.fields import default_fields
from tci.lab.authoring.dense_skin import with_dense_skin
from tci.messages import JointReading
from tci.messages.frames import frozen
from tci.robot.generic_arm import SEGMENTS
from tci.robot.joint_map import initial_position
from tci.robot.limb import generic_limb_distance
from tci.skin.contacts import ContactFinder, ContactSettings
from tci.skin.kernels.arrays import ActiveTaxels, ContactArrays
from tci.skin.kernels.condition import condition
from tci.skin.kernels.contacts import SUMMARY, cluster, describe
from tci.support.compiled import inlined, python_of

SETTINGS = ContactSettings()
LIMITS, THRESHOLD = SETTINGS.limits, 7.0
"""Thresholds of a taxel: contact forces [N], and deviation from the rest value [counts]."""
_condition, _cluster, _describe, _answer = [
    inlined(python_of[loop]) for loop in (condition, cluster, describe, find_answers)
]
"""Inlines the loops of TCI into one loop. Another row of the benchmark shows the cost of separate calls."""
HERE = Path(__file__).parent
PITCH = 0.012
"""Distance [m] between taxels. Each taxel has six neighbours. The area of the skin follows from the number of
taxels."""


@inlined
def respond(
    repeats, values, last, which, stamps, layout, estimates, memory, active, clusters, poses, posture,
    summary, made, segments, fields, closest, one, gains,
):  # fmt: skip
    count = 0
    for again in range(repeats):
        gains[:] = 0.0
        _condition(values[again & 1], last, which, stamps, 0.0, layout, estimates, memory, active)
        count, _, _ = _cluster(active, LIMITS, estimates.onset, layout, clusters)
        if count == 0:
            continue
        _describe(layout, estimates.hidden, clusters, poses, posture, summary, made)
        _answer(
            fields, False, segments, made.rows[:count], made.begin, made.taxels, closest, one
        )  # fmt: skip
        for c in range(count):
            if closest[c] >= 0:
                gains[closest[c]] = max(gains[closest[c]], one[c])
    return count


class Frame:
    """One patch with a given number of taxels, fields and contacts."""

    def __init__(self, taxels: int, fields: int, contacts: int) -> None:
        nao = tci.load_robot("nao")
        one = nao.model_copy(update={"patches": (nao.patch("left_forearm"),)})
        robot = with_dense_skin(one, taxels, patches=1, pitch=PITCH if taxels > 1000 else 0.004)
        self.skin = FeltSkin(robot)
        (self.patch,) = robot.patches
        self.layout, conditioner = self.skin.layout, self.skin.conditioner
        arrays = self.layout.arrays
        self.surface = self.skin.surfaces[self.patch.name]
        n = len(arrays.taxels)
        self.n, random = n, np.random.default_rng(0)
        base = default_fields(measure="weighted")
        self.fields = tuple(
            base[i % 5].model_copy(
                update={
                    "name": f"field_{i}", "u": random.random(), "theta": random.uniform(-np.pi, np.pi),
                    "segment": "forearm",
                }
            )
            for i in range(fields)
        )  # fmt: skip
        self.rest = np.full(self.patch.channels, self.patch.sensor.rest, np.uint8)
        self.touched = self.rest.copy()
        pitch = float(np.sqrt(arrays.taxels["area"].mean()))
        for i in range(contacts):
            at = self.surface.positions[int((i + 0.5) * n / contacts)]
            near = np.linalg.norm(self.surface.positions - at, axis=1) < 1.6 * pitch
            self.touched[self.surface.channels[near]] = 120
        self.values = np.zeros((2, self.patch.channels), np.uint8)
        self.position = position = np.array(initial_position(robot))
        self.poses = self.skin.kinematics.poses(position, self.layout.links)
        self.posture = np.array(robot.part(self.patch.part).initial_posture)
        conditioner.estimates.threshold[:] = THRESHOLD
        self.table, self.gains = field_table(self.fields), np.zeros(fields)
        poses = np.array([self.poses[link] for link in self.layout.links])
        finder = ContactFinder(self.layout)
        self._condition = (
            conditioner._buffer.last, np.zeros(1, np.int64), np.full(1, np.nan), 0.0, arrays,
            conditioner.estimates, conditioner._memory, conditioner._out,
        )  # fmt: skip
        self._clusters, self._posture = finder._clusters, (poses, self.posture[None, :4].copy())
        self._segments = np.full(n, SEGMENTS.index("forearm"))
        self._room = np.zeros(n, np.int64), np.zeros(n)
        self._arguments = (
            *self._condition[:3], *self._condition[4:], self._clusters, *self._posture,
            np.zeros(n, SUMMARY), ContactArrays.empty(n, n), self._segments, self.table, *self._room,
            self.gains,
        )  # fmt: skip
        self.show(self.touched)

    def show(self, values: np.ndarray, *, flicker: bool = False) -> None:
        """Sets two frames that alternate. In the second frame the touched taxels differ by one count; with
        `flicker`, most taxels differ."""
        random = np.random.default_rng(1)
        noise = random.integers(-1, 2, (2, len(values))) if flicker else np.zeros((2, len(values)), int)
        self.values[:] = values + noise
        self.values[1] -= values < 200
        self._turns = itertools.cycle(self.values.copy())

    def ours(self, repeats: int = 1) -> int:
        """Processes `repeats` frames with TCI in one loop."""
        return respond(repeats, self.values, *self._arguments)

    def called(self) -> None:
        """Processes the next frame with the loops of TCI, each called from Python."""
        condition(next(self._turns), *self._condition)
        arrays, active = self.layout.arrays, self._condition[-1]
        state = ActiveTaxels(*(frozen(array[:]) for array in active))
        count, taxels, _ = cluster(state, LIMITS, self._condition[5].onset, arrays, self._clusters)
        if count == 0:
            return
        made = ContactArrays.empty(count, taxels)
        hidden = self._condition[5].hidden
        describe(arrays, hidden, self._clusters, *self._posture, np.empty(count, SUMMARY), made)
        closest, gains = np.empty(count, np.int64), np.empty(count)
        find_answers(self.table, False, self._segments, *map(frozen, made), closest, gains)

    def numpy(self) -> np.ndarray:
        """Processes the frame with the tests' reference implementation: contacts are objects, and NumPy
        computes the gains."""
        sensor = self.patch.sensor
        counts = sensor.rest - self.values[0, self.surface.channels].astype(float)
        areas = self.surface.areas
        force = np.where(counts >= THRESHOLD, counts, 0.0) * abs(sensor.pascal_per_count) * areas
        felt = PatchFelt(0.0, 0, force / areas, force, np.zeros(len(force), bool), None)
        joints = JointReading(0.0, 0, self.position, self.position)
        posture = {self.patch.part: self.posture}
        gains = np.zeros(len(self.fields))
        for contact in contact_oracle.contacts(self.skin, {self.patch.name: felt}, joints, posture, SETTINGS):
            apart = np.array(
                [generic_limb_distance(contact.u, contact.theta, f.u, f.theta) for f in self.fields]
            )
            best = int(apart.argmin())
            field = self.fields[best]
            if apart[best] < field.radius:
                far = generic_limb_distance(contact.taxel_u, contact.taxel_theta, contact.u, contact.theta)
                weights = np.maximum(2 * field.radius - far, 0.0)
                felt = float(weights @ contact.taxel_forces / weights.sum()) if weights.sum() else 0.0
                gain = phi(felt, field.threshold, field.saturation) * psi(float(apart[best]), field.radius)
                gains[best] = max(gains[best], gain)
        return gains


class InC:
    """Implementation of the same loops in C, which this module compiles."""

    def __init__(self, frame: Frame) -> None:
        self._folder = tempfile.TemporaryDirectory()
        library = Path(self._folder.name) / "response.so"
        subprocess.run(
            [
                "cc", "-O3", "-march=native", "-fno-trapping-math", "-fno-math-errno", "-shared", "-fPIC",
                str(HERE / "response.c"), "-o", str(library), "-lm",
            ],
            check=True,
        )  # fmt: skip
        self._function = ctypes.CDLL(str(library)).respond
        self._function.restype = ctypes.c_int64
        f, n, arrays = frame, frame.n, frame.layout.arrays
        estimates = frame.skin.conditioner.estimates
        (patch,) = arrays.patches
        own, limb = f.poses[f.patch.link], f.layout.links[patch["limb_link"]]
        blocks = -(-n // 64)
        sensor = np.array([patch[name] for name in ("lowest", "highest", "rest", "sign", "full")], np.float32)
        turn = 255 if patch["sign"] < 0.0 else 0
        # `turn` inverts the bytes of sensors whose values fall with pressure, so that signals rise.
        signals = patch["sign"] * ((np.arange(256) ^ turn) - patch["rest"])
        octets, words = np.zeros((7, 64 * blocks), np.uint8), np.zeros((2, 64 * blocks), np.uint16)
        octets[3], octets[6] = 255, np.count_nonzero(signals < THRESHOLD) - 1
        straight = int((np.diff(arrays.channel) == 1).all())
        box = np.array([*patch["corner"], patch["cells_per_metre"], *patch["cells"]])
        members = [
            ("n", n), ("fields_n", len(f.fields)), ("repeats", 1), ("stride", f.values.shape[1]),
            ("padded", octets.shape[1]), ("straight", straight), ("frames", 0),
            ("since", 0), ("turn", turn), ("end", int(np.count_nonzero(signals < patch["full"])) - 1),
            ("felt", 0), ("values", f.values), ("channels", arrays.channel), ("sensor", sensor),
            ("offset", estimates.offset), ("gain", arrays.gain),
            ("area", np.ascontiguousarray(arrays.taxels["area"])),
            ("memory", np.zeros(7 * n, np.float32)), ("octets", octets),
            ("words", words), ("blocks", np.zeros((4, blocks), np.int32)), ("active", np.zeros(n, np.int32)),
            ("force", np.zeros(n)), ("floor", SETTINGS.floor),
            ("touch", SETTINGS.touch), ("graph", arrays.graph), ("work", np.zeros(4 * n + 1, np.int32)),
            ("taxels", arrays.taxels), ("faces", arrays.faces), ("box", box), ("cells", arrays.cells),
            ("T_TL", own), ("T_TG", f.poses[limb]), ("limb", np.array([patch["limb"]]).view(np.float64)),
            ("posture", f.posture), ("numbers", np.zeros((n, 7))), ("vectors", np.zeros((n, 5, 3))),
            ("indices", np.zeros(n, np.int64)), ("places", np.zeros((4, n))),
            ("fields", np.array([f.table[name] for name in FIELD.names or ()], np.float64)),
            ("gains", np.zeros(len(f.fields))),
        ]  # fmt: skip
        kinds: dict[type, Any] = {int: ctypes.c_int64, float: ctypes.c_double}
        self._kept = dict(members)
        layout = [(name, kinds.get(type(value), ctypes.c_void_p)) for name, value in members]
        self._struct = type("Frame", (ctypes.Structure,), {"_fields_": layout})()
        for name, value in members:
            setattr(self._struct, name, value.ctypes.data if isinstance(value, np.ndarray) else value)
        self.gains = self._kept["gains"]
        self._rows = itertools.cycle((0, 1))

    def __call__(self, repeats: int = 1) -> int:
        self._struct.repeats = repeats
        row = next(self._rows) if repeats == 1 else 0
        self._struct.values = self._kept["values"][row:].ctypes.data
        return int(self._function(ctypes.byref(self._struct)))


def kernel(
    taxels: int, fields: int, contacts: int, *, most: float | None, idle_most: float | None = None
) -> list[Measured]:
    frame = Frame(taxels, fields, contacts)
    peer = InC(frame)
    found, theirs = frame.ours(2), peer(2)
    assert found == theirs, (found, theirs)
    # If two points of a skin are equally close to a contact's mean, rounding determines which point is
    # chosen.
    np.testing.assert_allclose(frame.gains, peer.gains, atol=2e-3)
    small = taxels <= 4000
    if small:
        np.testing.assert_allclose(frame.gains, frame.numpy(), atol=2e-3)
    repeats = max(2, min(200, 200_000 // taxels))
    most_ratio = 1.5 if taxels >= 230 else None
    name = f"kernel, {frame.n} taxels, {fields} fields, {found} contact{'s' * (found != 1)}"
    rows = []
    for what, values, flicker, limit in (
        ("data in caches", frame.touched, False, most),
        ("every taxel fluctuates", frame.touched, True, None),
        ("no touch", frame.rest, False, idle_most),
    ):
        frame.show(values, flicker=flicker)
        for _ in range(4):
            frame.called(), frame.ours(2), peer()
        label = f"kernel, {frame.n} taxels, no touch" if what == "no touch" else f"{name}, {what}"
        pairs = _inner(frame, peer, taxels, repeats)
        rows.append(row(label, "C program", pairs, most_ratio=most_ratio))
        if flicker:
            continue
        colds = cold(frame.called), cold(peer)
        label = label.removesuffix(", data in caches") + ", loops called from Python"
        rows.append(
            row(label, "C program called by ctypes", in_turn(frame.called, peer), most=limit, colds=colds)
        )
        if small and what == "data in caches":
            rows.append(
                row(
                    f"{name}, loops called from Python",
                    "NumPy version in the tests",
                    in_turn(frame.called, frame.numpy),
                )
            )
    return rows


def _inner(frame: Frame, peer: InC, taxels: int, repeats: int) -> list[tuple[float, float]]:
    """Returns the times [us] of one frame for TCI and for C, measured inside the loops without the cost of a
    call."""
    pairs = []
    for _ in range(7):
        calls = max(3, 4_000_000 // taxels // repeats)
        one, other = (each(partial(work, repeats), calls=calls) / repeats for work in (frame.ours, peer))
        pairs.append((one, other))
    return pairs


kernel_230 = partial(kernel, 230, 5, 1, most=4.0)
kernel_4000 = partial(kernel, 4000, 16, 30, most=25.0, idle_most=5.0)
kernel_100000 = partial(kernel, 100_000, 64, 30, most=None)
kernel_1000000 = partial(kernel, 1_000_000, 64, 30, most=1000.0)

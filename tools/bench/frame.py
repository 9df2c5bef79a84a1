"""Raw frame of one patch to the gains of all fields: the compiled loops of TCI, hot, beside C and NumPy."""

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
from skin.kernels import contact_oracle
from tci.authoring.dense_skin import with_dense_skin
from tci.capabilities.answer import field_table, find_answers
from tci.capabilities.discounts import phi, psi
from tci.capabilities.fields import default_fields
from tci.compiled import inlined
from tci.messages import PatchState, SkinState
from tci.robot.joint_map import initial_position
from tci.robot.limb import generic_limb_distance
from tci.skin.contacts import ContactSettings
from tci.skin.kernels.condition import empty_memory
from tci.skin.kernels.contacts import NUMBERS, VECTORS
from tci.skin.kernels.octet_counts import END, STRAIGHT, TURN
from tci.skin.kernels.octets import feel
from tci.skin.kernels.whole import cluster_all, describe_all
from tci.skin.live_skin import LiveSkin

SETTINGS = ContactSettings()
_feel, _cluster, _describe, _answer = [
    inlined(loop.py_func) for loop in (feel, cluster_all, describe_all, find_answers)
]
"""The loops that are shipped, within one: what a call costs is a row of its own."""
HERE = Path(__file__).parent
PITCH = 0.012
"""Distance [m] of taxels: six neighbours each, on a skin as large as it needs to be."""


@inlined
def respond(
    repeats, values, which, stamps, table, sensor, offset, memory, octets, words, blocks, state, channels,
    gain, nodes, area, force, active, pressed, actives, felt, pressure, ends, floor, touch, graph, begins,
    work, found, taxels, faces, box, cells, limb, poses, posture, on, numbers, vectors, indices, places,
    rows, segments, fields, squares, closest, one, gains,
):  # fmt: skip
    count = 0
    for again in range(repeats):
        gains[:] = 0.0
        _feel(
            values[again & 1], which, stamps, 1.0, table, sensor, offset, memory, octets, words, blocks,
            state, channels, gain, nodes, area, force, active, pressed, actives, felt, pressure, ends,
        )  # fmt: skip
        count, k, _ = _cluster(force, floor, touch, active, actives, graph, begins, work, found)
        if count == 0:
            continue
        own, order = places[: 4 * k].reshape(4, k), rows[: 3 * (count + 1)].reshape(3, count + 1)
        _describe(
            force, work, begins, found, taxels, faces, box, cells, limb, poses, posture, on, numbers, vectors,
            indices, own, order,
        )  # fmt: skip
        _answer(
            fields, False, segments, order[1, :count], order[0], numbers[:count], own, squares, closest, one
        )
        for c in range(count):
            if closest[c] >= 0:
                gains[closest[c]] = max(gains[closest[c]], one[c])
    return count


class Frame:
    """One patch with so many taxels, fields and contacts."""

    def __init__(self, taxels: int, fields: int, contacts: int) -> None:
        nao = tci.load_robot("nao")
        one = nao.model_copy(update={"patches": (nao.patch("left_forearm"),)})
        robot = with_dense_skin(one, taxels, patches=1, pitch=PITCH if taxels > 1000 else 0.004)
        self.skin = LiveSkin(robot)
        (self.patch,) = robot.patches
        self.octets, self.flat = self.skin.octets, self.skin.flat_skin()
        self.surface = self.skin.surfaces[self.patch.name]
        n = len(self.flat.taxels)
        self.n, random = n, np.random.default_rng(0)
        base = default_fields()
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
        pitch = float(np.sqrt(self.flat.taxels[:, 6].mean()))
        for i in range(contacts):
            at = self.surface.positions[int((i + 0.5) * n / contacts)]
            near = np.linalg.norm(self.surface.positions - at, axis=1) < 1.6 * pitch
            self.touched[self.surface.channels[near]] = 120
        self.values = np.zeros((2, self.patch.channels), np.uint8)
        position = np.array(initial_position(robot))
        self.poses = self.skin.kinematics.poses(position, self.flat.links)
        self.posture = np.array(robot.part(self.patch.part).initial_posture)
        self.octets.conditioners[0].threshold[:] = 7.0
        self.octets.limit(0)
        self.table, self.gains = field_table(self.fields), np.zeros(fields)
        octets, flat = self.octets, self.flat
        poses = np.array([self.poses[link] for link in flat.links])
        self._feel = (
            np.zeros(1, np.int64), np.full(1, np.nan), 1.0, *octets.tables, octets.force, octets.active,
            np.zeros(n), octets.counts, np.zeros(n, np.int32), np.zeros(n), np.zeros(2, np.int64),
        )  # fmt: skip
        self._cluster = (
            octets.force, SETTINGS.floor, SETTINGS.touch, octets.active, octets.counts, flat.graph,
            flat.begins, flat.work, flat.counts,
        )  # fmt: skip
        self._describe = (
            octets.force, flat.work, flat.begins, flat.counts, flat.taxels, flat.faces, flat.box, flat.cells,
            flat.limb, poses, self.posture[None, :4].copy(), flat.on,
        )  # fmt: skip
        self._answer = np.zeros(fields), np.zeros(n, np.int64), np.zeros(n)
        room = (
            np.zeros((n, NUMBERS)), np.zeros((n, VECTORS, 3)), np.zeros(n, np.int64), np.zeros(4 * n),
            np.zeros(3 * n + 3, np.int64),
        )  # fmt: skip
        self._arguments = (
            *self._feel[:2], *self._feel[3:], *self._cluster[1:3], *self._cluster[5:], *self._describe[4:],
            *room, flat.segments, self.table, *self._answer, self.gains,
        )  # fmt: skip
        self.show(self.touched)

    def show(self, values: np.ndarray, *, flicker: bool = False) -> None:
        """Two frames that take turns: what is touched differs by one count, with `flicker` most taxels."""
        random = np.random.default_rng(1)
        noise = random.integers(-1, 2, (2, len(values))) if flicker else np.zeros((2, len(values)), int)
        self.values[:] = values + noise
        self.values[1] -= values < 200
        self._turns = itertools.cycle(self.values.copy())

    def ours(self, repeats: int = 1) -> int:
        """One loop over so many frames."""
        return respond(repeats, self.values, *self._arguments)

    def called(self) -> None:
        """The next frame through the loops as they are shipped, each called from Python."""
        feel(next(self._turns), *self._feel)
        count, taxels, _ = cluster_all(*self._cluster)
        if count == 0:
            return
        numbers, vectors = np.empty((count, NUMBERS)), np.empty((count, VECTORS, 3))
        indices, places = np.empty(taxels, np.intp), np.empty((4, taxels))
        rows, closest, gains = np.empty((3, count + 1), np.int64), np.empty(count, np.int64), np.empty(count)
        describe_all(*self._describe, numbers, vectors, indices, places, rows)
        find_answers(
            self.table, False, self.flat.segments, rows[1, :count], rows[0], numbers, places,
            self._answer[0], closest, gains,
        )  # fmt: skip

    def numpy(self) -> np.ndarray:
        """The oracle of the tests: contacts as objects, gains by NumPy."""
        sensor = self.patch.sensor
        counts = sensor.rest - self.values[0, self.surface.channels].astype(float)
        areas = self.surface.areas
        force = np.where(counts >= 7.0, counts, 0.0) * abs(sensor.pascal_per_count) * areas
        name = self.patch.name
        state = SkinState({name: PatchState(name, 0.0, 0, force, force)}, self.poses)
        gains = np.zeros(len(self.fields))
        for contact in contact_oracle.contacts(self.skin, state, {self.patch.part: self.posture}, SETTINGS):
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
    """The same in C, compiled here."""

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
        f, flat, n = frame, frame.flat, frame.n
        link = f.skin.flat(f.patch.name).link
        table, sensor, offset, _, octets, words, blocks, _, channels, gain, _, area = f.octets.tables
        octets, words, blocks = octets.copy(), words.copy(), blocks.copy()
        members = [
            ("n", n), ("fields_n", len(f.fields)), ("repeats", 1), ("stride", f.values.shape[1]),
            ("padded", octets.shape[1]), ("straight", int(table[0, STRAIGHT])), ("frames", 0), ("since", 0),
            ("turn", int(table[0, TURN])), ("end", int(table[0, END])), ("felt", 0),
            ("values", f.values), ("channels", channels), ("sensor", sensor), ("offset", offset),
            ("gain", gain), ("area", area), ("memory", empty_memory(n)), ("octets", octets),
            ("words", words), ("blocks", blocks), ("active", np.zeros(n, np.int32)),
            ("force", np.zeros(n)), ("floor", SETTINGS.floor),
            ("touch", SETTINGS.touch), ("graph", flat.graph), ("work", np.zeros(4 * n + 1, np.int32)),
            ("taxels", flat.taxels), ("faces", flat.faces), ("box", flat.box), ("cells", flat.cells),
            ("T_TL", f.poses[f.patch.link]), ("T_TG", f.poses[link]), ("limb", flat.limb),
            ("posture", f.posture), ("numbers", np.zeros((n, NUMBERS))),
            ("vectors", np.zeros((n, VECTORS, 3))),
            ("indices", np.zeros(n, np.int64)), ("places", np.zeros((4, n))), ("fields", f.table),
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
    # Two points of a skin may be equally near to a contact's mean: rounding decides.
    np.testing.assert_allclose(frame.gains, peer.gains, atol=2e-3)
    small = taxels <= 4000
    if small:
        np.testing.assert_allclose(frame.gains, frame.numpy(), atol=2e-3)
    repeats = max(2, min(200, 200_000 // taxels))
    most_ratio = 1.5 if taxels >= 230 else None
    name = f"kernel, {frame.n} taxels, {fields} fields, {found} contacts"
    rows = []
    for what, values, flicker, limit in (
        ("hot", frame.touched, False, most),
        ("every taxel flickers", frame.touched, True, None),
        ("idle", frame.rest, False, idle_most),
    ):
        frame.show(values, flicker=flicker)
        for _ in range(4):
            frame.called(), frame.ours(2), peer()
        label = f"kernel, {frame.n} taxels, idle" if what == "idle" else f"{name}, {what}"
        pairs = _inner(frame, peer, taxels, repeats)
        rows.append(row(label, "C -O3", pairs, most_ratio=most_ratio))
        if flicker:
            continue
        colds = cold(frame.called), cold(peer)
        label = label.removesuffix(", hot") + ", loops called from Python"
        rows.append(row(label, "C called by ctypes", in_turn(frame.called, peer), most=limit, colds=colds))
        if small and what == "hot":
            rows.append(
                row(
                    f"{name}, loops called from Python",
                    "the tests' NumPy",
                    in_turn(frame.called, frame.numpy),
                )
            )
    return rows


def _inner(frame: Frame, peer: InC, taxels: int, repeats: int) -> list[tuple[float, float]]:
    """Microseconds of one frame inside the compiled loops: what a call costs is left out on both sides."""
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

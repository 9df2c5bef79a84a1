"""Raw frame of one patch to the gains of all fields: the compiled loops of TCI, hot, beside C and NumPy."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from measured import Measured, cold, each, in_turn, row
from numba import njit

import tci
from interface.kernels import contact_oracle
from tci.capabilities.answer import field_table, find_answer
from tci.capabilities.discounts import phi, psi
from tci.capabilities.fields import default_fields
from tci.interface.contacts import ContactSettings
from tci.interface.generic_limb import generic_limb_distance
from tci.interface.kernels.condition import condition, empty_memory
from tci.interface.kernels.contacts import NUMBERS, VECTORS, cluster, describe
from tci.interface.skin import Skin
from tci.messages import PatchState, SkinState
from tci.model.dense_skin import with_dense_skin

SETTINGS = ContactSettings()
HERE = Path(__file__).parent
PITCH = 0.012
"""Distance [m] of taxels: six neighbours each, on a skin as large as it needs to be."""


@njit(error_model="numpy")
def respond(
    repeats, values, channels, sensor, offset, threshold, silent, gain, nodes, memory, active, before, force,
    floor, touch, graph, work, taxels, faces, box, cells, T_TL, T_TG, limb, posture, fields, gains,
):  # fmt: skip
    count, n = 0, len(force)
    for _ in range(repeats):
        force[:] = 0.0
        gains[:] = 0.0
        condition(
            values,
            channels,
            sensor,
            offset,
            threshold,
            silent,
            gain,
            nodes,
            memory,
            active,
            2,
            1.0,
            before,
            force,
        )
        count = cluster(force, floor, touch, graph, work)
        if count == 0:
            continue
        bounds = work[n : 2 * n + 1]
        numbers, vectors = np.empty((count, NUMBERS)), np.empty((count, VECTORS, 3))
        indices, places = np.empty(bounds[count], np.int64), np.empty((3, bounds[count]))
        describe(
            force,
            work,
            taxels,
            faces,
            box,
            cells,
            T_TL,
            T_TG,
            limb,
            posture,
            numbers,
            vectors,
            indices,
            places,
        )
        for c in range(count):
            begin, end = bounds[c], bounds[c + 1]
            closest, one = find_answer(
                fields, False, int(limb[14]), numbers[c, 3], numbers[c, 4], numbers[c, 0], numbers[c, 1],
                places[1, begin:end], places[2, begin:end], places[0, begin:end],
            )  # fmt: skip
            if closest >= 0:
                gains[closest] = max(gains[closest], one)
    return count


class Frame:
    """One patch with so many taxels, fields and contacts."""

    def __init__(self, taxels: int, fields: int, contacts: int) -> None:
        nao = tci.load_robot("nao")
        one = nao.model_copy(update={"patches": (nao.patch("left_forearm"),)})
        robot = with_dense_skin(one, taxels, patches=1, pitch=PITCH if taxels > 1000 else 0.004)
        self.skin = Skin(robot)
        (self.patch,) = robot.patches
        self.flat = self.skin.flat(self.patch.name)
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
        sensor = self.patch.sensor
        self.values = np.full(self.patch.channels, sensor.rest, np.uint8)
        pitch = float(np.sqrt(self.flat.taxels[:, 6].mean()))
        for i in range(contacts):
            at = self.surface.positions[int((i + 0.5) * n / contacts)]
            near = np.linalg.norm(self.surface.positions - at, axis=1) < 1.6 * pitch
            self.values[self.surface.channels[near]] = 120
        position = np.array(robot.initial_position)
        self.poses = self.skin.kinematics.poses(position, [self.patch.link, self.flat.link])
        self.posture = np.array(robot.part(self.patch.part).initial_posture)
        full = np.float32(sensor.rest)
        self.sensor = np.array([0, 255, sensor.rest, -1, full], np.float32)
        self.gain = abs(sensor.pascal_per_count) * self.flat.taxels[:, 6]
        self.offset, self.threshold = np.zeros(n, np.float32), np.full(n, 7.0, np.float32)
        self.silent, self.active = np.zeros(n, bool), np.zeros(n, np.uint8)
        self.memory, self.force = empty_memory(n), np.zeros(n)
        self.table, self.gains = field_table(self.fields), np.zeros(fields)
        self.channels = np.ascontiguousarray(self.surface.channels)

    def ours(self, repeats: int = 1) -> int:
        flat, none = self.flat, np.zeros(0)
        return respond(  # type: ignore[no-any-return]
            repeats, self.values, self.channels, self.sensor, self.offset, self.threshold, self.silent,
            self.gain, np.zeros((2, 0)), self.memory, self.active, none, self.force, SETTINGS.floor,
            SETTINGS.touch, flat.graph, flat.work, flat.taxels, flat.faces, flat.box, flat.cells,
            self.poses[self.patch.link], self.poses[flat.link], flat.limb, self.posture, self.table,
            self.gains,
        )  # fmt: skip

    def numpy(self) -> np.ndarray:
        """The oracle of the tests: contacts as objects, gains by NumPy."""
        counts = self.sensor[2] - self.values[self.channels].astype(float)
        force = np.where(counts >= self.threshold, counts, 0.0) * self.gain
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
        members = [
            ("n", n), ("fields_n", len(f.fields)), ("repeats", 1), ("values", f.values),
            ("channels", f.channels), ("sensor", f.sensor), ("offset", f.offset), ("threshold", f.threshold),
            ("silent", f.silent), ("gain", f.gain), ("memory", empty_memory(n)),
            ("active", np.zeros(n, np.uint8)), ("force", np.zeros(n)), ("floor", SETTINGS.floor),
            ("touch", SETTINGS.touch), ("graph", flat.graph), ("work", np.zeros(4 * n + 1, np.int32)),
            ("taxels", flat.taxels), ("faces", flat.faces), ("box", flat.box), ("cells", flat.cells),
            ("T_TL", f.poses[f.patch.link]), ("T_TG", f.poses[flat.link]), ("limb", flat.limb),
            ("posture", f.posture), ("numbers", np.zeros((n, NUMBERS))),
            ("vectors", np.zeros((n, VECTORS, 3))),
            ("indices", np.zeros(n, np.int64)), ("places", np.zeros((3, n))), ("fields", f.table),
            ("gains", np.zeros(len(f.fields))), ("stride", 0),
        ]  # fmt: skip
        kinds: dict[type, Any] = {int: ctypes.c_int64, float: ctypes.c_double}
        self._kept = dict(members)
        layout = [(name, kinds.get(type(value), ctypes.c_void_p)) for name, value in members]
        self._struct = type("Frame", (ctypes.Structure,), {"_fields_": layout})()
        for name, value in members:
            setattr(self._struct, name, value.ctypes.data if isinstance(value, np.ndarray) else value)
        self.gains = self._kept["gains"]

    def __call__(self, repeats: int = 1) -> int:
        self._struct.repeats = repeats
        return int(self._function(ctypes.byref(self._struct)))


def kernel(
    taxels: int, fields: int, contacts: int, *, most: float | None, idle_most: float | None = None
) -> list[Measured]:
    frame = Frame(taxels, fields, contacts)
    peer = InC(frame)
    found, theirs = frame.ours(), peer()
    assert found == theirs, (found, theirs)
    # Two points of a skin may be equally near to a contact's mean: rounding decides.
    np.testing.assert_allclose(frame.gains, peer.gains, atol=2e-3)
    small = taxels <= 4000
    if small:
        np.testing.assert_allclose(frame.gains, frame.numpy(), atol=2e-3)
    repeats = max(1, min(100, 100_000 // taxels))
    name = f"kernel, {frame.n} taxels, {fields} fields, {found} contacts"
    pairs = _inner(frame, peer, taxels, repeats)
    call, late = each(frame.ours, calls=max(3, 10 * repeats)), cold(frame.ours)
    note = f"one call from Python {call:.1f} us, after 1 ms of sleep {late:.1f} us"
    rows = [
        row(f"{name}, hot", "C -O3", pairs, most=most, most_ratio=1.5 if taxels >= 230 else None,
            note=note)
    ]  # fmt: skip
    if small:
        rows.append(row(name, "the tests' NumPy", in_turn(frame.ours, frame.numpy)))
    frame.values[:] = 240
    frame.ours()
    peer()
    rows.append(
        row(f"kernel, {frame.n} taxels, idle", "C -O3", _inner(frame, peer, taxels, repeats), most=idle_most,
            most_ratio=1.5 if taxels >= 230 else None)
    )  # fmt: skip
    return rows


def _inner(frame: Frame, peer: InC, taxels: int, repeats: int) -> list[tuple[float, float]]:
    """Microseconds of one frame inside the compiled loops: what a call costs is left out on both sides."""
    pairs = []
    for _ in range(7):
        calls = max(3, 4_000_000 // taxels // repeats)
        one, other = (each(partial(work, repeats), calls=calls) / repeats for work in (frame.ours, peer))
        pairs.append((one, other))
    return pairs


kernel_30 = partial(kernel, 30, 5, 1, most=None)
kernel_230 = partial(kernel, 230, 5, 1, most=4.0)
kernel_768 = partial(kernel, 768, 5, 5, most=None)
kernel_4000 = partial(kernel, 4000, 16, 30, most=25.0, idle_most=5.0)
kernel_10000 = partial(kernel, 10_000, 64, 30, most=None)
kernel_100000 = partial(kernel, 100_000, 64, 30, most=None)
kernel_1000000 = partial(kernel, 1_000_000, 64, 30, most=1000.0)

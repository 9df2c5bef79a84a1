"""Contacts of many worlds on a device of Warp, and what the host reads of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from tci.batch import clusters, measured
from tci.batch.feel import structs
from tci.batch.posture import LimbTables
from tci.batch.scene import BatchScene
from tci.errors import TciError
from tci.messages.contacts import CONTACT, TAXEL
from tci.messages.frames import Array
from tci.simulation.sampling import AREA
from tci.skin.formulas import on_limb
from tci.skin.kernels.arrays import ContactArrays


class Touches:
    """Finds the contacts of all worlds, from the forces on their taxels. Create it within
    `wp.ScopedDevice`.

    Raises TciError for a limb whose angles follow tables, and for taxels that share a channel.
    """

    def __init__(self, scene: BatchScene, count: int) -> None:
        layout, world, estimates = scene.body.layout.arrays, scene.world, scene.estimates
        rows, channels, nodes = world.taxels.arrays[3], world.taxels.arrays[6], layout.nodes
        limbs = LimbTables(scene.body)
        if limbs.tabled:
            part = scene.body.layout.parts[limbs.tabled[0][0]]
            raise TciError(f"{part} has a table of angles; valid on a GPU: other transforms, or skin=False")
        for one in rows:
            own = channels[one["begin"] : one["end"]]
            if len(own) > len(np.unique(own)):
                raise TciError("taxels that share a channel; valid on a GPU: one each, or skin=False")
        self._layout, self._scene = layout, scene
        self._regions = structs(
            clusters.Region,
            [self._region(scene, one, it) for one, it in zip(rows, layout.patches, strict=True)],
            None,
        )
        self._limbs = structs(
            measured.Limb,
            [
                {
                    "offset": wp.vec4(*one["offset"]), "side": float(one["side"]),
                    **dict(zip(("first", "second", "third"), one["shoulder"].tolist(), strict=True)),
                    **{name: wp.mat33(*one[name].ravel()) for name in ("axes", "at_zero", "R_TM")},
                }
                for one in limbs.limbs
            ],
            None,
        )  # fmt: skip
        n, first = len(scene.robot.servos), world.servos.drives[::-1]
        sensed = [{"address": -1, "ratio": 1.0, "shift": 0.0} for _ in range(n)]
        for one in first:  # of a servo with several joints the first counts
            sensed[int(one["servo"])] = {
                "address": int(one["address"]), "ratio": float(one["ratio"]), "shift": float(one["shift"]),
            }  # fmt: skip
        self._sensed = structs(measured.Sensed, sensed, None)

        def array(values: Any, kind: Any = float) -> Any:
            return wp.array(np.ascontiguousarray(values), dtype=kind)

        taxels = layout.taxels
        owner = np.repeat(np.arange(len(rows)), rows["end"] - rows["begin"])
        self._owner = array(owner, int)
        self._read = (
            array(world.taxels.arrays[5][:, AREA]), array(taxels["area"]), array(layout.gain),
            array(nodes if nodes.size else np.zeros((2, 1))), array(estimates.offset),
            array(np.where(estimates.muted, np.inf, estimates.threshold)),
        )  # fmt: skip
        T_LT, limits = scene.T_LT, scene.body.settings.contacts.limits
        self._shared = (
            wp.vec3(limits.floor, limits.light, limits.touch), scene.torso, wp.mat44(*T_LT.ravel()),
            array(taxels["position"], wp.vec3), array(taxels["normal"], wp.vec3), self._read[1],
            array(estimates.onset), array(estimates.hidden), array(layout.fill), array(layout.graph, int),
            array(layout.faces if len(layout.faces) else np.zeros((1, 3)), int), array(layout.cells, int),
        )  # fmt: skip
        self._weights, self._angles = array(limbs.weights), wp.zeros((count, n), dtype=float)
        self._posture = wp.zeros((count, len(limbs.limbs)), dtype=wp.vec4)
        self.felt = wp.zeros((count, scene.taxels), dtype=float)
        """Force (N, taxels) [N] on each taxel, as its sensor tells it."""
        self.labels = wp.zeros((count, scene.taxels), dtype=int)
        """Of the contact to which a taxel belongs (N, taxels): `Touch.label`."""
        self.found = wp.zeros((count, len(rows), clusters.PLACES), dtype=clusters.Touch)
        """Contacts (N, p, 8) of all patches, the strongest first."""
        self.counts = wp.zeros((count, len(rows)), dtype=int)
        """Numbers of contacts (N, p) on all patches."""
        self._queue, self._loaded = wp.zeros_like(self.labels), wp.zeros_like(self.counts)
        self.full = wp.zeros(1, dtype=int)
        """Number of a world with more contacts on a patch than there is room for, + 1; else 0."""
        self._host: dict[str, Any] = {}
        self._known: dict[int, ContactArrays] = {}

    @staticmethod
    def _region(scene: BatchScene, one: Any, it: Any) -> dict[str, Any]:
        """A `clusters.Region` from the records of one patch in `sampling` and in the layout."""
        limb = it["limb"]
        whole = ("body", "begin", "end", "node", "nodes")
        return {
            **{name: int(one[name]) for name in whole}, "cell": int(it["cell"]),
            **{f"cells_{axis}": int(n) for axis, n in zip("xyz", it["cells"], strict=True)},
            "limb_body": int(scene.bodies[it["limb_link"]]), "part": int(it["part"]),
            "per_count": float(one["per_count"]), "corner": wp.vec3(*it["corner"]),
            "per_metre": float(it["cells_per_metre"]), "origin": wp.vec3(*limb["origin"]),
            **{name: float(it[name]) for name in ("rest", "lowest", "highest", "sign")},
            **{name: float(limb[name]) for name in ("length", "side", "segment")},
            "R_TM": wp.mat33(*limb["R_TM"].ravel()),
        }  # fmt: skip

    def reset(self, worlds: NDArray[np.intp]) -> None:
        for array in (self.felt, self.counts, self._loaded):
            values = array.numpy()
            values[worlds] = 0
            array.assign(values)
        self.renew()

    def launch(self, due: Any, forces: Any, states: Any, qpos: Any, data: Any) -> None:
        """Finds the contacts of the patches that are `due` (p,), with the joints at `qpos` then."""
        n, p = self.counts.shape
        wp.launch(measured.unload, dim=(n, p), inputs=[due, self._loaded])
        wp.launch(measured.read, dim=self.felt.shape, inputs=[
            due, self._owner, self._regions, *self._read, forces, self.felt, self._loaded,
        ])  # fmt: skip
        wp.launch(measured.measure, dim=self._angles.shape, inputs=[self._sensed, qpos, states, self._angles])
        wp.launch(measured.postures, dim=self._posture.shape, inputs=[
            self._angles, self._weights, self._limbs, self._posture,
        ])  # fmt: skip
        wp.launch(clusters.find, dim=(n, p), inputs=[
            self._loaded, self._regions, *self._shared, self._posture, data.xpos, data.xmat, self.felt,
            self.labels, self._queue, self.found, self.counts, self.full,
        ])  # fmt: skip

    def renew(self) -> None:
        """Forgets what the host has read."""
        self._host, self._known = {}, {}

    def read(self, name: str) -> Any:
        """An array of the latest frames on the host; waits for the device. Raises TciError if a patch had
        more contacts than there is room for."""
        if name not in self._host:
            self._host[name] = getattr(self, name).numpy()
            if full := int(self.full.numpy()[0]):
                raise TciError(f"world {full - 1}: more than {clusters.PLACES} contacts on one patch")
        return self._host[name]

    def contacts(self, world: int) -> ContactArrays:
        """The contacts of one world; the same arrays until the next frames."""
        if world not in self._known:
            self._known[world] = self._contacts(world)
        return self._known[world]

    def _contacts(self, world: int) -> ContactArrays:
        counts = self.read("counts")[world]
        made = ContactArrays.empty(int(counts.sum()), 0)
        rows, begin, pressed = np.zeros(len(made.rows), CONTACT), made.begin, list[Any]()
        begin[0] = c = 0
        for p in np.flatnonzero(counts).tolist():
            own = slice(*self._layout.patches[["taxel", "taxel_end"]][p])
            for touch in self.read("found")[world, p, : counts[p]]:
                row = rows[c]
                row["site"], row["certainty"] = p, 1.0
                for name in ("force", "peak", "area", "u", "theta", "p_L", "n_L", "p_T", "n_T"):
                    row[name] = touch[name]
                row["f_T"] = -row["force"] * row["n_T"]
                row["limb_point"] = touch["u"], touch["y"], touch["z"]
                members = np.flatnonzero(self.read("labels")[world, own] == touch["label"])
                taxels = np.zeros(len(members), TAXEL)
                taxels["taxel"], taxels["taxel_force"] = members, self.read("felt")[world, own][members]
                positions: Array = self._layout.taxels["position"][own][members]
                at = positions @ touch["R_SL"].reshape(3, 3).T + touch["p_S"]
                taxels["taxel_point"] = (
                    [on_limb(x, y, z, touch["length"]) for x, y, z in at] if touch["length"] > 0.0 else np.nan
                )
                pressed.append(taxels)
                c += 1
                begin[c] = begin[c - 1] + len(taxels)
        return ContactArrays(rows, begin, np.concatenate([np.zeros(0, TAXEL), *pressed]))

    def active(self, world: int) -> tuple[NDArray[np.int64], NDArray[np.int32], Array]:
        """See `Worlds._active_of`."""
        felt, patches = self.read("felt")[world], self._layout.patches
        active = [np.flatnonzero(felt[a:b]) for a, b in patches[["taxel", "taxel_end"]].tolist()]
        all_of = np.flatnonzero(felt)
        pressure = felt[all_of] / self._layout.taxels["area"][all_of]
        numbers = np.array([len(own) for own in active], np.int64)
        return numbers, np.concatenate(active).astype(np.int32), pressure.astype(float)

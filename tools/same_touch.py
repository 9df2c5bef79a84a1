"""Picture of equal touches on the skins of five robots, as three measures of force."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import tci
from tci.body.generic_body import GenericBody
from tci.lab.experiments.same_touch import PROBES, Arm, places_on
from tci.robot.generic_arm import SEGMENTS
from tci.skin.contacts import weighted_force

ROBOTS = ("nao", "icub", "g1", "talos", "alex")
FORCE = 10.0
"""Force [N] of the touches. All skins can measure this force with every probe."""
MEASURES = {
    "mean of eq. 7": lambda contact: weighted_force(contact, 0.25),
    "sum over the taxels": lambda contact: float(contact.taxel_forces.sum()),
    "sum over the fill factor": lambda contact: contact.force,
}


def draw(path: Path) -> None:
    """Writes the picture. Each measure has one panel, and each robot has one line."""
    reflex, chance = tci.WithdrawalReflex(), np.random.default_rng(0)
    arms = [Arm(GenericBody(tci.load_robot(name)), reflex) for name in ROBOTS]
    places = [place for segment in SEGMENTS for place in places_on(arms, segment, chance)]
    figure, panels = plt.subplots(1, 3, figsize=(9.5, 3.2), layout="constrained")
    for arm in arms:
        felt = [
            [contact for place in places if (contact := arm.touch(*arm.pressure(place, probe), FORCE))]
            for probe in PROBES
        ]
        for panel, (title, measure) in zip(panels, MEASURES.items(), strict=True):
            medians = [np.median([measure(contact) for contact in own]) for own in felt]
            panel.plot(np.array(PROBES) * 1e3, medians, "o-", label=arm.name, markersize=4)
            panel.set_title(title, fontsize=10)
    for panel in panels:
        panel.set(xlabel="probe radius [mm]", xscale="log", ylim=(0, None), xticks=[3, 5, 10, 20])
        panel.set_xticks([], minor=True)
        panel.set_xticklabels(["3", "5", "10", "20"])
        panel.grid(alpha=0.3)
    for panel in panels[1:]:
        panel.axhline(FORCE, color="0.4", linewidth=0.8, linestyle="--")
        panel.set_ylim(0, 1.15 * FORCE)
    panels[0].set_ylabel(f"force [N] of a touch of {FORCE:g} N, median")
    panels[0].legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)

"""Converts a recording to matrices for NumPy and pandas (`pip install pandas`). The argument is the file;
without an argument the program makes a recording first."""

import sys
from pathlib import Path
from tempfile import mkdtemp

import tci
from tci.recording import recorded_robot, tables

try:
    import pandas as pd
except ModuleNotFoundError:
    sys.exit("this example needs pandas: pip install pandas")

path = Path(sys.argv[1]) if sys.argv[1:] else Path(mkdtemp()) / "touch.mcap"
if not sys.argv[1:]:
    with tci.connect(tci.load_robot("nao"), "sim") as driver, tci.Recorder(path, driver.robot) as recorder:
        driver.world.finger.poke("left_forearm", 100, speed=0.2, depth=0.008)
        tci.run(
            driver,
            tci.WithdrawalReflex(),
            duration=0.5,
            observe=lambda tick: recorder.tick(
                tick.now, tick.reading, tick.commands, tick.sent, tick.perception
            ),
        )

recording = tci.Recording(path)
found = tables(recording, recorded_robot(recording))  # arrays by name, with one row per time
skin = found["skin_left_forearm"]
forces = pd.DataFrame(skin["force_n"], index=skin["time_s"])  # frames by taxels [N]
contacts = pd.DataFrame(found["contacts"])

print(f"{len(forces)} frames of {forces.shape[1]} taxels, {forces.sum(axis=1).max():.2f} N at most")
print(contacts[["time_s", "patch", "force_n", "u", "theta_rad"]].head())

"""Runs the first program of yarpwire's README together with a port that sends one message, and prints the
output.

Only the package yarpwire is needed. This program replaces the name server, the robot and the person that
presses Enter.
"""

from __future__ import annotations

import os
import re
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

import yarpwire

PAGE = Path(yarpwire.__file__).parent / "README.md"


def main() -> None:
    (program, *_) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    came = threading.Event()
    with tempfile.TemporaryDirectory() as folder, yarpwire.NameServer() as server:
        os.environ["YARP_CONFIG_HOME"] = folder
        (Path(folder) / "yarp.conf").write_text("{} {} yarp\n".format(*server.address))
        skin = yarpwire.Wire().port("/icub/skin/left_hand", yarpwire.V3)

        def enter(prompt: str) -> str:
            while not skin.outputs:
                time.sleep(0.01)
            skin.write(np.array([240.0, 17.0]))
            assert came.wait(30.0), "the message has not come"
            return ""

        def show(values: object) -> None:
            print(values)
            came.set()

        exec(program, {"input": enter, "print": show})
        skin.close()


if __name__ == "__main__":
    main()

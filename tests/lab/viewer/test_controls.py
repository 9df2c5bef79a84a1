"""The sliders of a posture send their values to the robot."""

from __future__ import annotations

import asyncio
import threading
import time
from pathlib import Path
from unittest.mock import Mock

import numpy as np
from viser import _messages

import tci
from tci.lab.viewer.app import Viewer
from tci.lab.viewer.session import Session

PATIENCE = 40.0


def test_a_slider_is_heard_before_the_viewer_moves_it_back(tmp_path: Path) -> None:
    driver = tci.connect(tci.load_robot("nao"), "sim", step=0.002)
    viewer = Viewer([Session(driver, tci.WithdrawalReflex(), about={})], port=0, folder=tmp_path)
    server, session, controls = viewer.server, viewer.sessions["nao"], viewer.controls["nao"]
    session.start()
    end = time.monotonic() + PATIENCE
    while session.view is None:
        assert time.monotonic() < end
        time.sleep(0.01)
    server._connected_clients[0] = Mock()
    free = threading.Event()
    for _ in range(server._thread_executor._max_workers):
        server._thread_executor.submit(free.wait)  # all threads of viser are busy
    _, roll = controls._sliders["left_arm"][1]
    moved = _messages.GuiUpdateMessage(roll._impl.uuid, {"value": 60.0})
    told = server.gui._handle_gui_updates(0, moved)
    asyncio.run_coroutine_threadsafe(told, server.get_event_loop()).result(PATIENCE)
    controls.update()
    free.set()
    while session.view.posture["left_arm"][1] < np.deg2rad(59.0):
        assert time.monotonic() < end, "the order was lost"
        time.sleep(0.01)
    assert {"withdrawal", "attend", "teach"} <= {*controls.menu.options}
    chosen = _messages.GuiUpdateMessage(controls.menu._impl.uuid, {"value": "attend"})
    told = server.gui._handle_gui_updates(0, chosen)
    asyncio.run_coroutine_threadsafe(told, server.get_event_loop()).result(PATIENCE)
    while "runs attend" not in {words for _, words in list(session.events)}:
        assert time.monotonic() < end, "the choice was lost"
        time.sleep(0.01)
    server._connected_clients.clear()
    viewer.close()

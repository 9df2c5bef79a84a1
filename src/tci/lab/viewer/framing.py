"""Keeps all robots in the camera's picture, whatever the shape of the window is."""

from __future__ import annotations

import numpy as np
import viser

FOV, USUAL = 0.7, 0.8
"""Vertical angle of view [rad] of a usual picture, and the width of a usual picture divided by its height."""
AROUND = 1.32, 1.2
"""Height and width of the area that the picture shows at the distance of the robots, as factors of the
robots' height and width. Assumed: leaves room for moving arms."""
NARROW = 400
"""Least width [pixels] of a picture beside which the panel stays open. If a client's picture is narrower, the
viewer folds the panel once. Assumed: the width of a telephone, where the panel would cover most of the
picture."""


class Framing:
    """Controls the cameras of all clients. The angle of view depends on the shape of the client's window.
    Clients may move and turn the camera."""

    def __init__(
        self, server: viser.ViserServer, panel: viser.PanelHandle, *, width: float, height: float
    ) -> None:
        """Directs the cameras at the robots, which stand around the origin and are together `width` [m] wide
        and `height` [m] tall. `panel` is the panel next to the picture."""
        self._server, self._panel = server, panel
        self._folded: set[int] = set()
        self._reach = AROUND[1] * width / 2.0, AROUND[0] * height / 2.0
        self._distance = self._half(USUAL) / np.tan(FOV / 2.0)
        aim = np.array([0.0, 0.0, 0.55 * height])
        camera = server.initial_camera
        camera.position = tuple(aim + self._distance * np.array([0.94, 0.15, 0.3]))
        camera.look_at = tuple(aim)
        camera.up = (0.0, 0.0, 1.0)
        camera.fov = FOV

    def angle(self, aspect: float) -> float:
        """Returns the vertical angle of view [rad] with which a window shows all robots. The window is
        `aspect` times as wide as it is high."""
        return float(2.0 * np.arctan(self._half(aspect) / self._distance))

    def update(self) -> None:
        """Adapts every camera to the shape of the client's window, and folds the panel in narrow windows."""
        for number, client in self._server.get_clients().items():
            if min(client.camera.image_width, client.camera.image_height) <= 0:
                continue  # a minimised window has no shape
            client.camera.fov = self.angle(client.camera.aspect)
            if client.camera.image_width < NARROW and number not in self._folded:
                self._folded.add(number)
                handle = client.gui.main_panel
                # viser can fold the panel only for all clients together
                handle._placement_uuid = self._panel._placement_uuid
                handle.minimize()

    def _half(self, aspect: float) -> float:
        """Returns half the height [m] that a picture shows at the distance of the robots. `aspect` is the
        width of the picture divided by its height."""
        across, up = self._reach
        return max(up, across / aspect)

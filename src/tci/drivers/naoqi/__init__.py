"""Connection to a NAO over NAOqi, with the manufacturer's own library (PyPI `qi`, extra `naoqi`).

Modules:

- `driver` connects to a NAO.
- `server` offers any NAO, for example the simulated one, to NAOqi clients. `services` has the offered
  methods.
- `session` opens sessions, `poller` requests joints and skin, and `stream` sends angles.
- `words` defines the names that driver and server both use.
- `autonomy` handles the robot's autonomous motions.
"""

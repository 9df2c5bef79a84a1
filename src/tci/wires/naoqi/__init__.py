"""Connection to a NAO over NAOqi, with the manufacturer's own library (PyPI `qi`, extra `naoqi`).

Modules:

- `driver` connects to a NAO.
- `server` lets NAOqi clients read and command any NAO, for example the simulated one. `services` has the
  methods that clients can call.
- `session` opens sessions, `poller` requests joints and skin, and `stream` sends angles.
- `words` defines the names that driver and server both use.
- `autonomy` handles the robot's autonomous motions.
"""

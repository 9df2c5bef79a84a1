"""NAO over NAOqi, through the manufacturer's own library (PyPI `qi`, extra `naoqi`).

`driver` connects to a NAO; `server` serves any NAO, such as the simulated one, as a NAOqi service, with the
`services` that it has. `session` opens sessions, `poller` requests joints and skin, `stream` sends angles,
`words` has the names that both sides use, and `autonomy` handles the robot's autonomous motions.
"""

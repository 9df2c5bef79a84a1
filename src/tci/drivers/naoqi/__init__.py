"""NAO over NAOqi, through the makers' own library (PyPI `qi`, extra `naoqi`).

`driver` reaches a NAO; `server` shows any NAO, such as the simulated one, as a NAOqi service to others, with
the `services` that it has. `session` opens sessions, `poller` asks for joints and skin, `stream` sends
angles, `words` are the names that both sides use, `autonomy` is about motions that the robot makes by itself.
"""

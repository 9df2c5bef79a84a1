"""L2: links to robots, real and simulated. One module per middleware, one extra of the same name.

`link` holds the base class; every sibling is one way to reach a robot.
"""

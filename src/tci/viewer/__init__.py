"""The viewer: robots, simulated, real or recorded, in a browser (extra `viewer`, viser).

    Session, Player -> View (what is shown of one robot at one instant) -> Figure, Panel -> the page
    the page -> clicks, sliders, faults -> Session -> the loop, its gate, the robot

Nothing here reaches a robot but through the loop and its gate.
"""

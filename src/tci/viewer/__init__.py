"""The viewer: robots, simulated, real or recorded, in a browser (extra `viewer`, viser).

    Session, Player -> View (the state of one robot at one instant) -> Figure, Panel -> the page
    the page -> clicks, sliders, faults -> Session -> the loop, its gate, the robot

Its process owns the drivers of all robots that it shows. It commands a robot only through the loop
and its gate.
"""

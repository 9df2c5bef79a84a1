"""The viewer: shows simulated, real or recorded robots in a browser (extra `viewer`, which installs viser).

    Session, Player -> View (the state of one robot at one instant) -> Figure, Panel -> the page
    the page -> clicks, sliders, faults -> Session -> the loop, its gate, the robot

The viewer's process opens the drivers of all robots that the page shows. A click or a slider commands a robot
only through the control loop and its gate.
"""

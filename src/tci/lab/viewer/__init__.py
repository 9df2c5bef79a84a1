"""The viewer: shows simulated, real or recorded robots in a browser (extra `viewer`, which installs viser).

A `Session` runs a robot, or a `Player` plays a recording; each makes a `View`, the state of a robot at one
instant, which a `Figure` and a `Panel` show on the page. Clicks, sliders and injected faults go from the page
to the `Session`, and reach the robot only through the control loop and its gate.
"""

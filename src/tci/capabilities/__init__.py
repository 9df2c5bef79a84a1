"""Touch behaviours (Fig. 2, L4), each a subclass of `Capability`.

The withdrawal reflex responds to the force and place of a touch (eqs 5-7). Other capabilities yield to a
touch, stop the robot, play gestures, or combine behaviours in a tree.
"""

"""Touch felt through joints: contacts on limbs without skin, from the torques of their joints.

An observer finds the torques that come from outside, and an estimator the place and force that explain them.
The result is an ordinary contact; where there is skin too, it gives the place and the joints the force.
"""

"""Touch felt through joints: contacts on limbs without skin, from the torques of their joints.

An observer computes external torques, and an estimator the place and force that explain them. The result is
an ordinary contact; if there is also skin, the skin measures the place, and the joints improve the force.
"""

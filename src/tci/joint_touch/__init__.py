"""Detection of touches through joint torques, for example on limbs without skin.

An observer computes the external torques on the joints, and an estimator computes the point and the force of
a touch that would cause these torques. Touches that skin also measures keep the position from the skin, and
get a better force from the joint torques.
"""

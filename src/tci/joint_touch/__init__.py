"""Detection of touches through joint torques: contacts on limbs without skin.

An observer computes the external torques on the joints, and an estimator computes the point and the force of
a touch that would cause these torques. The result is a contact of the same type as a contact on skin; on
parts with skin, the skin measures the position of the contact, and the joint torques improve the force.
"""

"""Perception of touch: turns raw frames into pressure on taxels, and pressure into contacts.

Conditioning estimates each taxel's rest value and noise and turns raw values into pressure. Neighbouring
active taxels are combined to contacts with a place on the generic limb, and compiled loops (`kernels/`) track
these contacts over time.
"""

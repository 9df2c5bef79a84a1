"""Perception of touch: raw frames to pressure on taxels, and pressure to contacts.

Conditioning estimates each taxel's rest value and noise and turns raw values into pressure. Neighbouring
active taxels become contacts with a place on the generic limb, which are tracked over time by compiled loops
(`kernels/`).
"""

"""From raw frames to contacts.

Conditioning learns each taxel's rest and noise and turns raw values into pressure. Neighbouring active
taxels become contacts with a place on the generic limb, and contacts are tracked over time. The loops over
taxels are compiled (`kernels/`).
"""

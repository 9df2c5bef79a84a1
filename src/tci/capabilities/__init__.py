"""Touch behaviours (Fig. 2, L4), each a subclass of `Capability`.

The withdrawal reflex answers touches by force and place (eqs. 5-7). Others soften, stop, play gestures, or
combine behaviours in a tree.
"""

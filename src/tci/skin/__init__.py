"""From raw frames to contacts on the generic limb."""

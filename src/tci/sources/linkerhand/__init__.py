"""LinkerHand, hands with a matrix of touch on each finger tip, over CAN."""

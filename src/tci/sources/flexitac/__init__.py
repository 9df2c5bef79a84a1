"""FlexiTac, a pad of 12 x 32 taxels, over a serial port."""

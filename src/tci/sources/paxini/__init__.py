"""PaXini's PX-6AX GEN3 sensors, over serial ports: hands with a board for many of them (also ORCA's), and one
sensor alone."""

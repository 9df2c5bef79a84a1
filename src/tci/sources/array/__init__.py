"""Numbers from anywhere: lines over UDP, TCP or a serial port, and values from the program itself."""

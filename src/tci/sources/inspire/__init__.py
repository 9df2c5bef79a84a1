"""Inspire RH56DFTP, a hand with 17 pads and 1062 taxels, over Modbus TCP."""

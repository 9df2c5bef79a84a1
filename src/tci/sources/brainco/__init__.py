"""BrainCo Revo2, hands with four kinds of touch sensor, over Modbus RTU."""

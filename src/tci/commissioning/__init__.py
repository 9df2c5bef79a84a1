"""From a new robot to its first touch: the doctor, the first minutes, checks of hardware."""

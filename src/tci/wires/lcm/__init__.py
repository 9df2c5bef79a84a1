"""Driver and server for robots on the middleware LCM."""

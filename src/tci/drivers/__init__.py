"""Connections to a simulated robot, a recorded robot, or a robot on a middleware (layer L2 in Fig. 2 of the
paper). Each connection is a `Driver` (module `driver`), which reads the robot's sensors and sends the
commands that the driver's gate approved. Servers let other programs read and command a robot, and the package
`faults` injects faults into any driver."""

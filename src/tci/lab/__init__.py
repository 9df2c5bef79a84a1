"""Tools around the core: describe a robot, try a real one, experiments, faults, pictures, the viewer."""

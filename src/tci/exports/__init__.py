"""A robot as others want it: Denavit-Hartenberg parameters, trees for KDL, URDF, facts over a wire."""

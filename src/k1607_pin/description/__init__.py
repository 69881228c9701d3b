"""From Table 1 and the module masses to a URDF: facts and geometry, before any rigid-body library."""

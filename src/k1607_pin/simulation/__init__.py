"""The arm in motion: plant and integrators."""

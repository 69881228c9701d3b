"""Dynamics as pure functions of arrays: they know of no model, so that numbers and traced symbols go through alike."""

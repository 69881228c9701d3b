"""Kinematics as pure functions of arrays: one definition for numbers, batches, traced symbols and exact polynomials."""

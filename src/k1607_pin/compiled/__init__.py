"""From NumPy functions to CasADi expressions."""

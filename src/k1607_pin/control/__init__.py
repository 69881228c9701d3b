"""Control laws, each written once as a pure function of arrays."""

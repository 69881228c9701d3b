"""The arm on Pinocchio: the public door of the package."""

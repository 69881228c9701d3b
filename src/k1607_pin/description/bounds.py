"""How large a description may be: beyond, libraries overflow, run out of memory or crash."""

MOST_BYTES = 64 * 2**20
MOST_LINKS = 1000
"""Pinocchio's and urdfdom's own recursions end in a segmentation fault at some thousands."""
MOST_JOINTS = 100
"""Of an arm."""
MOST_MOVABLE = 150
"""Joints of a description that move before some are locked. Pinocchio's working memory grows with their cube: 400 take 4 GB."""
DEEPEST = 100
"""Elements within elements."""
LARGEST = 1e9
"""No length [m], mass [kg] or other number that is multiplied is larger: products of several still fit into floats."""

"""Where the tool should be, and how fast: paths as pure functions of time."""

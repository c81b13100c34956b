"""A pan/tilt head: `Head` for Python programs, and the controller that it shares with the nodes."""

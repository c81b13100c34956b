"""Which processes and nodes make up a run, and its terminal."""

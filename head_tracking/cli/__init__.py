"""Programs for the command line that are no nodes."""

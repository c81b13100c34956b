"""Nodes that publish targets, and the simulated camera."""

"""Recordings of a robot: written into files and read from them."""

"""The tool `doctor`: checks the requirements of a head."""

"""The tool `doctor`: checks what a head needs, and reports what is missing or wrong."""

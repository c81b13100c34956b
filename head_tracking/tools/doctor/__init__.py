"""The tool `doctor`: looks at everything that a head needs, and says what to do."""

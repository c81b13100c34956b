"""The tool `servo`: looks at servos on a bench, sets them up and calibrates a head."""

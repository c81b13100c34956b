"""The tool `servo`: shows what servos measure, sets them up and calibrates a head."""

"""The tool `servo`: shows what servos measure and sets them up."""

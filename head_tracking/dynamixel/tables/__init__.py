"""The vendor's control tables, one file for each family of servos."""

"""The robot as others see it: its model, its joints, and recordings."""

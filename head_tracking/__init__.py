"""A pan/tilt head that looks at things: transforms, gaze, tracking and a Dynamixel servo bus."""

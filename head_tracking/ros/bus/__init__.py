"""The node servo_bus: servos as joints on topics."""

"""ROS nodes: each reads parameters, wires topics to one object of the core, and publishes."""

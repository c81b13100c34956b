"""The executables of the package."""

NODES = {
    "servo_bus", "joint_state_publisher", "robot_state_publisher", "head_tracker", "point_head",
    "fictitious_target", "frame_target", "target_mux", "visual_target", "detection_target",
    "simulated_camera", "viewer", "recorder",
}  # fmt: skip
PROGRAMS = {
    "head_tracking", "look", "relax", "transforms", "track_report", "check_model", "simulated_bus",
    "calibrate", "head_setup", "new_robot", "servo", "doctor",
}  # fmt: skip

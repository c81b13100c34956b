"""The robot in a browser: a page that shows it in 3D and steers it. Knows viser, not ROS."""

"""Finding things in the images of cameras."""

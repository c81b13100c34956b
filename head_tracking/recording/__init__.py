"""What a robot says, written into files and read from them."""

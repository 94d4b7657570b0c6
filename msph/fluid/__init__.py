"""The physics. Knows no picture, no window and no file format."""

"""What holds the water: the walls of the box, bodies in it, a container."""

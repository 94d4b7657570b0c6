"""What is true of the water: errors, conserved quantities, timings. Reads all, changes nothing."""

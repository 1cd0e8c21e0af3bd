"""A simulated road, its vehicles and their drives, and the demonstration over UDP."""

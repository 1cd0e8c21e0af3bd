"""A simulated road, its vehicles, drives and driving software, and the demonstration over UDP."""

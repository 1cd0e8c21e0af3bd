"""Traffic in SUMO with and without stations, and crowds of stations that ask at once."""

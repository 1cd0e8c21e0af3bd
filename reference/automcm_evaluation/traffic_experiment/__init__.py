"""Traffic at scale: penetration, density and drivers, and many stations that ask at once.

Runs of traffic_scenarios in SUMO beside SUMO's own drivers, and sessions of a crowd on the radio.
Only ``sweeps`` imports it.
"""

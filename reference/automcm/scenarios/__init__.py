"""Applications of the service, and a simulated road with vehicles.

Applications handle no Acks; the service does not interpret their trajectories.
The commands and the evaluation import it.
"""

"""Applications on the service, and a simulated road with vehicles to drive them on.

None of them sees an Ack; the service looks into none of their trajectories.
The commands and the evaluation import it.
"""
